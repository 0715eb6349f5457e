"""The front of diagnosis: a recorded run in, an answer for every agent out."""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.diagnosis.agent_answers import agent_answer
from gamekeeper.diagnosis.arms import SILENCE_S, ArmOrder
from gamekeeper.diagnosis.contradictions import Contradiction, contradictions
from gamekeeper.diagnosis.counterfactuals import KEPT, MOST, counterfactuals, keep
from gamekeeper.diagnosis.cut_offs import cuts_of, early_cut
from gamekeeper.diagnosis.diagnosis_options import DiagnosisOptions
from gamekeeper.diagnosis.diagnosis_result import AgentDiagnosis, Counterfactual, Diagnosis, Tested
from gamekeeper.diagnosis.experiment import LEAST, UNCHANGED, Experiment
from gamekeeper.diagnosis.good_run import compared, score_of
from gamekeeper.diagnosis.judgement import ALPHA, CAUSES, EXPECTED, PART, ScopeFinding
from gamekeeper.diagnosis.open_setup import (
    OpenSetup,
    SetupTraits,
    check_agents,
    check_last,
    consent_to,
    contract_of,
    evidence_to_play,
    longest_of,
    other_policies,
    setup_of,
    traits_of,
)
from gamekeeper.diagnosis.perturbations import PerturbationArm, perturbations_of
from gamekeeper.diagnosis.trials import renewals_of, substitutes_of
from gamekeeper.diagnosis.undo_search import try_undos
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import TEAM, Outcome, failed, failures, outcome_of
from gamekeeper.errors import EvidenceError
from gamekeeper.rollouts.executors.task import Executor
from gamekeeper.rollouts.interrupts import noted_if_interrupted
from gamekeeper.rollouts.intervention import interventions
from gamekeeper.statistics.paired import FEWEST, paired_effect
from gamekeeper.statistics.significance import holm

EPISODES: Final = 2_000
"""Episodes that an experiment may play unless told otherwise."""
PERTURBED: Final = 0.75
"""The part of the budget left by substitutes that perturbations get; the rest finds strengths."""
RESULT: Final = "diagnosis.json"


def diagnose(
    run: str | PathLike[str] | Evidence,
    *,
    good: str | PathLike[str] | Evidence | None = None,
    failed: str | None = None,
    contract: Contract | str | PathLike[str] | None = None,
    env: object | None = None,
    policies: Mapping[str, Any] | None = None,
    replace: Mapping[str, Any] | None = None,
    expected: float = EXPECTED,
    part: float = PART,
    seed: int = 0,
    episodes: int = EPISODES,
    budget: int | None = None,
    perturbations: bool | None = None,
    workers: int | Executor = 0,
    out: str | PathLike[str] | None = None,
    allow_import: bool = False,
    timeout_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Diagnosis:
    """Finds which agent, and which part of it, made a run fail, by experiments on fresh seeds.

    The recorded set-up is played as it is (the unchanged rerun) and with one thing at its ideal
    (ideal substitutes) or worse (perturbations), on the same fresh seeds. An ideal substitute that
    closes `part` of the gap between the share of successes as it is and the `expected` one
    restores; a cause is named where one restores and no other does. Perturbations show on what an
    agent's success hangs, never a cause.

    Args:
        run: the folder of a run, or evidence.
        good: a run that worked. Then what differs between the two is looked for in place of ideal
            substitutes, and the least set of differences that explains the gap is named in
            `differences`; `replace`, `expected` and `perturbations` aren't used, and without any
            condition the team's return is compared.
        failed: the condition under which an episode failed, as "return < 0.5"; else the contract's.
        contract: in place of the one of the recording.
        env: opened in place of what the evidence names, with the recorded arguments.
        policies: in place of the recorded ones, by agent, role or under `*`.
        replace: policies that are tried in the place of single agents' own, as ideal substitutes.
        expected: the share of episodes that succeed where nothing is wrong.
        part: of the gap to the expected share that an ideal substitute has to close.
        seed: of the experiment; equal seeds give equal answers.
        episodes: most that are played, 100 or more.
        budget: most env steps that are taken; None: as many as those episodes take. `not_played` of
            the diagnosis names what neither reached.
        perturbations: also play perturbations with what is left of the budget; None: where it fails
            beyond chance.
        workers: processes that play; 0: this one; or an executor that plays.
        out: a folder for what was played and for counterfactuals that replay; a second call goes
            on there.
        allow_import: run code that the evidence names.
        timeout_s: longest time without a turn in a worker.
        on_message: called with `{"episode", "episodes"}` as they are played.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: it names no policies, the budget is too small, or its last episode comes out
            otherwise when it is played by itself.
        ContractError: nothing says when an episode failed.
        RunError: there is no run, or another experiment lies in `out`.
    """
    _check_episodes(episodes)
    options = DiagnosisOptions(
        failed=failed,
        contract=contract,
        env=env,
        policies=policies,
        replace=replace,
        expected=expected,
        part=part,
        seed=seed,
        episodes=episodes,
        budget=budget,
        perturbations=perturbations,
        workers=workers,
        folder=None if out is None else Path(out),
        allow_import=allow_import,
        timeout_s=timeout_s,
        on_message=on_message,
    )
    if good is not None:
        return _written(compared(run, good, options), options.folder)
    evidence = evidence_to_play(run, env=env, allow_import=allow_import)
    return _by_experiments(evidence, options)


def _by_experiments(evidence: Evidence, options: DiagnosisOptions) -> Diagnosis:
    """The diagnosis by ideal substitutes, undos and perturbations."""
    declared = contract_of(evidence, options.contract)
    conditions = failures(declared, options.failed, evidence.episodes)
    outcomes = list(map(outcome_of, evidence.episodes))
    recorded, lost = _recorded(outcomes, conditions, declared)
    env, policies = options.env, options.policies
    setup = setup_of(evidence, env=env, policies=policies)
    tried, allow = list((options.replace or {}).values()), options.allow_import
    with consent_to(evidence, setup, env=env, policies=policies, allow_import=allow, tried=tried):
        kinds = {name: one for name, one in interventions().items() if one.kind == "perturbation"}
        with OpenSetup(setup, declared) as open_setup:
            if env is None:
                check_last(evidence, open_setup.opened)
            else:
                check_agents(evidence, open_setup)
            seen, played = traits_of(open_setup, kinds), open_setup.identity
            cuts = cuts_of(lost, open_setup.env, setup.kwargs, len(seen.agents))
            seen = dataclasses.replace(seen, cuts=cuts)
        head = {"run": evidence.fingerprint, "most_turns": setup.most_turns, **played}
        runner = options.runner(declared, head, longest_of(evidence), least=LEAST)
        experiment = Experiment(
            setup,
            substitutes_of(setup, declared, seen, options.replace),
            declared,
            conditions,
            runner,
            options.expected,
            options.part,
            options.seed,
            evidence.fingerprint,
            renewals=tuple(renewals_of(setup, seen)),
        )
        with runner, noted_if_interrupted(lambda: _known(experiment, options)):
            experiment.run()
            responses = try_undos(experiment, evidence.episodes)
            is_wanted = options.perturbations
            wanted = experiment.fails if is_wanted is None else is_wanted
            wanted = wanted and not experiment.is_broken_off
            experiment.early_cut = early_cut(lost, declared.schedule.horizon)
            diagnosis = _diagnosis(evidence, experiment, seen, kinds if wanted else {}, recorded)
            diagnosis = dataclasses.replace(diagnosis, responses=responses)
        folder = options.folder
        return diagnosis if folder is None else _kept(diagnosis, experiment, folder)


def _known(experiment: Experiment, options: DiagnosisOptions) -> list[str]:
    """Lines of what an experiment that was interrupted knows: shares of successes."""
    score = score_of(experiment.conditions, experiment.contract)
    return [options.goes_on, "success rates by then:", *experiment.runner.known(score)]


def _check_episodes(episodes: int) -> None:
    """Refuses so few episodes that nothing can be shown.

    Raises:
        EvidenceError: they are too few.
    """
    if episodes < LEAST:
        raise EvidenceError(
            f"{episodes} episodes are too few for a diagnosis",
            where="episodes",
            expected=f"{LEAST} or more",
            actual=str(episodes),
            fix=f"allow more (episodes=, --episodes); {EPISODES:,} is the default",
        )


def _diagnosis(
    evidence: Evidence,
    experiment: Experiment,
    seen: SetupTraits,
    kinds: Mapping[str, Any],
    recorded: Mapping[str, tuple[int, int]],
) -> Diagnosis:
    contract, conditions = experiment.contract, experiment.conditions
    agents = _present(evidence, experiment, seen)
    fresh = {scope: experiment.fresh(scope) for scope in experiment.scopes}
    others = other_policies(evidence, experiment.setup)
    doubts = {} if others or experiment.is_broken_off else contradictions(recorded, fresh)
    findings = {scope: scope_answer(experiment, scope, doubts.get(scope)) for scope in fresh}
    found = _counterfactuals(evidence, experiment, findings, recorded)
    repeated = experiment.runner.extra
    _reserve(experiment, findings)
    flips = _flips(experiment, findings)
    perturbed = _perturbed(experiment, seen, kinds, agents)

    def answer(agent: str | None, scope: str) -> AgentDiagnosis:
        return agent_answer(agent, scope, findings[scope], experiment, seen, flips, perturbed)

    by_agent = {agent: answer(agent, _scope_of(agent, findings, contract)) for agent in agents}
    team = answer(None, TEAM) if TEAM in findings else None
    return Diagnosis(
        run=evidence.name,
        fingerprint=evidence.fingerprint,
        agents=by_agent,
        team=team,
        recorded=recorded,
        fresh=fresh,
        counterfactuals=tuple(found),
        expected=experiment.expected,
        part=experiment.part,
        episodes=experiment.runner.spent + repeated,
        reused=experiment.runner.reused,
        seed=experiment.seed,
        contradictions=doubts,
        conditions={name: each.text for name, each in conditions.items()},
        most_episodes=experiment.runner.most,
        budget=experiment.runner.budget,
        steps=experiment.runner.steps,
        not_played=tuple(experiment.not_played),
        policies=others,
        raised=experiment.raised,
    )


def _counterfactuals(
    evidence: Evidence,
    experiment: Experiment,
    findings: Mapping[str, ScopeFinding],
    recorded: Mapping[str, tuple[int, int]],
) -> list[Counterfactual]:
    """Counterfactuals of recorded episodes that failed, as many as the budget leaves room for."""
    found: list[Counterfactual] = []
    for scope, finding in findings.items():
        if not finding.substitutes:
            continue
        wanted = min(MOST, recorded.get(scope, (0, 0))[0])
        most = min(wanted, experiment.runner.left // (1 + 2 * len(finding.substitutes)))
        if most < wanted:
            experiment.not_played.append(f"{wanted - most} of {wanted} counterfactuals of {scope}")
        rows = counterfactuals(
            evidence,
            experiment.setup,
            finding.substitutes,
            contract=experiment.contract,
            conditions=experiment.conditions,
            scope=scope,
            most=most,
        )
        mine = list(rows)
        experiment.runner.extra += 2 * len(mine) + len({row.episode for row in mine})
        found += mine
    return found


def _reserve(experiment: Experiment, findings: Mapping[str, ScopeFinding]) -> None:
    """Sets episodes aside that `_kept` plays again to record them, with a folder or without."""
    restoring = {one.name for finding in findings.values() for one in finding.substitutes}
    if not restoring:
        return
    arms = 1 + len(restoring)
    experiment.recordings = min(KEPT, experiment.runner.left // arms)
    experiment.runner.extra += experiment.recordings * arms
    if experiment.recordings < KEPT:
        left_out = f"{KEPT - experiment.recordings} of {KEPT} recordings of each arm that restores"
        experiment.not_played.append(left_out)


def scope_answer(experiment: Experiment, scope: str, doubt: Contradiction | None) -> ScopeFinding:
    """The answer for a scope, with what it has to say first.

    A policy that broke off most of the failed episodes; where no cause is named, a contradiction;
    where nothing explains a failure, what wasn't tried.
    """
    found, not_played = experiment.finding(scope), experiment.not_played
    if experiment.is_broken_off:
        why = f"{experiment.raised[0]}; nothing was tried, as no episode shows more than that"
        return dataclasses.replace(found, answer="not_tried", why=why)
    why = found.why if doubt is None or found.answer in CAUSES else str(doubt)
    if found.answer == "unexplained" and not_played:
        why = f"not tried: {'; '.join(not_played[:3])}; of what was, {why}"
    return dataclasses.replace(found, why=why)


def _recorded(
    outcomes: Sequence[Outcome], conditions: Mapping[str, Failure], contract: Contract
) -> tuple[dict[str, tuple[int, int]], list[Outcome]]:
    """Number of recorded episodes that failed, and of all, by scope; those that did for anybody."""
    told = [failed(each, conditions, contract) for each in outcomes]
    scopes = dict.fromkeys(scope for each in told for scope in each)
    rows = {scope: [each[scope] for each in told if scope in each] for scope in scopes}
    counts = {scope: (sum(row), len(row)) for scope, row in rows.items()}
    return counts, [x for x, each in zip(outcomes, told, strict=True) if any(each.values())]


def _present(evidence: Evidence, experiment: Experiment, seen: SetupTraits) -> list[str]:
    """Those who played, in the order of the roster: in the recording or on fresh seeds."""
    there = {agent for outcome in experiment.unchanged() for agent in outcome.returns}
    named = [agent_name(agent) for agent in evidence.manifest.get("agents") or seen.agents]
    return [agent for agent in dict.fromkeys([*seen.agents, *named]) if agent in there or not there]


def _scope_of(agent: str, findings: Mapping[str, ScopeFinding], contract: Contract) -> str:
    """The narrowest scope with a condition that holds for an agent."""
    scopes = (agent, contract.role_of(agent) or TEAM, TEAM, *findings)
    return next(scope for scope in scopes if scope in findings)


def _flips(experiment: Experiment, findings: Mapping[str, ScopeFinding]) -> dict[str, float]:
    return {
        one.name: at
        for scope, finding in findings.items()
        for one in (finding.substitutes if finding.answer == "isolated" else ())
        if (at := experiment.flips_at(one, scope)) is not None
    }


def _perturbed(
    experiment: Experiment, seen: SetupTraits, kinds: Mapping[str, Any], agents: Sequence[str]
) -> dict[PerturbationArm, Tested]:
    """Effects of perturbations on the team's return, as far as the budget goes."""
    if not kinds:
        return {}
    runner, seed, n = experiment.runner, experiment.confirm_seed, min(experiment.confirm, FEWEST)
    wanted = list(perturbations_of(experiment.setup, experiment.contract, seen, kinds, agents))
    few = wanted[: int(PERTURBED * experiment.runner.left) // n]
    if len(few) < len(wanted):
        experiment.not_played.append(f"{len(wanted) - len(few)} of {len(wanted)} perturbations")
    runner.play([ArmOrder(one.name, one.setup, seed, range(n)) for one in few])
    rng, scope = np.random.default_rng([12, experiment.seed]), experiment.scopes[0]

    def returns(arm: str) -> NDArray[np.float64]:
        return np.array([outcome.team_return for outcome in runner.of(arm, seed, range(n))])

    played = [one for one in few if one.name not in runner.broken]
    effects = [paired_effect(returns(UNCHANGED), returns(one.name), rng=rng) for one in played]
    corrected = holm([effect.p for effect in effects]) if effects else ()
    tested = {}
    for one, effect, p in zip(played, effects, corrected, strict=True):
        more: dict[str, Any] = {"p": p, "measure": "return", "depends": p < ALPHA}
        if more["depends"] and effect.value < 0:
            more["flips_at"] = experiment.breaks_at(one, scope)
        tested[one] = Tested.of(effect, one.label, one.name, "perturbation", **more)
    return tested


def _kept(diagnosis: Diagnosis, experiment: Experiment, folder: Path) -> Diagnosis:
    """The diagnosis with runs of the unchanged rerun and of what restores, and its own file."""
    wanted = list(dict.fromkeys(name for x in diagnosis.answers for name in x.substitutes))
    arms = [UNCHANGED, *wanted] if wanted and experiment.recordings else []
    runs: dict[str, str] = {}
    played = 0
    for number, arm in enumerate(arms):
        place = folder / "runs" / f"{number}-{_file_name(arm)}"
        if not place.exists():
            keep(
                experiment.arm(arm),
                place,
                contract=experiment.contract,
                run_seed=experiment.confirm_seed,
                episodes=experiment.recordings,
            )
            played += experiment.recordings
        runs[arm] = str(place)
    episodes = diagnosis.episodes + played
    return _written(dataclasses.replace(diagnosis, runs=runs, episodes=episodes), folder)


def _written(diagnosis: Diagnosis, folder: Path | None) -> Diagnosis:
    """The diagnosis, written into its folder if there is one."""
    if folder is not None:
        text = json.dumps(diagnosis.to_json(), indent=2, ensure_ascii=False)
        (folder / RESULT).write_text(text + "\n", encoding="utf-8")
    return diagnosis


def _file_name(arm: str) -> str:
    """A name that every file system takes."""
    return "".join(c if c.isalnum() else "-" for c in arm)[:60].strip("-")
