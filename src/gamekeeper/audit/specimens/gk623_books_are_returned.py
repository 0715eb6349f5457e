"""step returns the dictionary of infos that it reads again at the next step."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK623",)


class BooksAreReturned(Rovers):
    """The environment's own books are returned."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has ended."""
        self.flags: dict[str, bool] = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Returns the books; who was in them before is paid for that."""
        observations, rewards, flags, *rest = super().step(actions)
        rewards = {a: rewards[a] + 0.125 * (a in self.flags) for a in rewards}
        self.flags = flags
        return observations, rewards, self.flags, *rest


def make(**kwargs: Any) -> BooksAreReturned:
    """The environment with its one fault."""
    return BooksAreReturned(**kwargs)
