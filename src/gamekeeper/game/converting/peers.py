"""PettingZoo's own conversion, for whoever asks whether an environment bears it."""

from __future__ import annotations

from typing import Any

from pettingzoo.utils.conversions import aec_to_parallel


def pettingzoo_parallel(env: Any) -> Any:
    """The AEC environment `env` behind PettingZoo's `aec_to_parallel`, as other libraries see it.

    Raises:
        AssertionError: its metadata doesn't say that it is parallelizable.
    """
    return aec_to_parallel(env)
