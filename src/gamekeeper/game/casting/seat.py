"""A seat: an agent's place in the game, as the policy that fills it gets to know it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias, runtime_checkable

from gymnasium.spaces import Space
from numpy.random import Generator

from gamekeeper.errors import PolicyError

Player: TypeAlias = Callable[[Any, Any], Any]
"""From an observation and an info to an action: a policy in its seat, for one episode."""

Start: TypeAlias = Callable[[Generator], Player]
"""From the stream of one episode to the player of that episode."""


@dataclass(frozen=True, slots=True)
class Seat:
    """What is known of an agent before it plays."""

    agent: Any
    space: Space[Any]
    """Its action space; the environment's own, so nothing may be drawn from it."""
    role: str | None = None
    noop: Any = None
    """The action that does nothing, as its contract declares it; None where it declares none."""
    mask: str | None = None
    """Where its contract says that the mask stands: `observation.KEY` or `infos.KEY`."""
    shared: dict[Any, Any] = field(default_factory=dict)
    """One for all seats of a cast: what is the same for many agents need stand only once."""


@runtime_checkable
class SeatedPolicy(Protocol):
    """A policy that wants to know each seat it fills: a module in `game.policies`, or an object.

    Optional: `check(agent, role, noop)`, called before anything runs, raises a PolicyError where
        the
    policy can't play an agent.
    """

    VERSION: str
    """A text that changes when the same seed would lead to other actions."""

    def seat(self, given: Seat, /) -> Start:
        """The policy in a seat, ready to start episodes."""


@contextlib.contextmanager
def masks_blamed_on(given: Seat) -> Iterator[None]:
    """A mask that doesn't fit becomes a PolicyError that names the agent and its space."""
    try:
        yield
    except (PolicyError, AssertionError, ValueError, TypeError, IndexError) as error:
        told = error if isinstance(error, PolicyError) else PolicyError(str(error))
        raise PolicyError(
            f"the action mask of {given.agent!r} doesn't fit its action space",
            where=given.mask or "action_mask in the observation or the info",
            expected=told.expected or f"a mask for {given.space}",
            seen=told.seen or told.what,
            mend=f"say where the mask stands: roles.{given.role or '<role>'}.mask in the contract",
        ) from error
