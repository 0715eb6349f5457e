"""Known extent of an episode: all of it, or the turns before its recorder was killed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import pyarrow.compute as pc

from gamekeeper.episodes.episode import Episode

# of an episode whose recorder was killed nothing is known after its last whole turn
ENDS_OPEN: Final = ("torn", "failed")


@dataclass(frozen=True, slots=True)
class Extent:
    """Known turns and states of an episode; it is unknown what comes after them.

    Attributes:
        turns: rows of turns below this are known; None: all there ever were.
        state: states of turns up to this are known; None: all there ever were.
    """

    turns: int | None = None
    state: int | None = None


WHOLE: Final = Extent()


def is_open(header: Mapping[str, Any]) -> bool:
    """True if an episode never came to its end."""
    return header.get("end") in (None, *ENDS_OPEN)


def env_steps(episode: Episode) -> int:
    """Number of steps; of an episode without an end, of the turns in which an agent acted."""
    turns = episode.header.get("turns")
    if turns is not None:
        return int(turns)
    acted = episode.steps["turn"].filter(pc.is_valid(episode.steps["order"]))
    return int(acted[-1].as_py()) + 1 if len(acted) else 0


def extent_of(episode: Episode) -> Extent:
    """Known extent of a whole episode."""
    if not is_open(episode.header):
        return WHOLE
    last = episode.steps["turn"][-1].as_py() if episode.steps.num_rows else -1
    state = None
    if episode.states is not None:
        state = episode.states["turn"][-1].as_py() if episode.states.num_rows else -1
    return extent(episode.header, turns=env_steps(episode), last=last, state=state)


def extent(header: Mapping[str, Any], *, turns: int, last: int, state: int | None) -> Extent:
    """Known extent of an episode.

    Args:
        turns: steps that were played.
        last: the last turn that has a row; -1 if none has.
        state: the last turn that has a state; -1 if none has, None where none were recorded.
    """
    failed_at_reset = header.get("end") == "failed" and last < 0
    is_whole = not is_open(header) or last >= turns or failed_at_reset
    return WHOLE if is_whole else Extent(turns, state)


def clipped(episode: Episode, known: Extent) -> Episode:
    """An episode without its rows after `known`."""
    if known.turns is None:
        return episode
    steps = episode.steps.filter(pc.less(episode.steps["turn"], known.turns))
    states = episode.states
    if states is not None and known.state is not None:
        states = states.filter(pc.less_equal(states["turn"], known.state))
    return replace(episode, steps=steps, states=states, _cache={})
