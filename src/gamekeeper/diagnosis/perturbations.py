"""Perturbations of a diagnosis: one thing made worse, which shows dependence and never a cause."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, cast

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import Setup, SetupTraits
from gamekeeper.diagnosis.trials import EVALUATION, EVERYBODY, PLANNING
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.rollouts.intervention import Intervention

WORSE: Final = ("noop", "random", "greedy")
"""Policies that may take an agent's place: two of ours, and one that tasks may bring."""


@dataclass(frozen=True, slots=True, eq=False)
class PerturbationArm:
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


def perturbations_of(
    setup: Setup,
    contract: Contract,
    seen: SetupTraits,
    kinds: Mapping[str, type[Intervention]],
    agents: Sequence[str],
) -> Iterator[PerturbationArm]:
    """Every perturbation for every agent: first one of each label for all agents, then the next.

    Args:
        kinds: changes that are perturbations, by name.
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
    seen: SetupTraits,
    kinds: Mapping[str, type[Intervention]],
    agents: Sequence[str],
) -> Iterator[list[PerturbationArm]]:
    if label == PLANNING:
        for way in WORSE:
            yield [
                PerturbationArm(
                    f"giving {agent} the policy {way}", label, agent, setup.with_policy(agent, way)
                )
                for agent in agents
                if setup.policy_of(agent, contract) not in (way, None)
                and _is_known(way, agent, contract, seen)
            ]
    yield list(_for_all(label, setup, contract))
    for name, kind in kinds.items():
        if kind.label == label:
            fit = [agent for agent in agents if (name, agent) not in seen.unfit]
            changed = [replace(setup, change=_usual(kind, agent)) for agent in fit]
            yield [
                PerturbationArm(f"{name}[{agent}]", label, agent, worse)
                for agent, worse in zip(fit, changed, strict=True)
            ]


def _is_known(way: str, agent: str, contract: Contract, seen: SetupTraits) -> bool:
    """Tells whether the agent has such a policy: the environment's, a random one, a noop."""
    if way == "noop" and way not in seen.ways:
        return contract.noop_of(agent) is not None
    return way == "random" or way in seen.ways


def _for_all(label: str, setup: Setup, contract: Contract) -> Iterator[PerturbationArm]:
    """Perturbations of all agents: knobs at their worst, half the time."""
    for name, knob in contract.knobs.items():
        is_ideal = setup.kwargs.get(name, knob.ideal) == knob.ideal
        if knob.label == label and knob.worst is not None and not knob.of and is_ideal:
            worse = replace(setup, kwargs={**setup.kwargs, name: knob.worst})
            yield PerturbationArm(f"{name} = {knob.worst}", label, EVERYBODY, worse)
    turns = setup.most_turns if setup.typical_turns is None else setup.typical_turns // 2
    if label == EVALUATION and 0 < turns < setup.most_turns:
        cut = replace(setup, most_turns=turns)
        yield PerturbationArm(f"cut after {turns} turns", label, EVERYBODY, cut)


def _usual(kind: Any, agent: str) -> Intervention:
    return cast(Intervention, kind(agents=(agent,), strength=kind.USUAL))
