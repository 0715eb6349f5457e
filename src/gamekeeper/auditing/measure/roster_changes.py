"""Endings with their owners, the horizon, agents that join and leave. Pure."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.checks.facts.form_facts import EpisodeShape
from gamekeeper.episodes.layout import role

FEWEST: Final = 2
"""Episodes, for a word on the horizon or on endings."""
TOGETHER: Final = 0.3
"""Part of the endings in which both of two agents end, so that it isn't taken for chance."""
RARE: Final = 0.02
"""Part of the episodes in which three or more end together by chance, at most."""


@dataclass(frozen=True, slots=True)
class _Event:
    """Agents that ended in one step in one way, and how many were left but for other ways."""

    kind: str
    round: int
    count: int
    live: int

    @property
    def is_whole(self) -> bool:
        return self.count == self.live


def horizon(shapes: Sequence[EpisodeShape]) -> int | None:
    """Rounds after which all that are left are truncated, in two episodes at least.

    None where whole episodes were truncated at different lengths, or one went on for longer; one
    agent's own limit is none of it.
    """
    ends = [
        event.round + 1
        for shape in _over(shapes)
        for event in _events(shape)
        if event.kind == "truncation" and event.is_whole and _is_of_all(event, shape)
    ]
    longest = max((len(shape.rounds) for shape in shapes), default=0)
    is_one = len(ends) >= FEWEST and len(set(ends)) == 1
    return ends[0] if is_one and ends[0] >= longest else None


def kinds_of_endings(shapes: Sequence[EpisodeShape]) -> list[dict[str, Any]] | None:
    """Kinds of endings with their owner: one `agent`, or `all` that are left, with the episodes.

    None where fewer than two episodes ended by themselves. Two agents of several that happen to
    end in one step are no ending of all.
    """
    over = list(_over(shapes))
    if len(over) < FEWEST:
        return None
    limit = horizon(shapes)
    is_pair = max(len(shape.first) + len(shape.joined) for shape in over) == 2
    counts: Counter[tuple[str, str]] = Counter()
    for kind in ("termination", "truncation"):
        events = [(event, shape) for shape in over for event in _events(shape)]
        events = [pair for pair in events if pair[0].kind == kind]
        timed = [
            e for e, _ in events if kind == "truncation" and e.is_whole and e.round + 1 == limit
        ]
        counts[kind, "all"] += len(timed)
        rest = [pair for pair in events if not any(pair[0] is each for each in timed)]
        single = sum(not event.is_whole for event, _ in rest)
        whole = [event for event, shape in rest if event.is_whole and _is_of_all(event, shape)]
        if _is_by_chance(whole, single, len(over), is_pair=is_pair):
            single += len(whole)
        else:
            counts[kind, "all"] += len(whole)
        counts[kind, "agent"] += single
    return [
        {"kind": kind, "owner": owner, "seen": count}
        for (kind, owner), count in sorted(counts.items())
        if count
    ]


def _is_by_chance(whole: Sequence[_Event], single: int, episodes: int, *, is_pair: bool) -> bool:
    """Tells whether endings of all may be several agents' own that fell on one step."""
    if not whole or not single:
        return False
    many = sum(event.count > 2 for event in whole)
    if many >= FEWEST and many >= RARE * episodes:
        return False
    return not is_pair or len(whole) < TOGETHER * (single + len(whole))


def joined(shapes: Sequence[EpisodeShape]) -> list[str]:
    """Roles of agents that appeared after the reset."""
    return _roles(agent for shape in shapes for agent, _ in shape.joined)


def left(shapes: Sequence[EpisodeShape]) -> list[str]:
    """Roles of agents that left the roster without an ending."""
    return _roles(agent for shape in shapes for agent, _ in shape.left)


def _roles(agents: Iterable[str]) -> list[str]:
    return sorted({role(agent) for agent in agents})


def _over(shapes: Sequence[EpisodeShape]) -> Iterator[EpisodeShape]:
    return (shape for shape in shapes if shape.is_over)


def _is_of_all(event: _Event, shape: EpisodeShape) -> bool:
    """Tells whether more than the last agent left ended, or there never was another."""
    return event.live > 1 or len(shape.first) + len(shape.joined) == 1


def _events(shape: EpisodeShape) -> Iterator[_Event]:
    steps: dict[tuple[int, str], list[int]] = {}
    for ending in shape.endings:
        steps.setdefault((ending.step, ending.kind), []).append(ending.round)
    for (step, kind), rounds in steps.items():
        others = sum(len(each) for key, each in steps.items() if key[0] == step and key[1] != kind)
        yield _Event(kind, rounds[0], len(rounds), shape.live.get(step, 0) - others)
