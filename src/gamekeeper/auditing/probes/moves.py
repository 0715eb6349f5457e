"""Moves of an episode as its agents see them, its greatest length, and other legal actions."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete
from numpy.random import Generator

from gamekeeper.auditing.evidence_memory import most_turns
from gamekeeper.auditing.probe_session import ProbeSession
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.episode_loop import EpisodePlan

LEAST_TURNS: Final = 8
TRIES: Final = 8
"""Draws of another action from a space that isn't Discrete."""
FILM_BYTES: Final = 32 << 20
"""Observations of one episode, as far as a probe that plays a handful of times keeps them."""


def moves(episode: Episode) -> int:
    """The number of turns at which some agent observed something else than it last did."""
    seen: dict[str, Any] = {}
    count = 0
    for turn in episode.turns:
        now = turn.observations
        count += any(agent in seen and not equal(seen[agent], now[agent]) for agent in now)
        seen.update(now)
    return count


def equal(one: Any, other: Any) -> bool:
    """Tells whether two observations are equal bit for bit."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.dtype != object:
        is_alike = one.dtype == other.dtype and one.shape == other.shape
        return is_alike and one.tobytes() == other.tobytes()
    return to_json(one) == to_json(other)


def affordable(session: ProbeSession, turns: int, size_bytes: int = FILM_BYTES) -> int:
    """So many turns, or fewer where observations and states are large; eight at least."""
    return min(turns, most_turns(session, size_bytes, LEAST_TURNS))


def cut(play: EpisodePlan, turns: int) -> EpisodePlan:
    """The first turns of an episode whose actions are scripted."""
    actions = (play.actions or ())[:turns]
    return replace(play, actions=actions, most_turns=max(len(actions), 1))


def legal(space: Discrete, mask: Any) -> Sequence[int]:
    """The actions that a mask allows, of a space of any size; none where the mask doesn't fit."""
    numbers = range(int(space.start), int(space.start) + int(space.n))
    if mask is None:
        return numbers
    flags = np.asarray(mask).ravel()
    return [numbers[at] for at in np.flatnonzero(flags)] if len(flags) == len(numbers) else []


def other_action(space: Any, mask: Any, own: Any, rng: Generator) -> tuple[bool, Any]:
    """Another legal action, drawn; False where none is found. Without an own one: any.

    Args:
        space: of the agent; one that isn't Discrete draws by itself.
        mask: None: all are legal.
        own: the action that is to be another one; None: there is none.
        rng: draws from a Discrete one.
    """
    if isinstance(space, Discrete):
        choices = legal(space, mask)
        place = choices.index(int(own)) if own is not None and int(own) in choices else None
        count = len(choices) - (place is not None)
        if count < 1:
            return False, None
        at = int(rng.integers(count))
        return True, space.dtype.type(choices[at + (place is not None and at >= place)])
    for _ in range(TRIES):
        drawn = space.sample() if mask is None else space.sample(mask)
        if own is None or not equal(drawn, own):
            return True, drawn
    return False, None


def legal_or_first(space: Any, mask: Any, action: Any) -> Any:
    """The action where the mask allows it, else the first that it allows.

    Of spaces that aren't Discrete any is taken for legal.
    """
    if mask is None or not isinstance(space, Discrete):
        return action
    choices = legal(space, mask)
    return action if not choices or int(action) in choices else space.dtype.type(choices[0])
