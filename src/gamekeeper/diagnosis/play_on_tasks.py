"""Tasks of playing on, in a worker process: both arms of futures, a recorded one, what may play."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import (
    OpenSetup,
    Setup,
    recorded_episode_of,
    recorder_of,
    traits_of,
)
from gamekeeper.diagnosis.plain_data import frozen
from gamekeeper.diagnosis.play_on import BUDGET, BranchPoint
from gamekeeper.episodes.agent_spec import as_action
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import Outcome, failed
from gamekeeper.errors import ActionError, EvidenceError, GamekeeperError
from gamekeeper.interface.action_mask import reader
from gamekeeper.interface.legality import allows
from gamekeeper.rollouts.continuations import Continuations, RecordedEpisode
from gamekeeper.runs.load_run import load
from gamekeeper.runs.replay_runner import ReplayRunner

POINTS: Final = 120
"""Most points of a future's path."""

Played = list[tuple[Outcome, list[float]]]
"""Outcomes of futures, each with its path."""


def play_on_task(
    report: Callable[..., None],
    *,
    kind: str,
    run: str,
    setup: Mapping[str, Any],
    contract: Any,
    branch: Mapping[str, Any],
    **extra: Any,
) -> dict[str, Any]:
    """Offers what may play on, plays futures or records one, in this process.

    Args:
        kind: `offers`, `futures` or `record`.
        extra: arguments of that.
    """
    point, declared, evidence = BranchPoint(**branch), Contract.from_json(contract), load(run)
    chosen = Setup.from_json(setup)
    if kind == "record" and point.policy is not None:
        chosen = chosen.with_policy(point.agent, point.policy)
    try:
        with OpenSetup(chosen, declared) as open_setup:
            if kind == "offers":
                answer: dict[str, Any] = {"ways": list(traits_of(open_setup, {}).ways)}
            elif kind == "futures":
                answer = _futures(evidence, open_setup, point, report, **extra)
            else:
                answer = _recorded(evidence, open_setup, point, report, **extra)
    except GamekeeperError as error:
        return {"error": error.to_json()}
    return {"error": None, **answer}


def _futures(
    evidence: Evidence,
    open_setup: OpenSetup,
    point: BranchPoint,
    report: Callable[..., None],
    *,
    numbers: Sequence[int],
    budget: int,
) -> dict[str, Any]:
    """Plays both arms; `report` hears of each future."""
    play = Continuations(
        recorded_episode_of(evidence, open_setup, point.episode), budget=budget, on_step=report
    )
    held, base = _held(play, point)
    found: Played = []
    for each in play.paths(point.turn, numbers, held=base):
        found.append(each)
        report(played=len(found), of=2 * len(numbers))
    steps = play.steps
    other = play if point.policy is None else _other(evidence, open_setup, point, budget, report)
    other.steps, other.budget = 0, max(budget - steps, 1)
    changed: Played = []
    for each in other.paths(point.turn, numbers[: len(found)], held=held):
        changed.append(each)
        report(played=len(found) + len(changed), of=2 * len(numbers))
    if point.policy is not None:
        other.base.env.close()
    pairs = found[: len(changed)]  # as far as both were played
    arms = {"as_recorded": pairs, "changed": changed}
    told = {
        name: _arm(each, numbers, point.turn, open_setup.contract) for name, each in arms.items()
    }
    return {"steps": steps + other.steps, **told}


def _recorded(
    evidence: Evidence,
    open_setup: OpenSetup,
    point: BranchPoint,
    report: Callable[..., None],
    *,
    number: int | None,
    out: str,
) -> dict[str, Any]:
    """Records one future, and replays it."""
    episode, manifest = recorded_episode_of(evidence, open_setup, point.episode), evidence.manifest
    play = Continuations(episode, budget=BUDGET, copies=False, on_step=report)
    held, _ = _held(play, point)
    sink = recorder_of(
        open_setup.opened,
        out,
        open_setup.contract,
        run_seed=manifest.get("seed"),
        contract=open_setup.contract if manifest.get("contract") else None,
        terms=tuple(manifest.get("terms") or ()),
        is_timed=False,
        extra={"played_on": {**asdict(point), "number": number, "root": evidence.root}},
    )
    with closing(sink):
        play.record(point.turn, sink, number=number, held=held)
    kept = load(out)
    header = kept.header(0)
    again = ReplayRunner(kept, open_setup.opened).play(header)
    return {"replays": again["fingerprint"] == header["fingerprint"]}


def _other(
    evidence: Evidence,
    open_setup: OpenSetup,
    point: BranchPoint,
    budget: int,
    report: Callable[..., None],
) -> Continuations:
    """Continuations in which the agent is played by the other policy; their environment is open."""
    changed = OpenSetup(
        open_setup.setup.with_policy(point.agent, point.policy), open_setup.contract
    )
    episode = recorded_episode_of(evidence, changed, point.episode)
    return Continuations(episode, budget=budget, on_step=report)


def _held(play: Continuations, point: BranchPoint) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """Actions at the turn as changed and as recorded; none where a policy is changed.

    Raises:
        EvidenceError: the agent doesn't act at that turn.
        ActionError: the action isn't legal.
    """
    episode, turn = play.base, point.turn
    recorded = dict(episode.actions[turn])
    agent = next((each for each in recorded if agent_name(each) == point.agent), None)
    if point.policy is not None:
        agents = {agent_name(agent) for turn in episode.actions for agent in turn}
        if point.agent in agents:
            return {}, {}
        raise EvidenceError(
            f"{point.agent} acts nowhere in this episode",
            where=f"episode {point.episode}",
            expected=", ".join(sorted(agents)),
            actual=point.agent,
            fix="choose one of these",
        )
    if agent is None or recorded[agent] is None:
        raise EvidenceError(
            f"{point.agent} doesn't act at turn {turn}",
            where=f"episode {point.episode}, turn {turn}",
            expected=", ".join(agent_name(a) for a, act in recorded.items() if act is not None),
            actual=point.agent,
            fix="choose one of these, or another turn",
        )
    action = _action(episode, agent, point, recorded[agent])
    observation, info = play.inputs(turn)[agent]
    mask = reader(episode.contract.mask_of(agent))(observation, info)
    if not allows(episode.env.action_space(agent), mask, action):
        raise _illegal(point, "an action that the mask allows")
    return {**recorded, agent: action}, recorded


def _action(episode: RecordedEpisode, agent: Any, point: BranchPoint, recorded: Any) -> Any:
    """The action in the space's types; a whole number is of the type that was recorded."""
    space = episode.env.action_space(agent)
    try:
        action = as_action(space, frozen(point.action))
    except (ValueError, TypeError) as error:
        raise _illegal(point, str(space)) from error
    is_number = isinstance(action, int | np.integer) and isinstance(recorded, int | np.integer)
    return type(recorded)(action) if is_number else action


def _illegal(point: BranchPoint, expected: str) -> ActionError:
    return ActionError(
        f"{point.agent} can't do this at turn {point.turn}",
        where=f"episode {point.episode}, turn {point.turn}",
        expected=expected,
        actual=str(point.action)[:200],
        fix="choose a legal action",
    )


def _arm(found: Played, numbers: Sequence[int], turn: int, contract: Contract) -> dict[str, Any]:
    """An arm as plain data."""
    outcomes = [outcome for outcome, _ in found]
    agents = list(dict.fromkeys(agent for each in outcomes for agent in each.returns))
    return {
        "numbers": list(numbers[: len(found)]),
        "returns": {a: [each.returns.get(a, 0.0) for each in outcomes] for a in agents},
        "turns": [each.turns for each in outcomes],
        "paths": [_thinned([*path, o.team_return], turn, o.turns) for o, path in found],
        "failed": _failed(outcomes, contract),
        "errors": [each.error for each in outcomes if each.error is not None],
    }


def _thinned(path: Sequence[float], turn: int, last: int) -> list[tuple[int, float]]:
    """A path of at most `POINTS` points, the first and the last among them."""
    places = np.unique(np.linspace(0, len(path) - 1, min(len(path), POINTS)).round().astype(int))
    return [(min(turn + int(k), last), float(f"{path[k]:.7g}")) for k in places]


def _failed(outcomes: Sequence[Outcome], contract: Contract) -> list[bool]:
    """Tells of each future if it failed by the contract; empty where that can't be said."""
    if not contract.failure:
        return []
    try:
        return [any(failed(each, contract.failure, contract).values()) for each in outcomes]
    except GamekeeperError:  # a condition names a figure that a future doesn't have
        return []
