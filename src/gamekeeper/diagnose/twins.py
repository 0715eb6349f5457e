"""Twins of recorded episodes: the same seeds under a remedy, compared and kept as evidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.divergence import compare
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.layout import agent_name
from gamekeeper.core.outcome import failed, outcome_of
from gamekeeper.core.seeds import episode_seed
from gamekeeper.diagnose.diagnosis import Parting
from gamekeeper.diagnose.remedies import Remedy
from gamekeeper.diagnose.setup import Setup
from gamekeeper.diagnose.stage import Stage
from gamekeeper.game.faces import game_of
from gamekeeper.record.recorder import Recorder
from gamekeeper.run.changes.reenacted import Reenacted
from gamekeeper.run.episode import Played
from gamekeeper.run.play import play

MOST: Final = 3
"""Failing episodes of a run that are compared with their twins."""
KEPT: Final = 8
"""Episodes of each arm that a bundle keeps."""


def partings(
    evidence: Evidence,
    setup: Setup,
    remedies: Sequence[Remedy],
    *,
    contract: Contract,
    conditions: Mapping[str, Failure],
    scope: str,
) -> Iterator[Parting]:
    """Where failing episodes of the run and their twins under each remedy part.

    Both are played anew from the recorded seeds, with the policies' recorded streams.
    """
    run_seed = evidence.manifest.get("seed")
    if run_seed is None or not remedies:
        return
    failing = [
        trace.episode
        for trace in evidence.traces
        if trace.seed == episode_seed(run_seed, trace.episode)
        and failed(outcome_of(trace), conditions, contract).get(scope)
    ][:MOST]
    volatile = contract.volatile_infos()
    with Stage(setup, contract) as base:
        bases = {k: base.played(run_seed, k) for k in failing}
    for remedy in remedies:
        with Stage(remedy.applied(setup), contract) as twin:
            for episode, played in bases.items():
                other = twin.played(run_seed, episode).trace
                open_ = twin.played(run_seed, episode, change=_others_as(played, remedy)).trace
                found = compare(played.trace, other, volatile=volatile).divergence
                fails = [
                    failed(outcome_of(trace), conditions, contract)
                    for trace in (played.trace, other, open_)
                ]
                yield Parting(
                    episode, remedy.name,
                    turn=None if found is None else found.turn,
                    agent=None if found is None else found.agent,
                    field=None if found is None else found.field,
                    failed=fails[0].get(scope, False),
                    restored=not fails[1].get(scope, False),
                    restored_open=not fails[2].get(scope, False),
                )  # fmt: skip


def _others_as(played: Played, remedy: Remedy) -> Reenacted:
    """Only those whom the remedy concerns choose; the others do what they did."""
    paper = tuple(
        {agent_name(a): act for a, act in turn.items()} for turn in played.play.actions or ()
    )
    return Reenacted(free=remedy.agents, paper=paper)


def keep(setup: Setup, folder: Path, *, contract: Contract, run_seed: int) -> str:
    """Records the first episodes of an arm into a bundle; its fingerprint.

    A change is no part of a bundle: what policies were shown or had done otherwise stands in its
    actions, which replay.
    """
    with Stage(setup, contract) as stage:
        sink = Recorder(
            folder, environment=stage.opened.identity, contract=contract, run_seed=run_seed,
            terms=tuple(contract.rewards), volatile=contract.volatile_infos(),
        )  # fmt: skip
        try:
            game = game_of(stage.env, sink=sink)
            game.policies = stage.described
            for episode in range(KEPT):
                options = setup.options[episode % len(setup.options)]
                play(
                    game, stage.cast, [episode], seed=run_seed, options=options,
                    most_turns=setup.most_turns,
                )  # fmt: skip
        finally:
            sink.close()
    return str(folder)
