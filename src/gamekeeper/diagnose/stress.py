"""Stressors: arms in which one thing of one agent is worse; they show dependence, never a cause."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import LABELS
from gamekeeper.core.outcome import Outcome
from gamekeeper.core.paired import paired_effect
from gamekeeper.core.stats import holm
from gamekeeper.diagnose.diagnosis import Tested
from gamekeeper.diagnose.setup import Setup
from gamekeeper.diagnose.stage import Seen
from gamekeeper.run.change import Change

PLANNING: Final = "planning"
EVALUATION: Final = "evaluation"
EVERYBODY: Final = "*"
WORSE: Final = ("noop", "random", "greedy")
"""Policies that may take an agent's place: two of ours, and one that tasks may bring."""


@dataclass(frozen=True, slots=True, eq=False)
class Stressor:
    """One thing of one agent made worse.

    Attributes:
        name: of its arm.
        label: the failure that it stands for.
        agent: whose; `*`: everybody's.
        setup: with it.
    """

    name: str
    label: str
    agent: str
    setup: Setup


def stressors_of(
    setup: Setup,
    contract: Contract,
    seen: Seen,
    kinds: Mapping[str, type[Change]],
    agents: Sequence[str],
) -> Iterator[Stressor]:
    """Every stressor for every agent: first one of each label for all agents, then the next.

    Args:
        kinds: changes that are stressors, by name.
        agents: those that acted.
    """
    by_label = {
        label: list(_of_label(label, setup, contract, seen, kinds, agents)) for label in LABELS
    }
    depth = max((len(rows) for rows in by_label.values()), default=0)
    for place in range(depth):
        for rows in by_label.values():
            if place < len(rows):
                yield from rows[place]


def _of_label(
    label: str,
    setup: Setup,
    contract: Contract,
    seen: Seen,
    kinds: Mapping[str, type[Change]],
    agents: Sequence[str],
) -> Iterator[list[Stressor]]:
    if label == PLANNING:
        for way in WORSE:
            yield [
                _replaced(setup, agent, way)
                for agent in agents
                if setup.policy_of(agent, contract) not in (way, None)
                and _is_known(way, agent, contract, seen)
            ]
    yield list(_for_all(label, setup, contract))
    for name, kind in kinds.items():
        if kind.label == label:
            yield [
                Stressor(
                    f"{name}[{agent}]", label, agent, replace(setup, change=_usual(kind, agent))
                )
                for agent in agents
                if (name, agent) not in seen.unfit
            ]


def _is_known(way: str, agent: str, contract: Contract, seen: Seen) -> bool:
    """Whether the agent can be played so: the environment's own way, by chance, a declared noop."""
    if way == "noop" and way not in seen.ways:
        return contract.noop_of(agent) is not None
    return way == "random" or way in seen.ways


def _for_all(label: str, setup: Setup, contract: Contract) -> Iterator[Stressor]:
    """What befalls everybody: knobs at their worst, half the time."""
    for name, knob in contract.knobs.items():
        is_ideal = setup.kwargs.get(name, knob.ideal) == knob.ideal
        if knob.label == label and knob.worst is not None and not knob.of and is_ideal:
            worse = replace(setup, kwargs={**setup.kwargs, name: knob.worst})
            yield Stressor(f"{name} = {knob.worst}", label, EVERYBODY, worse)
    turns = setup.most_turns if setup.typical_turns is None else setup.typical_turns // 2
    if label == EVALUATION and 0 < turns < setup.most_turns:
        cut = replace(setup, most_turns=turns)
        yield Stressor(f"cut after {turns} turns", label, EVERYBODY, cut)


def _usual(kind: Any, agent: str) -> Change:
    change: Change = kind(agents=(agent,), strength=kind.USUAL)
    return change


def _replaced(setup: Setup, agent: str, way: str) -> Stressor:
    policies = {**setup.policies, agent: way}
    return Stressor(
        f"policy[{agent}] = {way}", PLANNING, agent, replace(setup, policies=policies)
    )  # fmt: skip


def effects(
    sham: Sequence[Outcome],
    arms: Mapping[Stressor, Sequence[Outcome]],
    *,
    rng: np.random.Generator,
) -> dict[Stressor, Tested]:
    """The effect of each stressor on the team's return, against the same seeds unchanged."""
    base = np.array([outcome.team_return for outcome in sham])
    found = {
        one: paired_effect(base, np.array([o.team_return for o in outcomes]), rng=rng)
        for one, outcomes in arms.items()
    }
    corrected = holm([effect.p for effect in found.values()])
    return {
        one: Tested(
            one.label, one.name, "stressor", effect.value, effect.low, effect.high, p, effect.n,
            measure="return", depends=p < 0.05,
        )
        for (one, effect), p in zip(found.items(), corrected, strict=True)
    }  # fmt: skip
