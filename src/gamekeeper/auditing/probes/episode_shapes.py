"""Shape of an episode: its rounds, endings, agents that came and went, and how each fared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from gamekeeper.auditing.branches import BranchStep, EpisodeSteps
from gamekeeper.checks.facts.form_facts import AgentEnding, EpisodeShape
from gamekeeper.episodes.layout import agent_name


def rounds_of(steps: Sequence[BranchStep], first: Iterable[Any], api: str) -> list[int]:
    """The round of each env step: a tick, or turns until an agent would act again or all have.

    The step of an agent that had ended belongs to the round before it.
    """
    if api == "parallel":
        return list(range(len(steps)))
    found, number, acted = [], 0, set[Any]()
    live = set(first)
    for step in steps:
        mover = next(iter(step.given), None)
        if mover is not None:
            if mover in acted or (acted and live <= acted):
                number, acted = number + 1, set()
            acted.add(mover)
        found.append(number)
        live = {agent for agent in step.roster if agent not in step.ended}
    return found


def shape(paper: EpisodeSteps, *, is_over: bool, api: str) -> EpisodeShape:
    """The shape of an episode; of one that was cut only whole rounds count for fares."""
    movers: dict[int, list[str]] = {}
    endings, joined, left = [], [], []
    live: dict[int, int] = {}
    roster, ended = set(paper.first), set[Any]()
    for place, (step, number) in enumerate(zip(paper.steps, paper.rounds, strict=True)):
        movers.setdefault(number, []).extend(map(agent_name, step.given))
        new = [agent for agent in step.ended if agent not in ended]
        if new:
            live[place] = len((roster | set(step.roster)) - ended)
        endings += [AgentEnding(agent_name(a), number, place, step.ended[a]) for a in new]
        joined += [(agent_name(agent), number) for agent in step.roster if agent not in roster]
        gone = roster - set(step.roster) - set(step.ended)
        left += [(agent_name(agent), number) for agent in sorted(gone, key=str)]
        roster, ended = set(step.roster), set(step.ended)
    return EpisodeShape(
        rounds=tuple(tuple(each) for _, each in sorted(movers.items()) if each),
        first=tuple(map(agent_name, paper.first)),
        endings=tuple(endings),
        joined=tuple(joined),
        left=tuple(left),
        live=live,
        fares=_fares(paper, is_whole=is_over or api == "parallel"),
        is_over=is_over,
    )


def _fares(paper: EpisodeSteps, *, is_whole: bool) -> dict[str, tuple[float, ...]]:
    """By agent: rewards, their magnitudes, payments, actions, and whether it terminated."""
    last = None if is_whole or not paper.rounds else paper.rounds[-1]
    found: dict[Any, list[float]] = {agent: [0.0] * 5 for agent in paper.first}
    for step, number in zip(paper.steps, paper.rounds, strict=True):
        if number == last:
            break
        for agent, paid in step.rewards.items():
            if agent in found:
                found[agent][0] += paid
                found[agent][1] += abs(paid)
                found[agent][2] += paid != 0
        for agent in step.given:
            if agent in found:
                found[agent][3] += 1
        for agent, kind in step.ended.items():
            if agent in found:
                found[agent][4] = float(kind == "termination")
    return {agent_name(agent): tuple(values) for agent, values in found.items()}
