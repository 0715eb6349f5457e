"""A user's policy at work: whatever goes wrong in it is told with its name and its agent's."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Discrete
from numpy.random import Generator

from gamekeeper.errors import ActionError, GamekeeperError, PolicyError
from gamekeeper.game.casting.seat import Player, Seat, Start
from gamekeeper.game.opening.construct import foreign_traceback, said_by
from gamekeeper.game.policy import Chosen, Policy


def guarded_seat(seat: Seat, chosen: Chosen, policy: Policy) -> Start:
    """A user's policy in a seat: what it raises is told, and so is an answer that can't be used.

    Actions of a Discrete space are looked at. Those of other spaces pass as they are: many
    environments take a list or a float64 where their space says float32.
    """
    agent, space = seat.agent, seat.space
    first = int(space.start) if isinstance(space, Discrete) else None
    end = first + int(space.n) if isinstance(space, Discrete) and first is not None else 0

    def start(rng: Generator) -> Player:
        def play(observation: Any, info: Any) -> Any:
            try:
                action = policy(observation, agent, info, rng)
            except (Exception, SystemExit) as error:
                raise raised(chosen, agent, error) from error
            if action is None:
                raise _returned(PolicyError, chosen, seat, action)
            if first is not None:
                is_number = type(action) is int or isinstance(action, np.integer)
                if not (first <= action < end if is_number else space.contains(action)):
                    raise _returned(ActionError, chosen, seat, action)
            return action

        return play

    return start


def raised(chosen: Chosen, whom: Any, error: BaseException) -> PolicyError:
    """The error that names who failed, for whom, with the traceback as text."""
    return PolicyError(
        f"the policy {chosen.name} raised for {whom!r}: {said_by(error)}",
        where=str(whom),
        seen=f"\n{foreign_traceback(error)}",
        mend="mend the policy, or give the agent another one",
    )


def _returned(
    kind: type[GamekeeperError], chosen: Chosen, seat: Seat, action: Any
) -> GamekeeperError:
    return kind(
        f"the policy {chosen.name} returned {action!r:.80} for {seat.agent!r}, which is alive"
        if action is None
        else f"the policy {chosen.name} chose {action!r:.80} for {seat.agent!r}",
        where=str(seat.agent),
        expected=f"an action of {seat.space}",
        seen=f"{action!r:.80}",
        mend="return an action of the agent's space at every call",
    )
