"""Replays recorded episodes in one environment, and looks for the cause of a divergence."""

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from itertools import takewhile
from pathlib import Path
from typing import Any, Final, TypeAlias

import pyarrow.compute as pc

from gamekeeper.episodes.canonical import from_json, is_exact
from gamekeeper.episodes.chunks import EpisodeChunks, RowReader
from gamekeeper.episodes.divergence import Comparison, Divergence
from gamekeeper.episodes.encoder import KEPT
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.evidence import NO_STEPS, Evidence, manifest_of
from gamekeeper.episodes.tables import MemoryTables
from gamekeeper.episodes.where import Where
from gamekeeper.errors import EvidenceError, SpecError
from gamekeeper.interface.aec_capture import AECCapture
from gamekeeper.interface.env_source import Opened
from gamekeeper.interface.opening import open_env, reopen
from gamekeeper.interface.parallel_capture import ParallelCapture
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.rollouts.episode_loop import ActionChooser
from gamekeeper.rollouts.memory import MemorySink
from gamekeeper.rollouts.process_randomness import states
from gamekeeper.rollouts.reruns import replayed_episode
from gamekeeper.rollouts.workers import run_task
from gamekeeper.runs.load_run import load
from gamekeeper.runs.reset_chain import chain_of

# -- An episode that is being replayed: recorded turns go out, replayed ones are compared behind

STREAMS: Final = ("agent_steps", "states")
CompareTurns: TypeAlias = Callable[[Episode, Episode], bool]
"""Compares the same turns, recorded and replayed; True to go on."""


class ReplayedEpisode:
    """A recorded episode that is being replayed, of which only some turns are in memory.

    Args:
        sink: takes what `capture` puts on the buffer.
        compare: gets every range of turns once it was replayed.
    """

    def __init__(
        self,
        recorded: EpisodeChunks,
        capture: ParallelCapture | AECCapture,
        sink: MemorySink,
        compare: CompareTurns | None = None,
    ) -> None:
        self._capture, self._sink, self._compare_turns = capture, sink, compare
        self._number = recorded.episode
        self._rows: dict[str, RowReader] = {}
        self._header: Mapping[str, Any] = {}
        self._spaces: Evidence | None = None
        self._stretches = recorded.stretches()
        self._behind: deque[tuple[Episode, int | None]] = deque()
        self._now = next(self._stretches)
        self._goes_on = True
        self.head = self._now[0]
        """The first turns, with the header of the whole episode."""

    def turns(self) -> Iterator[Turn]:
        """Yields the recorded turns in order; those before the one asked for were replayed."""
        while True:
            episode, before = self._now
            yield from episode.turns
            if before is None:  # the closing rows are still to be replayed
                return
            self._advance()
            self._compare(self._capture.turn)
            if not self._goes_on:
                return

    def finish(self, again: Evidence) -> None:
        """Compares what is left.

        Args:
            again: the rows that the sink still held when the episode was over, and its header.
        """
        self._header, self._spaces = next(again.headers), again
        for stream in STREAMS:
            for part in again.tables.parts(stream, self._number) or ():
                self._rows.setdefault(stream, RowReader()).add(part)
        while self._goes_on and self._now[1] is not None:
            self._advance()
            self._compare(None)
        self._behind.append(self._now)
        self._compare(None)

    def _advance(self) -> None:
        """Puts the turns that were handed out behind, to be compared, and takes the next ones."""
        self._behind.append(self._now)
        self._now = next(self._stretches)

    def _compare(self, played: int | None) -> None:
        """Compares the turns behind that have been replayed whole.

        Args:
            played: turns of it that are whole; None: it is over.
        """
        while self._goes_on and self._behind:
            episode, before = self._behind[0]
            if played is not None and (before is None or before > played):
                return
            self._behind.popleft()
            for stream, rows in self._sink.taken().items():
                self._rows.setdefault(stream, RowReader()).add(rows)
            known = self._known_spaces()
            again = EpisodeChunks(
                episode=self._number,
                header=self._header,
                spaces=known.spaces,
                state_codec=known.state_codec,
                steps=self._rows.get("agent_steps", RowReader()),
                states=self._rows.get("states"),
                empty=NO_STEPS,
            )
            self._goes_on = self._compare_turns is None or self._compare_turns(
                episode, again.take(before)
            )

    def _known_spaces(self) -> Evidence:
        """Evidence without rows that names the spaces of all agents there were by now."""
        layout, known = self._sink.layout, self._spaces
        manifest = {} if known is None else known.manifest
        has_state = manifest.get("state_space") is not None
        now = len(layout.order), layout.state is not None
        if known is None or now != (len(manifest["agents"]), has_state):
            manifest = manifest_of(
                environment={}, layout=layout, contract=None, level="full", run_seed=None
            )
            known = self._spaces = Evidence(manifest, MemoryTables({}))
        return known


# -- An environment opened again, in which recorded episodes are replayed


def opened_again(evidence: Evidence, env: str | None) -> Opened:
    """The environment that evidence names, or `env` in its place with the recorded arguments.

    Raises:
        SpecError: it can't be opened.
    """
    identity = evidence.manifest["environment"]
    if env is None:
        return reopen(identity)
    kwargs: Any = from_json(compact(identity.get("kwargs") or {}))
    return open_env(env, api=identity.get("api"), **kwargs)


def check_named(env: object) -> None:
    """Raises where `env`, which a process of its own has to open, is neither a text nor None.

    Raises:
        SpecError: it is an object or a callable.
    """
    if env is None or isinstance(env, str):
        return
    raise SpecError(
        "a recorded run is played again in a process of its own, which opens the environment by "
        "its name",
        where="env",
        expected="a text: an id, 'module:factory' or 'path/to/file.py:factory'",
        actual=f"{type(env).__module__}.{type(env).__qualname__}",
        fix="name where it is made; or record the object a second time with gk.record, and "
        "compare both runs with gk.diff",
    )


def compact(plain: object) -> str:
    """Plain JSON that was canonical text once, as that text."""
    return json.dumps(plain, separators=(",", ":"), ensure_ascii=False)


class _Unkept(MemorySink):
    """Drops frames: rendering them is part of the replay, keeping them isn't."""

    __slots__ = ()

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Drops a frame."""


class ReplayRunner:
    """Plays recorded episodes again in one environment, one after the other."""

    def __init__(
        self,
        evidence: Evidence,
        opened: Opened,
        *,
        after_turn: Callable[[], None] | None = None,
        sink: Any = None,
    ) -> None:
        """Sets up `opened` as it was set up for `evidence`; `sink` takes the rows, else memory."""
        self._evidence, self._opened, self._after_turn = evidence, opened, after_turn
        self._sink = sink or _Unkept(
            terms=tuple(evidence.manifest.get("terms") or ()),
            volatile=evidence.contract.volatile_infos(),
            prints=evidence.manifest.get("level"),
        )
        self.capture = capture_of(
            opened.env,
            sink=self._sink,
            frames=was_rendered(evidence),
            # at level actions witnesses cover the states of an environment that has any
            state=evidence.tables.has("states") or evidence.manifest.get("level") == KEPT,
        )

    def play(
        self,
        header: Mapping[str, Any],
        *,
        chooser: ActionChooser | None = None,
        compare: CompareTurns | None = None,
    ) -> Mapping[str, Any]:
        """The header of an episode, replayed: its actions, or those that `chooser` chooses.

        Args:
            compare: gets ranges of whole turns, recorded and replayed, as they come; True: go on.
        Raises:
            EvidenceError: an action was an object that no text can build again.
        """
        if chooser is None:
            _check_actions(self._evidence, header)
        episode = ReplayedEpisode(self._evidence.chunks(header), self.capture, self._sink, compare)
        self.replay(episode.head, chooser, episode.turns())
        again = self._kept()
        episode.finish(again)
        return next(again.headers)

    def compared(
        self,
        header: Mapping[str, Any],
        *,
        chooser: ActionChooser | None = None,
        tolerance: float | None = None,
    ) -> tuple[Comparison, Mapping[str, Any]]:
        """An episode replayed and compared with its recording, and the header of the replay.

        Raises:
            EvidenceError: an action was an object that no text can build again.
        """
        both = Comparison(
            self._evidence.extent(header),
            tolerance=tolerance,
            volatile=self._evidence.contract.volatile_infos(),
            is_kept=self._evidence.manifest.get("level") == KEPT,
        )
        again = self.play(header, chooser=chooser, compare=both.add)
        both.ends()
        return both, again

    def play_until(
        self, header: Mapping[str, Any], steps: int, *, chooser: ActionChooser | None = None
    ) -> Episode:
        """The first turns of an episode, replayed; the environment stands where they end.

        Args:
            steps: env steps to take.
            chooser: chooses actions in place of the recorded ones.
        Raises:
            EvidenceError: an action was an object that no text can build again.
        """
        _check_actions(self._evidence, header)
        episode = self._evidence.episode_of(header)
        self.replay(episode, chooser, takewhile(lambda turn: turn.index < steps, episode.turns))
        return self._kept().episodes[0]

    def replay(
        self,
        episode: Episode,
        chooser: ActionChooser | None = None,
        turns: Iterable[Turn] | None = None,
    ) -> None:
        """Plays turns of an episode again; None: all of them."""
        self.capture.episode = episode.episode - 1
        replayed_episode(
            episode,
            self.capture,
            agents={each.name: agent for agent, each in self._sink.layout.agents.items()},
            types=self._evidence.manifest.get("action_types"),
            joint_policy=chooser,
            run_seed=self._evidence.manifest.get("seed"),
            after_turn=self._after_turn,
            turns=turns,
        )

    def returned(self) -> tuple[Mapping[Any, Any], Mapping[Any, Any]]:
        """Observations and infos that the last step of a ParallelEnv returned; else empty."""
        if isinstance(self.capture, ParallelCapture):
            return self.capture.observations, self.capture.infos
        return {}, {}

    def manifest(self) -> Mapping[str, Any]:
        """The manifest of the replay."""
        return self._kept().manifest

    def close(self) -> None:
        """Closes the environment."""
        self.capture.close()

    def _kept(self) -> Evidence:
        """Evidence of the replay since the last call, but for rows that were taken off by then."""
        return self._sink.evidence(self._opened.identity, contract=self._evidence.contract)


def was_rendered(evidence: Evidence) -> bool:
    """True if frames were taken: render() may change observations (that of pistonball does)."""
    # the checksums name frames even where they were deleted since
    checksums = evidence.manifest.get("checksums") or {}
    if any(name.startswith("frames/") for name in checksums.get("files", ())):
        return True
    return evidence.path is not None and (Path(evidence.path) / "frames").is_dir()


def _check_actions(evidence: Evidence, header: Mapping[str, Any]) -> None:
    """Raises where an action can't be handed over again."""
    columns = ("turn", "agent", "nonconforming")
    for part in evidence.tables.parts("agent_steps", header["episode"], columns=columns) or ():
        for row in part.filter(pc.is_valid(part["nonconforming"])).to_pylist():
            action = json.loads(row["nonconforming"]).get("action", {})
            if "value" in action and not is_exact(compact(action["value"])):
                raise EvidenceError(
                    "an action was an object that no text can build again",
                    where=str(Where("", header["episode"], row["turn"], row["agent"], "action")),
                    actual=compact(action["value"])[:200],
                    fix="act with values of the action space",
                )


# -- Why a replay diverged: the episode is played a few times more, each in a process of its own

TASK: Final = "gamekeeper.runs.replay_runner:play_task"
IN_MEMORY: Final = ("object", "factory")
GENERATORS: Final = ("random", "numpy.random")


def cause_of(
    evidence: Evidence,
    where: Divergence,
    *,
    env: str | None,
    changed: Mapping[str, Any],
    timeout_s: float | None,
) -> str | None:
    """Cause of the divergence at `where`, as a sentence; None where it can't be found.

    The diverging episode is played twice under one hash seed, once under another, and once without
    the episodes before it that it needn't run on from.

    Args:
        env: opened in place of the environment that the evidence names.
        changed: versions and sources that aren't those of the recording.
        timeout_s: longest time without a turn.
    """
    header = evidence.header(where.episode)
    known = frozenset(evidence.episode_table["episode"].to_pylist())
    since = chain_of(header, known).start

    def played(*, first: int, hash_seed: int) -> dict[str, Any] | None:
        arguments = {"path": str(evidence.path), "env": env, "first": first, "last": where.episode}
        outcome = run_task(TASK, arguments, silence_s=timeout_s, hash_seed=hash_seed)
        return outcome.value if isinstance(outcome.value, dict) else None

    one, two = played(first=since, hash_seed=1), played(first=since, hash_seed=1)
    if one is None or two is None:
        return None
    if one["prints"] != two["prints"]:
        return _irreproducible(one["drew"])
    other = played(first=since, hash_seed=2)
    if other is not None and other["prints"] != one["prints"]:
        return (
            "the environment depends on Python's hash seed: it iterates over a set, or calls "
            "hash(), where the order matters; sort it, or set PYTHONHASHSEED for both runs"
        )
    after = played(first=0, hash_seed=1) if since else None
    leaks = after is not None and after["prints"] != one["prints"]
    other_source = _other_source(evidence, env, one.get("entry_point"), changed)
    if leaks:
        return _leak(where.episode, known, other_source)
    return other_source or (
        "every replay comes out the same, but not as recorded: the recording depended on something "
        "outside it (what was played before, files, the machine)"
    )


def _irreproducible(drew: list[str]) -> str:
    what = "the environment isn't reproducible: two replays of the same seed and actions differ"
    if drew:
        names = " and ".join(drew)
        return f"{what}; it draws from the global generator {names}, which its reset doesn't seed"
    return (
        f"{what}; it depends on something outside (random numbers that reset doesn't seed, the "
        "clock, threads, memory addresses)"
    )


def _leak(episode: int, known: frozenset[int], other_source: str | None) -> str:
    """An episode that comes out otherwise after others; another source comes first as the cause."""
    what = (
        f"episode {episode} depends on what was played before it: the environment keeps something "
        "over a seeded reset"
    )
    if other_source is not None:
        return f"{other_source}; also, with the source as it is now, {what}"
    dropped = episode - sum(each < episode for each in known)
    return f"{what}; the run dropped {dropped} of the episodes before it" if dropped else what


def _other_source(
    evidence: Evidence, env: str | None, entry_point: str | None, changed: Mapping[str, Any]
) -> str | None:
    """The environment that was replayed, where it isn't the recorded one; else None."""
    then = evidence.manifest["environment"]
    is_named = env is not None and then.get("kind") not in IN_MEMORY  # an object has no name
    ends = [str(each).rpartition(":")[2] for each in (then.get("entry_point"), entry_point)]
    is_spelled = ends[0] == ends[1] and "source" not in changed  # `a:Env` may be `a.py:Env`
    if is_named and then.get("entry_point") != entry_point and not is_spelled:
        return (
            f"the environment that was named isn't the recorded one: {then.get('entry_point')} was "
            f"recorded, {entry_point} replayed; replays of this episode agree with each other"
        )
    if changed:
        names = ", ".join("its source" if name == "source" else name for name in changed)
        return (
            f"the environment changed since the recording ({names}); replays of this episode "
            "agree with each other"
        )
    return None


def play_task(
    report: Callable[..., None], *, path: str, env: str | None, first: int, last: int
) -> dict[str, Any]:
    """Replays episodes `first` to `last` of a run.

    Returns:
        `prints`: the fingerprints of the last one; `drew`: the global generators that moved;
        `entry_point`: where the environment came from.
    """
    evidence = load(path)
    opened = opened_again(evidence, env)
    runner = ReplayRunner(evidence, opened, after_turn=report)
    before = states()
    header: Mapping[str, Any] = {}
    with closing(runner):
        for each in evidence.headers:
            if first <= each["episode"] <= last:
                header = runner.play(each)
    after = states()
    return {
        "prints": [header.get("fingerprint"), header.get("info_fingerprint")],
        "drew": [name for name in GENERATORS if before[name] != after[name]],
        "entry_point": opened.identity.get("entry_point"),
    }
