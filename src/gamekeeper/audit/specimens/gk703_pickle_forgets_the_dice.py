"""A pickle leaves the generator out, and a copy begins with another one."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK703",)


class PickleForgetsTheDice(Traders):
    """The place in the random stream is lost."""

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the generator."""
        return {name: value for name, value in vars(self).items() if name != "rng"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """With a generator that begins anew."""
        self.__dict__.update(state)
        self.rng = np.random.default_rng(7)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """A deep copy keeps it."""
        twin = type(self)(self.count, self.rounds, self.render_mode)
        twin.__dict__.update(copy.deepcopy(vars(self), memo))
        return twin


def make(**kwargs: Any) -> PickleForgetsTheDice:
    """The environment with its one fault."""
    return PickleForgetsTheDice(**kwargs)
