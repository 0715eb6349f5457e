"""Rovers draw their batteries in the order of a set of their names."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK608",)


class OrderOfASet(Rovers):
    """Who gets which battery hangs on the hash seed of the process."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Hands out batteries."""
        super().reset(seed, options)
        for agent in set(self.agents):
            self.battery[agent] = int(self.rng.integers(8, 30))
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}


def make(**kwargs: Any) -> OrderOfASet:
    """The environment with its one fault."""
    return OrderOfASet(**kwargs)
