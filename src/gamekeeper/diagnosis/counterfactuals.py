"""Counterfactuals of recorded episodes: compared, kept as evidence, and saved as a pytest case."""

import pprint
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper.contract import Contract
from gamekeeper.contract.failure import Failure
from gamekeeper.diagnosis.diagnosis_result import Counterfactual, Diagnosis
from gamekeeper.diagnosis.open_setup import OpenSetup, Setup, recorder_of
from gamekeeper.diagnosis.trials import IdealSubstitute
from gamekeeper.episodes.canonical.opaque import shown
from gamekeeper.episodes.divergence import Divergence, compare
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import failed, failures, outcome_of
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.episode_loop import EpisodeResult, play
from gamekeeper.rollouts.interventions.action_substitutes import Reenacted
from gamekeeper.rollouts.snapshots import is_same, snapshot
from gamekeeper.runs.load_run import load
from gamekeeper.runs.standing import choices_of

MOST: Final = 3
"""Failing episodes of a run that are compared with their counterfactuals."""
KEPT: Final = 8
"""Episodes of each arm that a run keeps."""
LEAST_ACTIONS: Final = 10
"""Actions in each of two episodes from which their shares are compared."""
MORE_OFTEN: Final = 0.2
"""Difference of an action's shares from which it is worth a sentence."""


def counterfactuals(
    evidence: Evidence,
    setup: Setup,
    substitutes: Sequence[IdealSubstitute],
    *,
    contract: Contract,
    conditions: Mapping[str, Failure],
    scope: str,
    most: int = MOST,
) -> Iterator[Counterfactual]:
    """First divergences of failing episodes from their counterfactuals, by ideal substitute.

    Both are played anew from the recorded seeds, with the policies' recorded streams: an episode
    as it was, and twice for each ideal substitute.
    """
    run_seed = evidence.manifest.get("seed")
    if run_seed is None or not substitutes or most < 1:
        return
    failing = [
        episode.episode
        for episode in evidence.episodes
        if episode.seed == episode_seed(run_seed, episode.episode)
        and failed(outcome_of(episode), conditions, contract).get(scope)
    ][:most]
    volatile = contract.volatile_infos()
    with OpenSetup(setup, contract) as base:
        bases = {k: base.played(run_seed, k) for k in failing}
    for substitute in substitutes:
        with OpenSetup(substitute.applied(setup), contract) as counterfactual:
            for episode, played in bases.items():
                ideal = counterfactual.played(run_seed, episode)
                other = ideal.episode
                script = tuple(  # of which only those whom it concerns choose otherwise
                    {agent_name(a): act for a, act in turn.items()}
                    for turn in played.play.actions or ()
                )
                others = Reenacted(free=_concerned(substitute), script=script)
                open_ = counterfactual.played(run_seed, episode, change=others).episode
                found = compare(played.episode, other, volatile=volatile).divergence
                fails = [
                    failed(outcome_of(episode), conditions, contract)
                    for episode in (played.episode, other, open_)
                ]
                place = _place(found, played, ideal, _concerned(substitute))
                yield Counterfactual(
                    episode,
                    substitute.name,
                    *place,
                    failed=fails[0].get(scope, False),
                    restored=not fails[1].get(scope, False),
                    restored_open=not fails[2].get(scope, False),
                    **_acted(place, (played, ideal), contract),
                )


def _concerned(substitute: IdealSubstitute) -> tuple[str, ...]:
    undo = substitute.undo
    return substitute.agents if undo is None else undo.agents


def _place(
    found: Divergence | None, played: EpisodeResult, ideal: EpisodeResult, first: Sequence[str]
) -> tuple[int | None, str | None, str | None]:
    """Turn, agent and field of the first action that differs, else of the first difference.

    Args:
        found: the first difference of any kind.
        first: agents whose actions are named before others' of the same turn.
    """
    pairs = zip(played.play.actions or (), ideal.play.actions or (), strict=False)
    for turn, (was, now) in enumerate(pairs):
        theirs = [a for a in was if a in now and not is_same(now[a], snapshot(was[a]))]
        names = sorted(map(agent_name, theirs), key=lambda name: name not in first)
        if names:
            return turn, names[0], "action"
    return (None, None, None) if found is None else (found.turn, found.agent, found.field)


def _acted(
    place: tuple[int | None, str | None, str | None],
    pair: tuple[EpisodeResult, EpisodeResult],
    contract: Contract,
) -> dict[str, Any]:
    """The two actions at the first one that differs, and the action that was done more often."""
    turn, agent, field = place
    if turn is None or agent is None or field != "action":
        return {}
    names = contract.scene.actions_of(contract.role_of(agent) or "")
    was, now = (
        {
            k: _action_text(act, names)
            for k, acts in enumerate(each.play.actions or ())
            for name, act in acts.items()
            if agent_name(name) == agent and act is not None
        }
        for each in pair
    )
    did, instead = was.get(turn), now.get(turn)
    if did is None or instead is None or did == instead:
        return {}
    counts = Counter(was.values()), Counter(now.values())
    shares = {text: (counts[0][text] / len(was), counts[1][text] / len(now)) for text in counts[0]}
    often, (before, after) = max(shares.items(), key=lambda each: each[1][0] - each[1][1])
    is_worth = min(len(was), len(now)) >= LEAST_ACTIONS and before - after >= MORE_OFTEN
    return {"did": did, "instead": instead, "often": [often, before, after] if is_worth else None}


def _action_text(action: Any, names: Sequence[str]) -> str:
    """An action by its declared name, its number in brackets; arrays rounded."""
    if isinstance(action, int | np.integer):
        return f"{names[int(action)]} ({action})" if 0 <= action < len(names) else str(action)
    if isinstance(action, np.ndarray) and action.dtype.kind == "f":
        action = np.round(action.astype(np.float64), 3) + 0.0  # no digits of float32, no -0.0
    return shown(action.tolist() if isinstance(action, np.ndarray) else action)


def keep(
    setup: Setup, folder: Path, *, contract: Contract, run_seed: int, episodes: int = KEPT
) -> str:
    """Records the first episodes of an arm into a run; its fingerprint.

    A change is no part of a run: what policies were shown or had done otherwise stands in its
    actions, which replay.
    """
    with (
        OpenSetup(setup, contract) as open_setup,
        closing(recorder_of(open_setup.opened, folder, contract, run_seed=run_seed)) as sink,
    ):
        capture = capture_of(open_setup.env, sink=sink)
        capture.policies = open_setup.described
        for episode in range(episodes):
            options = setup.options[episode % len(setup.options)]
            given: dict[str, Any] = {"options": options, "most_turns": setup.most_turns}
            play(capture, open_setup.joint_policy, [episode], seed=run_seed, **given)
    return str(folder)


_TEXT: Final = '''"""{title}

Diagnosed from the run {fingerprint}: {why}.
"""

from __future__ import annotations

from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.episodes.outcome import failed, failures, outcome_of

SEED = {seed}
EPISODES = {episodes}
CONDITION = {condition}
SCOPE = {scope!r}
ARMS: dict[str, dict[str, Any]] = {arms}


def failing(arm: str) -> int:
    """Number of episodes of an arm that fail."""
    evidence = gk.rollout(episodes=EPISODES, seed=SEED, **ARMS[arm])
    conditions = failures(evidence.contract, CONDITION)
    outcomes = map(outcome_of, evidence.episodes)
    told = [failed(each, conditions, evidence.contract) for each in outcomes]
    return sum(each[SCOPE] for each in told)


def test_failure_is_there_as_it_is() -> None:
    """As it is, {failed_as_is} of {episodes} episodes failed when this was diagnosed."""
    assert failing("as it is") >= {least}


@pytest.mark.parametrize("arm", [arm for arm in ARMS if arm != "as it is"])
def test_ideal_substitute_restores(arm: str) -> None:
    """With the ideal substitute, fewer than half of those fail."""
    assert failing(arm) <= {most}
'''


def case_text(diagnosis: Diagnosis, run: str | PathLike[str], *, failed: str | None = None) -> str:
    """A test file that plays the failure and its ideal substitutes again, on the confirmed seeds.

    Args:
        diagnosis: has runs of what restores, from `diagnose(..., out=...)`.
        run: the folder of the run.
        failed: the condition that was given.
    Raises:
        EvidenceError: no ideal substitute restores, so there is nothing to hold on to.
    """
    kinds = {each.intervention: each.kind for one in diagnosis.answers for each in one.tested}
    playable = {
        arm: folder for arm, folder in diagnosis.runs.items() if kinds.get(arm) != "undo"
    }  # a rollout's arguments can't say an undo
    if len(playable) < 2:
        raise EvidenceError(
            "no ideal substitute restores, so there is no case to save",
            where="--save-case",
            expected="a named cause",
            actual="none",
            fix="declare more knobs in the contract, or play more episodes (--episodes)",
        )
    found = next(each for each in diagnosis.answers if each.substitutes)
    runs = {arm: load(folder) for arm, folder in playable.items()}
    base, *others = runs
    names = {base: "as it is", **{arm: arm for arm in others}}
    arms = {names[arm]: _arguments(evidence) for arm, evidence in runs.items()}
    counts = [_failing(evidence, failed, found.scope) for evidence in runs.values()]
    return _TEXT.format(
        title=_words(f"{' and '.join(found.labels).capitalize()}: a failure that was diagnosed."),
        fingerprint=_words(diagnosis.fingerprint[:16]),
        why=_words(found.why),
        seed=runs[base].manifest["seed"],
        episodes=runs[base].episode_table.num_rows,
        condition=repr(failed) if failed else "None",
        scope=found.scope,
        arms=pprint.pformat(arms, width=96, sort_dicts=False),
        failed_as_is=counts[0],
        least=max(counts[0] // 2, 1),
        most=max((counts[0] - 1) // 2, max(counts[1:])),
    )


def _arguments(evidence: Evidence) -> dict[str, Any]:
    identity = evidence.manifest["environment"]
    return {
        "spec": f"{identity['api']}:{identity['entry_point']}",
        "env_kwargs": identity.get("kwargs") or {},
        "policies": choices_of(evidence),
    }


def _failing(evidence: Evidence, condition: str | None, scope: str) -> int:
    contract, outcomes = evidence.contract, map(outcome_of, evidence.episodes)
    conditions = failures(contract, condition)
    return sum(failed(each, conditions, contract).get(scope, False) for each in outcomes)


def _words(text: str) -> str:
    """Words for a docstring: whatever they are, they don't end it, and stay on their line."""
    plain = "".join(sign if sign.isprintable() else " " for sign in text)
    return plain.replace("\\", "\\\\").replace('"', "'")
