"""The front of pivots: a recorded run in, the turns that lost its failed episodes out."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.arms import SILENCE_S, play_shares
from gamekeeper.diagnosis.open_setup import (
    OpenSetup,
    Setup,
    consent_to,
    contract_of,
    evidence_to_play,
    other_policies,
    recorded_episode_of,
    setup_of,
)
from gamekeeper.diagnosis.pivot_result import EpisodePivots, Pivots
from gamekeeper.diagnosis.pivot_search import PivotSearch, reference_of
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import TEAM, Outcome, failed, failures, outcome_of
from gamekeeper.errors import EvidenceError
from gamekeeper.rollouts.continuations import Continuations
from gamekeeper.rollouts.executors.task import Executor
from gamekeeper.rollouts.interrupts import noted_if_interrupted
from gamekeeper.runs.consent import evidence_of

BUDGET: Final = 100_000
"""Env steps for all episodes unless told otherwise."""
TASK: Final = "gamekeeper.diagnosis.pivots:episode_task"


def pivots(
    run: str | PathLike[str] | Evidence,
    episode: int | None = None,
    *,
    failed: str | None = None,
    contract: Contract | str | PathLike[str] | None = None,
    policies: Mapping[str, Any] | None = None,
    seed: int = 0,
    budget: int = BUDGET,
    workers: int | Executor = 0,
    allow_import: bool = False,
) -> Pivots:
    """Finds the turns that lost failed episodes, and the agents whose action would have kept them.

    From turns of a failed episode the policies go on, on fresh draws: the share that succeeds, on
    a coarse grid first, then by bisection inside each fall. A fall that stands on continuations of
    its own is a pivot; at each, other actions of one agent are tried while those of the others are
    held. Where nothing draws anything, or many continuations from all over the episode fail, the
    last turn is looked for at which another action of one agent succeeds.

    Args:
        run: the folder of a run, or evidence.
        episode: number of a failed episode; None: all of them.
        failed: the condition under which an episode failed, as "return < 0.5"; else the contract's.
        contract: in place of the one of the recording.
        policies: that go on, in place of the recorded ones, by agent, role or under `*`.
        seed: of the continuations; equal seeds give equal answers.
        budget: env steps, shared equally by the episodes; a continuation that began is finished.
        workers: processes that play, an episode each; 0: this one; or an executor that plays.
        allow_import: run code that the evidence names.
    Raises:
        TrustError: the evidence names code that nobody allowed to run.
        EvidenceError: it names no policies, such an episode isn't there or didn't fail, or it isn't
            reproducible.
        ContractError: nothing says when an episode failed.
    """
    evidence = evidence_to_play(run, allow_import=allow_import)
    declared = contract_of(evidence, contract)
    conditions = failures(declared, failed, evidence.episodes)
    scopes = _failed_scopes(evidence, conditions, declared)
    chosen = _chosen(evidence, scopes, episode)
    setup = setup_of(evidence, policies=policies)
    common: dict[str, Any] = {
        "condition": failed,
        "budget": budget // max(len(chosen), 1),
        "seed": seed,
    }
    orders = [{**common, "episode": number, "scope": scopes[number]} for number in chosen]
    found: list[EpisodePivots] = []
    with (
        consent_to(evidence, setup, policies=policies, allow_import=allow_import),
        noted_if_interrupted(lambda: _known(found, len(chosen))),
    ):
        if isinstance(workers, int) and workers == 0:
            with OpenSetup(setup, declared) as open_setup:
                for order in orders:
                    found.append(_searched(evidence, open_setup, **order))
        else:
            where: dict[str, Any] = {"run": str(evidence.path), "setup": setup.to_json()}
            where["contract"] = declared.to_json()
            play_shares(
                TASK,
                [{**where, "order": order} for order in orders],
                lambda answer: found.append(EpisodePivots.from_json(answer)),
                workers=workers,
                silence_s=SILENCE_S,
                where=evidence.name,
                fix="try it with --workers 0 to see what it does",
            )
    return Pivots(
        run=evidence.name,
        fingerprint=evidence.fingerprint,
        episodes=tuple(sorted(found, key=lambda each: each.episode)),
        failed=(len(scopes), evidence.episode_table.num_rows),
        conditions={name: each.text for name, each in conditions.items()},
        budget=budget,
        seed=seed,
        policies=other_policies(evidence, setup),
    )


def _known(found: Sequence[EpisodePivots], count: int) -> list[str]:
    """Lines of what a search that was interrupted knows."""
    turns = {each.episode: [str(pivot.turn) for pivot in each.pivots] for each in found}
    lines = [f"pivots of episode {k}: {', '.join(turns[k]) or 'none'}" for k in sorted(turns)]
    return [f"{len(found)} of {count} episodes were searched; a new call begins anew", *lines]


def episode_task(
    report: Callable[..., None],
    *,
    run: str,
    setup: Mapping[str, Any],
    contract: Any,
    order: Mapping[str, Any],
) -> dict[str, Any]:
    """Looks for the pivots of one episode, in a worker process."""
    with OpenSetup(Setup.from_json(setup), Contract.from_json(contract)) as open_setup:
        return _searched(evidence_of(run), open_setup, **order, report=report).to_json()


def _failed_scopes(
    evidence: Evidence, conditions: Mapping[str, Any], contract: Contract
) -> dict[int, str]:
    """By number of a failed episode, whose condition it failed by; the team's before others."""
    found = {}
    for episode in evidence.episodes:
        by_scope = failed(outcome_of(episode), conditions, contract)
        mine = [name for name in sorted(by_scope, key=lambda name: name != TEAM) if by_scope[name]]
        if mine:
            found[episode.episode] = mine[0]
    return found


def _chosen(evidence: Evidence, scopes: Mapping[int, str], episode: int | None) -> list[int]:
    """The failed episodes that are asked for.

    Raises:
        EvidenceError: there is no such episode, or it didn't fail.
    """
    if episode is None:
        return list(scopes)
    if episode not in scopes:
        raise EvidenceError(
            f"the run has no failed episode {episode}",
            where=evidence.name,
            expected=", ".join(map(str, list(scopes)[:20])) or "a run with failed episodes",
            actual=str(episode),
            fix="name a failed episode" if scopes else "name another condition (--failed)",
        )
    return [episode]


def _searched(
    evidence: Evidence,
    open_setup: OpenSetup,
    *,
    episode: int,
    scope: str,
    condition: str | None,
    budget: int,
    seed: int,
    report: Callable[[], None] | None = None,
) -> EpisodePivots:
    """The pivots of one episode, once it has been replayed and is as it was recorded."""
    contract = open_setup.contract
    recorded = recorded_episode_of(evidence, open_setup, episode)
    play = Continuations(recorded, budget=budget, on_step=report)
    conditions = failures(contract, condition)

    def is_success(outcome: Outcome) -> bool:
        return not failed(outcome, conditions, contract).get(scope, True)

    reference = reference_of(open_setup.env, contract)
    return PivotSearch(play, is_success, reference, episode, scope, seed).run()
