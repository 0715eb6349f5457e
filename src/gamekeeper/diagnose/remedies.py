"""Remedies: what of a set-up isn't at its ideal, whose it is, and how it gets there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.parts import Knob
from gamekeeper.core.failure_label import LABELS
from gamekeeper.core.outcome import members_of
from gamekeeper.diagnose.setup import REFERENCE, Setup
from gamekeeper.record.recording import MOST_TURNS

PERCEPTION, ESTIMATION, PLANNING, CONTROL, TIMING, DATA, EVALUATION = LABELS


@dataclass(frozen=True, slots=True, eq=False)
class Remedy:
    """One thing at its ideal.

    Attributes:
        name: what it does, as `observation_noise[carrier_0] = 0`.
        label: the failure that it cures; of several parts, of all of them.
        agents: whose fault it cures; empty for a fault that is nobody's own.
        steps: what is set: (where, of whom, name, value).
        contains: names of the remedies that it makes up for.
        value: the number that it replaces, where it is one number.
    """

    name: str
    label: str
    agents: tuple[str, ...]
    steps: tuple[tuple[str, str, str, Any], ...]
    contains: frozenset[str] = frozenset()
    value: float | None = None

    def applied(self, setup: Setup) -> Setup:
        """The set-up with this at its ideal."""
        for step in self.steps:
            setup = _applied(setup, *step)
        return setup


def remedies_of(
    setup: Setup,
    contract: Contract,
    agents: Sequence[str],
    *,
    has_reference: bool = False,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    layers: Mapping[str, Any] | None = None,
    resettable: Iterable[str] = (),
) -> tuple[Remedy, ...]:
    """Every handle that isn't at its ideal, and for labels with several of them all at once.

    Args:
        agents: all that may play.
        has_reference: the environment brings a policy called `reference`.
        settings: values of policies' attributes that knobs name, by agent.
        layers: values of wrappers' attributes that knobs name.
        resettable: agents whose policy has a memory that can be reset.
    """
    found: list[Remedy] = []
    for name, knob in contract.knobs.items():
        found += _of_knob(name, knob, setup, contract, agents, settings or {}, layers or {})
    found += _of_protocol(setup, contract, agents)
    if has_reference:
        found += _of_policies(setup, contract, agents)
    for agent in resettable:
        step = ("forgets", agent, "", True)
        found.append(Remedy(f"memory[{agent}] reset", ESTIMATION, (agent,), (step,)))
    nested = tuple(_nested(found, contract))
    return (*nested, *_together(nested))


def _of_knob(
    name: str,
    knob: Knob,
    setup: Setup,
    contract: Contract,
    agents: Sequence[str],
    settings: Mapping[str, Mapping[str, Any]],
    layers: Mapping[str, Any],
) -> Iterator[Remedy]:
    where = knob.of or "argument"
    if where == "policy":
        for agent in agents:
            value = settings.get(agent, {}).get(name, knob.ideal)
            if value != knob.ideal:
                yield _remedy(name, knob, (agent,), ("policy", agent, name), value)
        return
    if where == "option":
        values = [(o or {}).get(name, knob.ideal) for o in setup.options]
        if any(value != knob.ideal for value in values):
            yield _remedy(name, knob, tuple(agents), ("option", "", name), values[0])
        return
    given = layers if where == "wrapper" else setup.kwargs
    value = given.get(name, knob.ideal)
    if not isinstance(value, Mapping) or isinstance(knob.ideal, Mapping):
        if value != knob.ideal:
            yield _remedy(name, knob, tuple(agents), (where, "", name), value)
        return
    for whom, part in value.items():
        theirs = [a for a in members_of(str(whom), agents, contract) if a == whom or a not in value]
        if part != knob.ideal and theirs:
            yield _remedy(name, knob, tuple(theirs), (where, str(whom), name), part)


def _remedy(
    name: str, knob: Knob, agents: tuple[str, ...], step: tuple[str, str, str], value: Any
) -> Remedy:
    whom = f"[{step[1]}]" if step[1] else ""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return Remedy(
        f"{name}{whom} = {knob.ideal}", knob.label, agents, ((*step, knob.ideal),),
        value=float(value) if is_number else None,
    )  # fmt: skip


def _of_protocol(setup: Setup, contract: Contract, agents: Sequence[str]) -> Iterator[Remedy]:
    """The declared horizon in place of another one, and no cut before it."""
    declared = contract.schedule.horizon
    given = setup.kwargs.get("horizon")
    steps: list[tuple[str, str, str, Any]] = []
    if declared is not None and given is not None and given < declared:
        steps.append(("argument", "", "horizon", declared))
    if setup.most_turns < MOST_TURNS:
        steps.append(("most_turns", "", "", MOST_TURNS))
    if steps and "horizon" not in contract.knobs:
        yield Remedy("the declared horizon", EVALUATION, tuple(agents), tuple(steps))


def _of_policies(setup: Setup, contract: Contract, agents: Sequence[str]) -> Iterator[Remedy]:
    for agent in agents:
        policy = setup.policy_of(agent, contract)
        if policy is not None and policy != REFERENCE:
            step = ("policies", agent, "", REFERENCE)
            name = f"policy[{agent}] = {REFERENCE}"
            inner = frozenset({f"memory[{agent}] reset"})
            yield Remedy(name, PLANNING, (agent,), (step,), inner)


def _nested(found: Sequence[Remedy], contract: Contract) -> Iterator[Remedy]:
    """The handles with what they are declared to make up for, for the same agents."""
    for one in found:
        knob = contract.knobs.get(one.steps[0][2])
        inner = knob.contains if knob is not None and knob.contains else ()
        names = {
            other.name
            for other in found
            if other.steps[0][2] in inner and set(other.agents) <= set(one.agents)
        }
        yield replace(one, contains=one.contains | names)


def _together(found: Sequence[Remedy]) -> Iterator[Remedy]:
    """For each label with several handles, all of them at once."""
    for label in LABELS:
        parts = [one for one in found if one.label == label]
        if len(parts) > 1:
            yield joined(parts, f"{label}: all")


def joined(parts: Sequence[Remedy], name: str | None = None) -> Remedy:
    """Several remedies at once; they are what it contains."""
    agents = dict.fromkeys(agent for part in parts for agent in part.agents)
    inner = {part.name for part in parts} | {name for part in parts for name in part.contains}
    labels = dict.fromkeys(part.label for part in parts)
    return Remedy(
        name or " + ".join(part.name for part in parts), " + ".join(labels), tuple(agents),
        tuple(step for part in parts for step in part.steps), frozenset(inner),
    )  # fmt: skip


def weakened(remedy: Remedy, value: float) -> Remedy:
    """The remedy of one knob, going only as far as `value`."""
    (where, whom, name, _), *_ = remedy.steps
    return replace(remedy, name=f"{name} at {value:g}", steps=((where, whom, name, value),))


def _applied(setup: Setup, where: str, whom: str, name: str, value: Any) -> Setup:
    if where == "argument":
        return replace(setup, kwargs={**setup.kwargs, name: _part(setup.kwargs, whom, name, value)})
    if where == "wrapper":
        return replace(setup, layers={**setup.layers, name: _part(setup.layers, whom, name, value)})
    if where == "option":
        options = tuple({**(each or {}), name: value} for each in setup.options)
        return replace(setup, options=options)
    if where == "policy":
        mine = {**setup.settings.get(whom, {}), name: value}
        return replace(setup, settings={**setup.settings, whom: mine})
    if where == "policies":
        return replace(setup, policies={**setup.policies, whom: value})
    if where == "forgets":
        return replace(setup, forgets=(*setup.forgets, whom))
    return replace(setup, most_turns=value)


def _part(given: Mapping[str, Any], whom: str, name: str, value: Any) -> Any:
    return {**given[name], whom: value} if whom else value
