"""A run that fails beside one that worked: the least set of differences that explains the gap."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from os import PathLike

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.diagnosis.cut_offs import cutting_arguments, truncating_turn
from gamekeeper.diagnosis.diagnosis_options import DiagnosisOptions
from gamekeeper.diagnosis.diagnosis_result import AgentDiagnosis, Diagnosis, RunDifferences
from gamekeeper.diagnosis.difference_search import CONFIRM, Chosen, DifferenceSearch
from gamekeeper.diagnosis.experiment import fresh_seed
from gamekeeper.diagnosis.judgement import Answer
from gamekeeper.diagnosis.open_setup import (
    consent_to,
    contract_of,
    evidence_to_play,
    longest_of,
    setup_of,
)
from gamekeeper.diagnosis.setup_differences import (
    SetupDifference,
    differences_of,
    listed_only,
    names_of,
)
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import LABELS, TEAM, Outcome, failed, failures, outcome_of
from gamekeeper.rollouts.interrupts import noted_if_interrupted
from gamekeeper.statistics.significance import wilson


def compared(
    bad: str | PathLike[str] | Evidence,
    good: str | PathLike[str] | Evidence,
    options: DiagnosisOptions,
) -> Diagnosis:
    """The least sets of differences that explain why one run fails and the other doesn't.

    Without a condition of failure the team's return is compared.

    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: one of them names no policies.
        RunError: there is no run, or another experiment's outcomes lie in the folder.
    """
    one, two = (
        evidence_to_play(run, env=options.env, allow_import=options.allow_import)
        for run in (bad, good)
    )
    contract = contract_of(one, options.contract)
    is_judged = options.failed is not None or bool(contract.failure)
    conditions = failures(contract, options.failed) if is_judged else {}
    agents = list(dict.fromkeys(agent_name(a) for a in one.manifest.get("agents") or ()))
    mine = setup_of(one, env=options.env, policies=options.policies)
    theirs = setup_of(two, env=options.env)
    differences = differences_of(mine, theirs, contract, agents)
    with ExitStack() as stack:
        for evidence, setup, chosen in ((one, mine, options.policies), (two, theirs, None)):
            stack.enter_context(
                consent_to(
                    evidence,
                    setup,
                    env=options.env,
                    policies=chosen,
                    allow_import=options.allow_import,
                )
            )
        longest, listed = max(map(longest_of, (one, two))), [x.to_json() for x in differences]
        head = {"run": one.fingerprint, "good": two.fingerprint, "differences": listed}
        runner = stack.enter_context(options.runner(contract, head, longest, least=2 * CONFIRM))
        search = DifferenceSearch(
            mine,
            theirs,
            differences,
            runner,
            score_of(conditions, contract),
            options.part,
            (
                fresh_seed(one.fingerprint, options.seed, "search differences"),
                fresh_seed(one.fingerprint, options.seed, "confirm differences"),
            ),
            "success" if is_judged else "return",
        )
        with noted_if_interrupted(
            lambda: [options.goes_on, "scores by then:", *runner.known(search.score)]
        ):
            least = search.run()
    found = _differences(search, least, two, listed_only(one, two))
    return _diagnosis(one, search, found, least, agents, conditions, contract, options)


def score_of(conditions: Mapping[str, Failure], contract: Contract) -> Callable[[Outcome], float]:
    """The figure by which episodes are compared: 1 where nobody failed; else the team's return."""
    if not conditions:
        return lambda outcome: outcome.team_return
    return lambda outcome: float(not any(failed(outcome, conditions, contract).values()))


def _differences(
    search: DifferenceSearch,
    least: Sequence[Chosen],
    good: Evidence,
    versions: tuple[SetupDifference, ...],
) -> RunDifferences:
    bad_scores, good_scores = search.means()
    gap = search.gap
    return RunDifferences(
        good=str(good.path or "memory"),
        listed=(*search.differences, *versions),
        least=tuple(tuple(one.name for one in each) for each in least),
        why=_why(search, least, versions),
        measure=search.measure,
        means=(float(bad_scores.mean()), float(good_scores.mean())),
        gap=(gap.value, gap.low, gap.high),
        alone=search.alone,
        tested=tuple(search.confirmed),
        tried=len(search.tried),
    )


def _why(
    search: DifferenceSearch, least: Sequence[Chosen], versions: Sequence[SetupDifference]
) -> str:
    """The answer in a sentence, without a full stop."""
    count = len(search.differences)
    if least:
        sets = [names_of(each) for each in least]
        if len(sets) > 1:
            return f"each of {', '.join(sets)} as in the good run explains the gap by itself"
        needed = "; each of them is needed" if len(least[0]) > 1 else ""
        others = count - len(least[0])
        rest = f"; {others} of {count} differences don't matter" if others else ""
        return f"{sets[0]} as in the good run explains the gap{needed}{rest}"
    other = " (versions and sources are listed, but can't be swapped here)" if versions else ""
    if not search.differences:
        return f"the two runs differ in nothing that can be swapped{other}"
    if search.gap.low <= 0:
        return (
            f"on {CONFIRM} fresh seeds the good set-up is no better than the bad one beyond "
            f"chance{other}"
        )
    if search.not_played:
        return "the budget was spent before a least set of differences was confirmed"
    return "no set of differences that was tried stood on fresh seeds"


def _diagnosis(
    evidence: Evidence,
    search: DifferenceSearch,
    found: RunDifferences,
    least: Sequence[Chosen],
    agents: Sequence[str],
    conditions: Mapping[str, Failure],
    contract: Contract,
    options: DiagnosisOptions,
) -> Diagnosis:
    scores = search.means()[0]
    success = (0.0, 0.0, 1.0)
    fresh: dict[str, tuple[int, int]] = {}
    recorded: dict[str, tuple[int, int]] = {}
    if conditions:
        share = wilson(int(scores.sum()), len(scores))
        success = (share.p, share.low, share.high)
        fresh = {TEAM: (len(scores) - int(scores.sum()), len(scores))}
        told = [failed(outcome_of(each), conditions, contract) for each in evidence.episodes]
        recorded = {TEAM: (sum(any(each.values()) for each in told), len(told))}
    turn = truncating_turn(map(outcome_of, evidence.episodes))
    cuts = cutting_arguments(search.bad.kwargs, turn, len(agents))
    answers = {
        agent: _answer(agent, least, found, contract, success, cuts) for agent in (*agents, None)
    }
    return Diagnosis(
        run=evidence.name,
        fingerprint=evidence.fingerprint,
        agents={agent: answers[agent] for agent in agents},
        team=answers[None],
        recorded=recorded,
        fresh=fresh,
        part=options.part,
        expected=found.means[1] if conditions else 1.0,
        episodes=search.runner.spent,
        reused=search.runner.reused,
        seed=options.seed,
        conditions={name: each.text for name, each in conditions.items()},
        most_episodes=options.episodes,
        budget=options.budget,
        steps=search.runner.steps,
        not_played=tuple(search.not_played),
        differences=found,
        raised=search.raised,
    )


def _answer(
    agent: str | None,
    least: Sequence[Chosen],
    found: RunDifferences,
    contract: Contract,
    success: tuple[float, float, float],
    cuts: Mapping[str, int],
) -> AgentDiagnosis:
    """The answer for an agent, or for the team where there is none."""
    every = [one for each in least for one in each]
    mine = [one for one in every if agent is None or agent in one.agents or not one.agents]
    knobs = (contract.knobs.get(one.path[0]) for one in mine if one.path)
    labels = {knob.label for knob in knobs if knob is not None}  # no other label is shown
    answer: Answer
    if not least:
        answer = "unexplained" if found.gap[1] > 0 else "not_failing"
        if not any(one.kind != "version" for one in found.listed):
            answer = "not_tried"
    elif not mine:
        answer = "elsewhere"
    elif len(least) > 1:
        answer = "ambiguous"
    elif not any(one.agents for one in mine):
        is_cut = all(one.kind == "cut" or (one.path and one.path[0] in cuts) for one in mine)
        answer = "protocol" if is_cut else "environment"
    else:
        answer = "isolated" if len(least[0]) == 1 else "joint"
    between = " or " if len(least) > 1 else " and "
    return AgentDiagnosis(
        answer,
        tuple(label for label in LABELS if label in labels) if mine else (),
        found.why,
        TEAM,
        found.tested,
        (),
        success,
        tuple(one.name for one in mine),
        between.join(dict.fromkeys(_shown(one) for one in mine)) or None,
    )


def _shown(one: SetupDifference) -> str:
    """The place of the fault, as far as this shows it."""
    whose = " and ".join(one.agents)
    return {
        "environment": "the environment or its wrappers",
        "argument": f"the argument {one.name}",
        "option": f"the reset option {one.name.removeprefix('options.')}",
        "policy": f"{whose}'s policy",
        "cut": "the cut-off of episodes",
        "version": one.name,
    }[one.kind]
