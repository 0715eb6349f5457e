"""The state has more digits than its space."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK812",)


class StateFloat64(Traders):
    """A clean environment otherwise."""

    def state(self) -> Any:
        """As float64."""
        return super().state().astype(np.float64)


def make(**kwargs: Any) -> StateFloat64:
    """The environment with its one fault."""
    return StateFloat64(**kwargs)
