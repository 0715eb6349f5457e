"""Rovers are declared interchangeable, but the first one's battery drains twice as fast."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK511",)
CONTRACT = {"api": "parallel", "roles": {"rover": {"symmetric": True}}}


class FirstRoverTires(Rovers):
    """One of them isn't like the others."""

    def drive(self, agent: str, action: int) -> None:
        """The first rover's move costs twice as much."""
        super().drive(agent, action)
        if agent == self.possible_agents[0]:
            self.battery[agent] -= 1


def make(**kwargs: Any) -> FirstRoverTires:
    """The environment with its one fault."""
    return FirstRoverTires(**kwargs)
