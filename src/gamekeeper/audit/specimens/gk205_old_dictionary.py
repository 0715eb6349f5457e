"""The dictionary of action spaces was forgotten when an action was added."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK205",)


class OldDictionary(Rovers):
    """Who reads the dictionary never drives to one side."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.action_spaces = {a: spaces.Discrete(4) for a in self.possible_agents}


def make(**kwargs: Any) -> OldDictionary:
    """The environment with its one fault."""
    return OldDictionary(**kwargs)
