"""A deep copy draws from the generator of its original."""

from __future__ import annotations

import copy
from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK702",)


class CopySharesTheDice(Rovers):
    """Copies share the generator."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """Everything is copied but the generator."""
        twin = type(self)(self.count, self.horizon, self.render_mode)
        kept = {name: value for name, value in vars(self).items() if name != "rng"}
        twin.__dict__.update(copy.deepcopy(kept, memo))
        twin.rng = self.rng
        return twin


def make(**kwargs: Any) -> CopySharesTheDice:
    """The environment with its one fault."""
    return CopySharesTheDice(**kwargs)
