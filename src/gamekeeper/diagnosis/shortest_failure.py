"""A failing episode cut down to the fewest turns and actions that still fail in the same way."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import evidence_to_play, recorder_of
from gamekeeper.diagnosis.plain_data import PlainData
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import TEAM, failed, failures
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.identity import spec_of
from gamekeeper.interface.opening import Opened, open_env, reopen
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.episode_loop import Actions, EpisodeLoop, EpisodePlan, perform
from gamekeeper.rollouts.intervention import Hooks
from gamekeeper.rollouts.reruns import play_of, shrink
from gamekeeper.rollouts.tally import tally
from gamekeeper.runs.consent import consented

TRIES: Final = 2_000
"""Plays that the search may take unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Shrunk(PlainData):
    """The shortest failing play that was found.

    Attributes:
        episode: of the run.
        scope: for whom it fails.
        endings: how agents end in it, as in the whole episode.
        turns: how many it has, of how many: (left, before).
        acts: actions that aren't the agent's noop, likewise.
        tries: plays that were looked at.
        is_least: the search ended by itself: leaving out any one turn would no longer fail.
        actions: turn by turn.
        seed: of its reset.
    """

    episode: int
    scope: str
    endings: Mapping[str, str]
    turns: tuple[int, int]
    acts: tuple[int, int]
    tries: int
    is_least: bool
    actions: tuple[Actions, ...]
    seed: int | None

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: x for name, x in PlainData.to_json(self).items() if name != "actions"}


def shrunk(
    run: str | PathLike[str] | Evidence,
    episode: int,
    *,
    failed: str | None = None,
    scope: str | None = None,
    contract: Contract | None = None,
    env: object | None = None,
    out: str | PathLike[str] | None = None,
    allow_import: bool = False,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Shrunk:
    """The shortest play found in which a failing episode still fails, and ends in the same way.

    Turns are left out, then actions become noops where one is declared. A shorter play counts only
    if it comes to an end by itself and agents of the scope end for the same reasons: that nothing
    was delivered after no turn at all is no failure.

    Args:
        run: the folder of a run, or evidence.
        episode: a failing one.
        failed: the condition under which an episode failed; else the contract's.
        scope: for whom it fails; None: the first for whom it does, the team before others.
        contract: in place of the one of the recording.
        env: opened in place of what the evidence names, with the recorded arguments.
        out: the folder of a run with the shortest play, which replays.
        allow_import: run code that the evidence names.
        on_message: called with `{"episode", "episodes"}` as plays are tried.
    Raises:
        EvidenceError: the episode isn't there, or doesn't fail when it is played again.
        TrustError: the evidence names code that nobody allowed to run.
        ContractError: nothing says when an episode failed.
    """
    evidence = evidence_to_play(run, env=env, allow_import=allow_import)
    declared = evidence.contract if contract is None else contract
    with (
        consented(evidence, doing="playing this run again", env=env, allow_import=allow_import),
        closing((opened := _opened(evidence, env)).env),
    ):
        search = _Search(evidence, episode, declared, failed, scope, opened.env, on_message)
        play = shrink(search.play, search.still, plain=search.noops)
        play = perform(play, opened.env, contract=declared).play  # with a whole script
        found = search.result(play, episode)
        if out is not None:
            _keep(opened, play, Path(out), declared)
    return found


class _Search:
    """Asks of each shorter play whether it still fails in the same way."""

    def __init__(
        self,
        evidence: Evidence,
        episode: int,
        contract: Contract,
        condition: str | None,
        scope: str | None,
        env: Any,
        on_message: Callable[[dict[str, Any]], None] | None,
    ) -> None:
        recorded = evidence.episode(episode)
        self._contract, self._env, self._left = contract, env, TRIES
        self._conditions = failures(contract, condition, evidence.episodes)
        env.reset(seed=0)
        self.play = play_of(recorded, env, evidence.manifest.get("action_types"))
        whole = tally(self.play, env, contract=contract)
        told = failed(whole, self._conditions, contract)
        failing = [each for each in sorted(told, key=lambda each: each != TEAM) if told[each]]
        if not failing or (scope is not None and scope not in failing):
            raise EvidenceError(
                f"episode {episode} doesn't fail when it is played again"
                + ("" if scope is None else f" for {scope}"),
                where=evidence.name,
                expected="a failing episode",
                actual=", ".join(f"{each}: {bad}" for each, bad in told.items()),
                fix="`gamekeeper replay` says whether the run replays at all",
            )
        self.scope, self.whole = scope or failing[0], whole
        agents = getattr(env, "possible_agents", ())
        found = {agent: contract.noop_of(agent) for agent in agents}
        self.noops = {agent: noop for agent, noop in found.items() if noop is not None}
        self.on_message = on_message

    def still(self, play: EpisodePlan) -> bool:
        """Tells whether a shorter episode fails too, and ends as the whole one does."""
        if self._left <= 0:
            return False
        self._left -= 1
        if self.on_message is not None:
            self.on_message({"episode": TRIES - self._left, "episodes": TRIES})
        outcome = tally(play, self._env, contract=self._contract)
        return (
            outcome.is_over == self.whole.is_over
            and outcome.error == self.whole.error
            and outcome.endings == self.whole.endings
            and failed(outcome, self._conditions, self._contract).get(self.scope, False)
        )

    def result(self, play: EpisodePlan, episode: int) -> Shrunk:
        """The shortest play, beside the whole one."""
        short, long = play.actions or (), self.play.actions or ()
        return Shrunk(
            episode,
            self.scope,
            dict(self.whole.endings),
            turns=(len(short), len(long)),
            acts=(self._acts(short), self._acts(long)),
            tries=TRIES - self._left,
            is_least=self._left > 0,
            actions=short,
            seed=play.seed,
        )

    def _acts(self, actions: Sequence[Actions]) -> int:
        """Actions that are no noops; where none is declared, all of them."""
        return sum(
            action is not None and not _is_same(action, self.noops.get(agent))
            for turn in actions
            for agent, action in turn.items()
        )


def _is_same(action: Any, noop: Any) -> bool:
    return noop is not None and bool(getattr(action, "shape", ()) == () and action == noop)


def _opened(evidence: Evidence, env: object | None) -> Opened:
    identity = evidence.manifest["environment"]
    if env is not None:
        return open_env(env, **(identity.get("kwargs") or {}))
    spec_of(identity)  # says what to do where it was an object in memory
    return reopen(identity)


def _keep(opened: Opened, play: EpisodePlan, folder: Path, contract: Contract) -> None:
    """Records an episode into a run."""
    with closing(recorder_of(opened, folder, contract)) as sink:
        capture = capture_of(opened.env, sink=sink)
        EpisodeLoop(play, capture, None, Hooks(), None, lambda: None, contract).run()
        capture.end_episode()
