"""Measured endings and length of episodes, order of turns, and roles that act in blocks. Pure."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from statistics import median
from typing import Any, Final

from gamekeeper.checks.facts.form_facts import EpisodeShape, MoveTrial
from gamekeeper.checks.rounds import FIXED, OTHER, kind_of_order, orders
from gamekeeper.episodes.episode import Episode


def endings(episodes: Sequence[Episode]) -> dict[str, Any]:
    """Number of episodes in which each agent terminated, truncated, or was cut.

    `both` counts the episodes in which an agent did both: it counts as each of them.
    """
    by_agent: dict[str, dict[str, int]] = {}
    both = 0
    for episode in episodes:
        ends = _ends(episode)
        both += any(len(kinds) > 1 for kinds in ends.values())
        for agent, kinds in ends.items():
            counts = by_agent.setdefault(agent, {"terminated": 0, "truncated": 0, "open": 0})
            for kind in kinds or {"open"}:
                counts[kind] += 1
    ended = [len(orders(each)) for each in episodes if each.header.get("end") == "ended"]
    ticks = {"least": min(ended), "median": median(ended), "most": max(ended)} if ended else None
    return {
        "episodes": len(episodes),
        "ended": len(ended),
        "both": both,
        "by_agent": dict(sorted(by_agent.items())),
        "ticks": ticks,
    }


def _ends(episode: Episode) -> dict[str, set[str]]:
    """Flags of each agent; none of one that was left when the episode was cut."""
    found: dict[str, set[str]] = {}
    for turn in episode.turns:
        for agent in turn.agents:
            flags = {"terminated": turn.terminated, "truncated": turn.truncated}
            raised = {kind for kind, each in flags.items() if each.get(agent)}
            if raised or agent in turn.live:
                found.setdefault(agent, set()).update(raised)
    return found


LEAST: Final = 3
"""Rounds for a word on stages."""


def order_of_turns(shapes: Sequence[EpisodeShape], trials: Sequence[MoveTrial]) -> str | None:
    """`fixed`, `rotating`, `state` (a replaced move changes it) or `random`.

    None where no round had two agents.
    """
    kinds = {kind_of_order(shape.rounds) for shape in shapes} - {None}
    if not kinds:
        return None
    kind = next(iter(kinds)) if len(kinds) == 1 else OTHER
    if kind == FIXED and kind_of_order(_rounds(shapes)) != FIXED:
        kind = OTHER  # settled anew at each reset
    if kind != OTHER:
        return kind
    return "state" if any(trial.is_order_moved for trial in trials) else "random"


def stages(
    shapes: Sequence[EpisodeShape], roles: Mapping[str, Sequence[str]], order: str | None
) -> list[list[str]] | None:
    """Roles that act in blocks, one after the other; those without such an order in one stage."""
    names = list(roles)
    if order == "none":
        return [names]
    rounds = _rounds(shapes)
    if order is None or len(rounds) < LEAST:
        return None
    role_of = {agent: name for name, agents in roles.items() for agent in agents}
    blocks = [[role_of.get(agent, agent) for agent in each] for each in rounds]
    stage = {name: {name} for name in names}
    for one, two in combinations(names, 2):
        if not (_precedes(one, two, blocks) or _precedes(two, one, blocks)):
            joined = stage[one] | stage[two]
            stage.update(dict.fromkeys(joined, joined))
    first = {name: _place(name, blocks) for name in names}
    ordered = sorted(names, key=lambda name: min(first[each] for each in stage[name]))
    found = dict.fromkeys(tuple(n for n in names if n in stage[name]) for name in ordered)
    return [list(each) for each in found]


def _rounds(shapes: Sequence[EpisodeShape]) -> list[tuple[str, ...]]:
    return [each for shape in shapes for each in shape.rounds]


def _precedes(one: str, two: str, blocks: Sequence[Sequence[str]]) -> bool:
    """Tells whether all of a role act before all of another in each round that has both."""
    both = [each for each in blocks if one in each and two in each]
    return bool(both) and all(
        len(each) - 1 - each[::-1].index(one) < each.index(two) for each in both
    )


def _place(name: str, blocks: Sequence[Sequence[str]]) -> float:
    """Mean place of a role's first turn in a round."""
    places = [each.index(name) / len(each) for each in blocks if name in each]
    return sum(places) / len(places) if places else 1.0
