"""The generators that all of a process shares: numpy.random, random, torch where it is loaded."""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

HELD: Final = 764_309
"""A seed that nobody is likely to take too, so that seeding anew is always a change."""


def states() -> dict[str, Any]:
    """The state of each, comparable with `==`, by the name of its module."""
    name, keys, *rest = np.random.get_state(legacy=True)
    found: dict[str, Any] = {
        "numpy.random": (name, np.asarray(keys).tobytes(), *rest),
        "random": random.getstate(),
    }
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "get_rng_state"):
        found["torch"] = torch.get_rng_state().numpy().tobytes()
    return found


def restore(kept: Mapping[str, Any]) -> None:
    """Puts the states back that `states` gave."""
    name, keys, *rest = kept["numpy.random"]
    np.random.set_state((name, np.frombuffer(keys, np.uint32), *rest))
    random.setstate(kept["random"])
    torch = sys.modules.get("torch")
    if torch is not None and "torch" in kept:
        torch.set_rng_state(torch.from_numpy(np.frombuffer(kept["torch"], np.uint8).copy()))


def seed_all(seed: int) -> None:
    """Seeds each of them."""
    np.random.seed(seed)
    random.seed(seed)
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "manual_seed"):
        torch.manual_seed(seed)


@contextmanager
def held(seed: int = HELD) -> Iterator[None]:
    """Within it they start from one seed; afterwards they are as they were before."""
    kept = states()
    seed_all(seed)
    try:
        yield
    finally:
        restore(kept)
