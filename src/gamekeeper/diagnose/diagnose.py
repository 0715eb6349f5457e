"""The front of diagnosis: a recorded run in, an answer for every agent out."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper.core.contract import Contract
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.failure_label import LABELS
from gamekeeper.core.layout import agent_name
from gamekeeper.core.outcome import TEAM, failed, failures, outcome_of
from gamekeeper.core.paired import FEWEST
from gamekeeper.diagnose.arms import SILENCE_S, Lab, Order
from gamekeeper.diagnose.diagnosis import AgentDiagnosis, Diagnosis, Parting, Tested
from gamekeeper.diagnose.experiment import SHAM, Experiment
from gamekeeper.diagnose.judge import LEVEL, PART, Finding, Tried
from gamekeeper.diagnose.remedies import Remedy, remedies_of
from gamekeeper.diagnose.setup import contract_of, setup_of
from gamekeeper.diagnose.stage import Seen, Stage, seen_of
from gamekeeper.diagnose.stress import EVERYBODY, Stressor, effects, stressors_of
from gamekeeper.diagnose.twins import keep, partings
from gamekeeper.record.bundle import load
from gamekeeper.run.change import changes
from gamekeeper.run.executors.task import Executor

BUDGET: Final = 2_000
"""Episodes that an experiment may play unless told otherwise."""
STRESSED: Final = 0.75
"""The part of what remedies leave of the budget that stressors get; the rest finds strengths."""
NOTES: Final = "outcomes.jsonl"
RESULT: Final = "diagnosis.json"


def diagnose(
    run: str | PathLike[str] | Evidence,
    *,
    failed: str | None = None,
    contract: Contract | str | PathLike[str] | None = None,
    env: object | None = None,
    policies: Mapping[str, Any] | None = None,
    level: float = LEVEL,
    part: float = PART,
    seed: int = 0,
    budget: int = BUDGET,
    stressors: bool | None = None,
    workers: int | Executor = 0,
    out: str | PathLike[str] | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Diagnosis:
    """Which agent's what made a run fail, by controlled experiments on fresh seeds.

    The recorded set-up is played as it is (the sham) and with one thing at its ideal (remedies) or
    worse (stressors), on the same fresh seeds. A remedy that closes `part` of the gap between the
    share of successes as it is and the declared `level` restores; a cause is named where one
    restores and no other does. Stressors show on what an agent's success hangs, never a cause.

    Args:
        run: the folder of a run, or evidence.
        failed: the condition under which an episode failed, as "return < 0.5"; else the contract's.
        contract: in place of the one of the recording.
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`.
        level: the share of episodes that succeed where nothing is wrong.
        part: of the gap to the level that a remedy has to close.
        seed: of the experiment; equal seeds give equal answers.
        budget: episodes that may be played.
        stressors: also play stressors with what is left of the budget; None: where it fails
            beyond chance.
        workers: processes that play; 0: this one; or an executor that plays.
        out: a folder for what was played and for twins that replay; a second call goes on there.
        allow_import: run code that the evidence names.
        timeout_s: longest time without a turn in a worker.
        on_message: called with `{"episode", "episodes"}` as they are played.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: it names no policies.
        ContractError: nothing says when an episode failed.
        BundleError: there is no bundle, or another experiment lies in `out`.
    """
    evidence = run if isinstance(run, Evidence) else load(run)
    declared = contract_of(evidence, contract)
    conditions = failures(declared, failed)
    setup = setup_of(evidence, env=env, policies=policies, allow_import=allow_import)
    folder = None if out is None else Path(out)
    kinds = {name: kind for name, kind in changes().items() if kind.kind == "stressor"}
    with Stage(setup, declared) as stage:
        seen, played = seen_of(stage, kinds), _played(stage)
    remedies = remedies_of(
        setup, declared, seen.agents, has_reference=seen.has_reference, settings=seen.settings,
        layers=seen.layers, resettable=seen.resettable,
    )  # fmt: skip
    lab = Lab(
        declared, workers=workers, on_message=on_message, silence_s=timeout_s,
        notes=None if folder is None else folder / NOTES,
        head={"run": evidence.fingerprint, "seed": seed, **played},
    )  # fmt: skip
    experiment = Experiment(
        setup, remedies, declared, conditions, lab, level, part, budget, seed,
        evidence.fingerprint,
    )  # fmt: skip
    experiment.run()
    wanted = experiment.fails if stressors is None else stressors
    diagnosis = _diagnosis(evidence, experiment, seen, kinds if wanted else {})
    if folder is not None:
        diagnosis = _kept(diagnosis, experiment, folder)
    return diagnosis


def _played(stage: Stage) -> dict[str, Any]:
    """What tells experiments apart: source, arguments and policies of what is played."""
    identity = stage.opened.identity
    kept = ("entry_point", "api", "kwargs", "source_digest", "versions")
    plain = {key: identity.get(key) for key in kept}
    plain |= {"options": list(stage.setup.options), "policies": json.loads(stage.described)}
    found: dict[str, Any] = json.loads(json.dumps(plain, default=repr))
    return found


def _diagnosis(
    evidence: Evidence, experiment: Experiment, seen: Seen, kinds: Mapping[str, Any]
) -> Diagnosis:
    contract, conditions = experiment.contract, experiment.conditions
    recorded = _recorded(evidence, experiment)
    agents = _present(evidence, experiment, seen)
    findings = {scope: experiment.finding(scope) for scope in experiment.scopes}
    flips = _flips(experiment, findings)
    stressed, unstressed = _stressed(experiment, seen, kinds, agents)
    by_agent = {
        agent: _answer(
            agent, _scope_of(agent, findings, contract), findings, experiment, seen, flips,
            stressed, unstressed,
        )
        for agent in agents
    }  # fmt: skip
    team = None
    if TEAM in findings:
        team = _answer(None, TEAM, findings, experiment, seen, flips, stressed, unstressed)
    found: list[Parting] = []
    for scope, finding in findings.items():
        if finding.remedies:
            found += partings(
                evidence, experiment.setup, finding.remedies, contract=contract,
                conditions=conditions, scope=scope,
            )  # fmt: skip
    return Diagnosis(
        run=str(evidence.path or "memory"), fingerprint=evidence.fingerprint, agents=by_agent,
        team=team, recorded=recorded, partings=tuple(found), level=experiment.level,
        part=experiment.part, episodes=experiment.lab.spent, seed=experiment.seed,
    )  # fmt: skip


def _recorded(evidence: Evidence, experiment: Experiment) -> dict[str, tuple[int, int]]:
    """How many recorded episodes failed, by scope."""
    counts: dict[str, list[int]] = {}
    for trace in evidence.traces:
        told = failed(outcome_of(trace), experiment.conditions, experiment.contract)
        for scope, is_failed in told.items():
            count = counts.setdefault(scope, [0, 0])
            count[0] += is_failed
            count[1] += 1
    return {scope: (bad, of) for scope, (bad, of) in counts.items()}


def _present(evidence: Evidence, experiment: Experiment, seen: Seen) -> list[str]:
    """Those who played, in the order of the roster: in the recording or on fresh seeds."""
    there = {
        agent
        for outcome in experiment.lab.of(SHAM, experiment.confirm_seed, range(experiment.confirm))
        for agent in outcome.returns
    }
    named = [agent_name(agent) for agent in evidence.manifest.get("agents") or seen.agents]
    return [agent for agent in dict.fromkeys([*seen.agents, *named]) if agent in there or not there]


def _scope_of(agent: str, findings: Mapping[str, Finding], contract: Contract) -> str:
    """The narrowest scope with a condition that holds for an agent."""
    for scope in (agent, contract.role_of(agent), TEAM):
        if scope in findings:
            return str(scope)
    return next(iter(findings))


def _flips(experiment: Experiment, findings: Mapping[str, Finding]) -> dict[str, float]:
    found: dict[str, float] = {}
    for scope, finding in findings.items():
        for remedy in finding.remedies if finding.answer == "isolated" else ():
            at = experiment.flips_at(remedy, scope)
            if at is not None:
                found[remedy.name] = at
    return found


def _stressed(
    experiment: Experiment, seen: Seen, kinds: Mapping[str, Any], agents: Sequence[str]
) -> tuple[dict[Stressor, Tested], int]:
    """What stressors do, as far as the budget goes, and how many it didn't go to."""
    if not kinds or experiment.confirm < 1:
        return {}, 0
    lab, seed, n = experiment.lab, experiment.confirm_seed, min(experiment.confirm, FEWEST)
    wanted = list(stressors_of(experiment.setup, experiment.contract, seen, kinds, agents))
    known = [one for one in wanted if (one.name, seed, n - 1) in lab.outcomes]
    rest = [one for one in wanted if one not in known]
    left = max(experiment.budget - lab.spent, 0)
    few = rest[: int(STRESSED * left) // n]
    lab.play([Order(one.name, one.setup, seed, range(n)) for one in few])
    played = [one for one in (*known, *few) if one.name not in lab.broken]
    arms = {one: lab.of(one.name, seed, range(n)) for one in played}
    rng = np.random.default_rng([12, experiment.seed])
    tested = effects(lab.of(SHAM, seed, range(n)), arms, rng=rng) if arms else {}
    scope = experiment.scopes[0]
    for one, each in tested.items():
        if each.depends and each.effect < 0:
            tested[one] = replace(each, flips_at=experiment.breaks_at(one, scope))
    return tested, len(rest) - len(few)


def _answer(
    agent: str | None,
    scope: str,
    findings: Mapping[str, Finding],
    experiment: Experiment,
    seen: Seen,
    flips: Mapping[str, float],
    stressed: Mapping[Stressor, Tested],
    unstressed: int,
) -> AgentDiagnosis:
    """What is answered for an agent, or for the team where there is none."""
    finding = findings[scope]
    mine = [one for one in finding.tried if agent is None or agent in one.remedy.agents]
    tested = [_tested(one, experiment.confirm, flips) for one in mine]
    tested += [
        each for one, each in stressed.items() if agent is None or one.agent in (agent, EVERYBODY)
    ]
    tested.sort(key=lambda each: _place(each.label))
    found = AgentDiagnosis(
        finding.answer, finding.labels, finding.why, scope, tuple(tested),
        tuple(_not_tested(agent, mine, experiment, seen)), finding.success,
        tuple(remedy.name for remedy in finding.remedies),
    )  # fmt: skip
    concerned = {a for remedy in finding.remedies for a in remedy.agents}
    if agent is None or finding.answer == "untested" or not concerned or agent in concerned:
        return found
    names = ", ".join(remedy.name for remedy in finding.remedies)
    why = f"what restores is {names}, which is not this agent's"
    return replace(found, answer="untested", labels=(), why=why, remedies=())


def _tested(one: Tried, n: int, flips: Mapping[str, float]) -> Tested:
    effect = one.effect
    return Tested(
        one.remedy.label, one.remedy.name, "remedy", effect.value, effect.low, effect.high, one.p,
        n, restores=one.restores, flips_at=flips.get(one.remedy.name),
    )  # fmt: skip


def _place(label: str) -> int:
    """Where a label stands in the vocabulary; of a pair, the first one's."""
    return LABELS.index(label.split(" + ")[0]) if label.split(" + ")[0] in LABELS else len(LABELS)


def _not_tested(
    agent: str | None, mine: Sequence[Tried], experiment: Experiment, seen: Seen
) -> list[tuple[str, str]]:
    """Labels for which no remedy was played, and why."""
    tested = {label for one in mine for label in one.remedy.label.split(" + ")}
    handles = {one.label: one.name for one in experiment.remedies if _is_of(one, agent)}
    return [
        (label, _why_not(label, handles.get(label), agent, experiment, seen))
        for label in LABELS
        if label not in tested
    ]


def _why_not(
    label: str, handle: str | None, agent: str | None, experiment: Experiment, seen: Seen
) -> str:
    if handle is not None:
        broken = experiment.lab.broken.get(handle)
        return broken or "the set-up doesn't fail beyond chance, or the budget was spent: --budget"
    whom = "nobody's" if agent is None else "not this agent's"
    knobs = [name for name, knob in experiment.contract.knobs.items() if knob.label == label]
    if knobs:
        return f"{', '.join(knobs)}: at its ideal, or {whom}"
    if label == "planning" and seen.has_reference:
        return "the reference policy plays already"
    if label == "planning":
        return "the environment brings no reference policy"
    return "the contract declares no knob with this label"


def _is_of(remedy: Remedy, agent: str | None) -> bool:
    return agent is None or agent in remedy.agents


def _kept(diagnosis: Diagnosis, experiment: Experiment, folder: Path) -> Diagnosis:
    """The diagnosis with bundles of the sham and of what restores, and its own file."""
    names = [*([diagnosis.team] if diagnosis.team else []), *diagnosis.agents.values()]
    wanted = list(dict.fromkeys(name for each in names for name in each.remedies))
    arms = [SHAM, *wanted] if wanted else []
    bundles: dict[str, str] = {}
    for number, arm in enumerate(arms):
        place = folder / "bundles" / f"{number}-{_file_name(arm)}"
        if not place.exists():
            keep(
                experiment.arm(arm), place, contract=experiment.contract,
                run_seed=experiment.confirm_seed,
            )  # fmt: skip
        bundles[arm] = str(place)
    diagnosis = replace(diagnosis, bundles=bundles)
    text = json.dumps(diagnosis.to_json(), indent=2, ensure_ascii=False)
    (folder / RESULT).write_text(text + "\n", encoding="utf-8")
    return diagnosis


def _file_name(arm: str) -> str:
    """A name that every file system takes."""
    return "".join(c if c.isalnum() else "-" for c in arm)[:60].strip("-")
