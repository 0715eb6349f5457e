"""What a rerun can do differently: the hooks that a change may use, all of them idle unless taken.

A change is a frozen dataclass that inherits from `Change`; its fields are its parameters. `start`
gives the hooks for one play, so that nothing of one play is carried into the next.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from numpy.random import Generator

from gamekeeper.game.door import AgentId


class Hooks:
    """What is done in one play, beside what would be done anyway; every method may be replaced."""

    def before_reset(self, env: Any) -> None:
        """Before the reset."""

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """The actions of a turn in place of `actions`, one of an AEC environment's agent in turn.

        A dead agent's None stands in it too. The dictionary is the hooks' own, its values are not.
        """
        return actions

    def sees(self, turn: int, agent: AgentId, observation: Any) -> Any:
        """What a policy is shown in place of `observation`; the evidence keeps what was given."""
        return observation

    def between(self, turn: int, env: Any) -> None:
        """After the reset (turn 0) and after every crossing, before anybody chooses."""

    def after(self, env: Any) -> None:
        """Once the play is over; also where it broke off."""


@dataclass(frozen=True, slots=True)
class Change:
    """Exactly one thing done differently."""

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play.

        Args:
            rng: the change's own stream; equal for equal plays.
        """
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """Plain data: its kind under `change`, and its parameters."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        return {"change": type(self).__name__, **named}
