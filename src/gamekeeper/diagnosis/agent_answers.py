"""The answer for one agent, from the finding of the condition that it is judged by."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from gamekeeper.diagnosis.diagnosis_result import AgentDiagnosis, Tested
from gamekeeper.diagnosis.experiment import Experiment
from gamekeeper.diagnosis.judgement import (
    ALPHA,
    CAUSES,
    ScopeFinding,
    Tried,
    is_any_exchange,
    is_any_scale,
)
from gamekeeper.diagnosis.open_setup import SetupTraits
from gamekeeper.diagnosis.perturbations import PerturbationArm
from gamekeeper.diagnosis.trials import (
    CARRIED,
    CUT_OFF,
    EVERYBODY,
    MEMORY,
    POLICY,
    IdealSubstitute,
    joined_names,
)
from gamekeeper.episodes.outcome import LABELS
from gamekeeper.interface.policy import REFERENCE

SOUND: Final = "the set-up doesn't fail more often than chance allows"


def agent_answer(
    agent: str | None,
    scope: str,
    finding: ScopeFinding,
    experiment: Experiment,
    seen: SetupTraits,
    flips: Mapping[str, float],
    perturbed: Mapping[PerturbationArm, Tested],
) -> AgentDiagnosis:
    """Answer for an agent, or for the team where there is none."""
    mine = [one for one in finding.tried if agent is None or agent in one.substitute.agents]
    tested = [_tested(one, experiment.confirm, flips) for one in mine]
    tested += [
        each for one, each in perturbed.items() if agent is None or one.agent in (agent, EVERYBODY)
    ]
    tested.sort(key=lambda each: _place(each.label or ""))
    found = AgentDiagnosis(
        finding.answer,
        finding.labels,
        finding.why,
        scope,
        tuple(tested),
        tuple(_not_tested(agent, mine, experiment, seen)),
        finding.success,
        tuple(substitute.name for substitute in finding.substitutes),
        _shown(finding, finding.substitutes),
        tuple(one.name for one in finding.beside if agent is None or agent in one.agents),
    )
    concerned = {a for substitute in finding.substitutes for a in substitute.concerned}
    concerned -= experiment.acquitted
    if agent is None or finding.answer not in CAUSES or not concerned:
        return found
    if agent in concerned:
        return _own_part(agent, found, finding)
    names = ", ".join(substitute.name for substitute in finding.substitutes)
    is_acquitted = agent in experiment.acquitted
    helps = [one.substitute for one in mine if _helps_alone(one, concerned)]
    if helps and not is_acquitted:
        return _not_acquitted(found, helps, names, "helps beyond chance too")
    rivals = [one for one in experiment.rivals if agent in one.agents]
    if rivals and not is_acquitted:
        end = "did in the search; it wasn't played on fresh seeds, as the budget was spent"
        return dataclasses.replace(_not_acquitted(found, rivals, names, end), substitutes=())
    why = f"what restores success is {names}, which isn't this agent's"
    if is_acquitted:
        why = f"with another policy in its place it fails as well, and {names} restores success"
    return dataclasses.replace(
        found, answer="elsewhere", labels=(), why=why, substitutes=(), component=None
    )


def _helps_alone(one: Tried, concerned: Collection[str]) -> bool:
    """An ideal substitute of other agents than those concerned helps beyond chance."""
    parts = one.substitute.component.split(" + ")
    is_ideal = one.substitute.undo is None and not {MEMORY, CARRIED, CUT_OFF} & {*parts}
    is_own = bool(one.substitute.agents) and not set(one.substitute.agents) & set(concerned)
    return is_ideal and is_own and one.effect.low > 0 and one.p < ALPHA


def _not_acquitted(
    found: AgentDiagnosis, own: Sequence[IdealSubstitute], names: str, end: str
) -> AgentDiagnosis:
    """The answer for an agent whose own substitute helps, though another's restores."""
    named = {label for one in own for label in one.labels}
    shown = ", ".join(one.name for one in own)
    return dataclasses.replace(
        found,
        answer="ambiguous",
        labels=tuple(label for label in LABELS if label in named),
        why=f"{names} restores success, and this agent's own {shown} {end}",
        substitutes=tuple(one.name for one in own),
        component=" or ".join(dict.fromkeys(one.shown for one in own)),
    )


def _shown(finding: ScopeFinding, substitutes: Sequence[IdealSubstitute]) -> str | None:
    """The place of the fault, as far as these substitutes show it."""
    if finding.answer not in CAUSES:
        return None
    if finding.answer == "protocol" and not substitutes:
        return "the cut-off of episodes before the declared horizon"
    substitutes = substitutes or [one.substitute for one in finding.tried]
    if is_any_scale(substitutes) or is_any_exchange(substitutes):
        whose = dict.fromkeys(agent for one in substitutes for agent in one.agents)
        return f"the policy of {', '.join(whose)}, or what it makes of what it observes"
    between = " and " if finding.answer == "joint" else " or "
    return between.join(
        dict.fromkeys(part for one in substitutes for part in one.shown.split(between))
    )


def _own_part(agent: str, found: AgentDiagnosis, finding: ScopeFinding) -> AgentDiagnosis:
    """The answer for an agent of several: of a pair, or of what may be it, only its own part."""
    parts = list(finding.substitutes)
    if finding.answer == "joint" or all(one.is_pair for one in parts):
        parts = [leaf for one in parts for leaf in one.leaves]
    mine = [one for one in parts if agent in one.concerned]
    if not mine or len(mine) == len(parts):
        return found
    named = {label for one in mine for label in one.labels}
    labels = tuple(label for label in found.labels if label in named)
    return dataclasses.replace(found, labels=labels, component=_shown(finding, mine))


def _tested(one: Tried, n: int, flips: Mapping[str, float]) -> Tested:
    what = one.substitute
    label, flips_at = " + ".join(what.labels) or None, flips.get(what.name)
    more: dict[str, Any] = {"p": one.p, "n": n, "restores": one.restores, "flips_at": flips_at}
    return Tested.of(one.effect, label, what.name, _kind(what), **more)


def _kind(substitute: IdealSubstitute) -> str:
    """The kind of a substitute: an undo from outside, a swapped policy, or an ideal."""
    if substitute.undo is not None or substitute.is_pair or substitute.component == CARRIED:
        return "undo"
    is_swap = substitute.component == POLICY and substitute.steps[0][3] != REFERENCE
    return "swap" if is_swap else "ideal"


def _place(label: str) -> int:
    """Place of a label in the vocabulary; of a pair, the first one's."""
    first = label.split(" + ")[0]
    return [*LABELS, first].index(first)


def _not_tested(
    agent: str | None, mine: Sequence[Tried], experiment: Experiment, seen: SetupTraits
) -> list[tuple[str, str]]:
    """Labels, and whole policies, for which no ideal substitute was played, and why."""
    tested = {each for one in mine for each in one.substitute.component.split(" + ")}
    handles = {
        one.component: one.name
        for one in experiment.substitutes
        if agent is None or agent in one.agents
    }
    return [
        (label, _why_not(label, handles.get(label), agent, experiment, seen))
        for label in (*LABELS, POLICY)
        if label not in tested
    ]


def _why_not(
    label: str, handle: str | None, agent: str | None, experiment: Experiment, seen: SetupTraits
) -> str:
    if handle is not None:
        broken = experiment.runner.broken.get(handle)
        spent = f"the {experiment.runner.limit} was reached"
        return broken or (spent if experiment.fails else SOUND)
    knobs = [name for name, knob in experiment.contract.knobs.items() if knob.label == label]
    is_anothers = any(one.component == label for one in experiment.substitutes)
    if is_anothers:
        return "what could be made ideal isn't this agent's" if experiment.fails else SOUND
    if knobs:
        have = "has its ideal value" if len(knobs) == 1 else "have their ideal values"
        return f"{joined_names(knobs)} {have} already"
    if label == POLICY and REFERENCE in seen.ways:
        return "the reference policy plays already"
    if label == POLICY:
        return "the environment has no reference policy"
    return "the contract declares no knob with this label"
