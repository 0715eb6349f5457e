"""A clean environment that says things in two places, and the same: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS: tuple[str, ...] = ()


class ToldTwice(Tokens):
    """Masks stand in infos too, spaces in dictionaries."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.observation_spaces, self.action_spaces = self._seen, self._done

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Begins with infos."""
        super().reset(seed, options)
        self.tell()

    def step(self, action: Any) -> None:
        """Goes on with infos."""
        super().step(action)
        self.tell()

    def tell(self) -> None:
        """The mask of each, as it is observed."""
        for agent in self.agents:
            self.infos[agent] = {"action_mask": self.observe(agent)["action_mask"]}


def make(**kwargs: Any) -> ToldTwice:
    """The environment as it should be."""
    return ToldTwice(**kwargs)
