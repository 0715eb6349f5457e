"""A recording by many workers, wherever they are: parts, then one run."""

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from threading import Lock
from typing import Any, Final

from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EnvError, EvidenceError, GamekeeperError, RunError
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import (
    USUAL,
    Done,
    Executor,
    Limits,
    WorkTask,
    stopped_after,
)
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.rollouts.workers import TaskOutcome, run_task
from gamekeeper.runs.files.folder import refuse_taken, system_error
from gamekeeper.runs.load_run import load
from gamekeeper.runs.parts.part_plan import claim, found_merged, key_of, parts_folder, release
from gamekeeper.runs.parts.receipts import Receipt, forget, receipt_of, receipts_of, whole_keys
from gamekeeper.runs.worker_errors import error_in, error_of
from gamekeeper.terminal import say

# -- The parts of a plan while they are played: wanted yet, whole, failed

PLAY: Final = "gamekeeper.runs.parts.part_tasks:part_task"
REMAINS: Final = "gamekeeper.runs.parts.part_tasks:remains_task"
AGAIN: Final = "gamekeeper.runs.parts.part_tasks:again_task"
NEVER: Final = 1 << 62


@dataclass(slots=True)
class PartProgress:
    """The bookkeeping of one recording by workers.

    Attributes:
        whole: summaries of the parts that have a receipt, by their keys.
        errors: errors that parts ended with, by their first episode.
        deaths: number of times that a worker process died, and its task was played again.
    """

    plan: RolloutPlan
    storage: Storage
    on_message: Callable[[dict[str, Any]], None]
    whole: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    errors: dict[int, GamekeeperError] = field(default_factory=dict)
    deaths: int = 0
    _killed: dict[int, tuple[range, str | None]] = field(default_factory=dict)
    _episodes: int = 0
    _turns: int = 0
    _begun: dict[str, range] = field(default_factory=dict)
    _now: dict[str, dict[str, int]] = field(default_factory=dict)
    _lock: Any = field(default_factory=Lock)

    @property
    def stop(self) -> int:
        """The first episode of the first part that failed; those after it aren't begun."""
        return min(self.errors, default=NEVER)

    def take_whole_parts(self) -> None:
        """Takes the parts that are in storage already.

        Raises:
            RunError: a receipt can't be read.
        """
        keys = whole_keys(self.storage)
        ranges = [each for each in self.plan.ranges() if key_of(each) in keys]
        found = receipts_of(self.storage, map(key_of, ranges))
        for episodes, receipt in zip(ranges, found, strict=True):
            if receipt is not None:
                self._take_receipt(episodes, receipt)
        self._say()

    def tasks(self) -> Iterator[WorkTask]:
        """Yields the parts that are wanted yet, in their order; asked for as workers get free."""
        given = {"storage": self.storage.place, "plan": self.plan.to_json()}
        for episodes in self.plan.ranges():
            key = key_of(episodes)
            if episodes.start > self.stop:
                return
            if key in self.whole:
                continue
            self._begun[key] = episodes
            yield WorkTask(key, PLAY, {**given, "first": episodes.start, "stop": episodes.stop})

    def take(self, key: str, fields: Mapping[str, Any]) -> None:
        """Takes a report of the progress of a part."""
        progress = {name: fields[name] for name in ("episode", "turns") if name in fields}
        with self._lock:
            self._now.setdefault(key, {}).update(progress)
        self._say()

    def end(self, done: Done) -> None:
        """Takes the end of a task.

        Raises:
            RunError: its part isn't in storage.
            WorkerFault: the task itself is broken.
            KeyboardInterrupt: it was interrupted.
        """
        episodes = self._begun.pop(done.key)
        with self._lock:
            self._now.pop(done.key, None)
        self.deaths += done.attempts - 1
        error = error_in(done.outcome)
        value: Any = done.outcome.value
        if error is None and value["failed"]:  # its receipt has the error
            receipt = receipt_of(self.storage, done.key)
            if receipt is None:
                raise lost(self.storage, done.key)
            self._take_receipt(episodes, receipt)
        elif error is None:
            self._count(episodes, value)
        else:
            if done.outcome.status != "done":
                self._killed[episodes.start] = episodes, done.outcome.traceback
            self.errors[episodes.start] = error
        self._say()

    def forget(self, keys: Collection[str]) -> None:
        """Forgets damaged parts, which are to be played again.

        Raises:
            RunError: the storage refuses.
        """
        for episodes in self.plan.ranges():
            if key_of(episodes) in keys:
                forget(self.storage, key_of(episodes))
                summary = self.whole.pop(key_of(episodes))
                self._episodes -= summary["episodes"]
                self._turns -= summary["turns"]
                self.errors.pop(episodes.start, None)
        self._say()

    def first_error(self) -> GamekeeperError | None:
        """The error of the first part that failed; None where none did."""
        return self.errors.get(self.stop)

    def ended_by(self) -> str | None:
        """Finalizes the part that ended the run; its error as a text, if no such part is left.

        Raises:
            GamekeeperError: it wasn't the environment that failed; or nothing of it is left.
        """
        error = self.first_error()
        stopped = next((each for each in self.plan.ranges() if each.start == self.stop), None)
        if error is None or stopped is None or key_of(stopped) in self.whole:
            return None
        if not isinstance(error, EnvError):
            raise error
        if self.stop in self._killed and self._finalize_remains(error):
            return None
        if self.stop == 0:
            raise error
        return f"{error.what}: {error.actual}".removesuffix(": ")

    def kept(self) -> int:
        """Number of parts that one process would have recorded: up to the first that failed."""
        return sum(
            1
            for each in self.plan.ranges()
            if each.start < self.stop or (each.start == self.stop and key_of(each) in self.whole)
        )

    def _finalize_remains(self, error: GamekeeperError) -> bool:
        """Finalizes a part whose every attempt was killed; True if anything is left of it."""
        episodes, stack = self._killed[self.stop]
        outcome = run_task(
            REMAINS,
            {
                "storage": self.storage.place,
                "first": episodes.start,
                "stop": episodes.stop,
                "error": error.to_json(),
                "stack": stack,
            },
            silence_s=None,
        )
        found = error_in(outcome)
        if found is not None:
            raise found
        value: Any = outcome.value
        if not value["failed"]:
            raise RunError(
                "a worker ended just after its part was whole",
                where=f"{self.storage}, {key_of(episodes)}",
                actual=error.actual,
                fix="repeat the same command: it goes on from there",
            )
        if value["episodes"]:
            self._count(episodes, value)
        return bool(value["episodes"])

    def _take_receipt(self, episodes: range, receipt: Receipt) -> None:
        self._count(episodes, receipt.summary())
        if receipt.error is not None:
            self.errors[episodes.start] = error_of(receipt.error)

    def _count(self, episodes: range, summary: Mapping[str, Any]) -> None:
        self.whole[key_of(episodes)] = summary
        self._episodes += summary["episodes"]
        self._turns += summary["turns"]

    def _say(self) -> None:
        with self._lock:
            now = list(self._now.values())
        self.on_message(
            {
                "episode": self._episodes + sum(each.get("episode", 0) for each in now),
                "episodes": self.plan.episodes,
                "turns": self._turns + sum(each.get("turns", 0) for each in now),
            }
        )


def lost(storage: Storage, key: str) -> RunError:
    """The error of a part that its worker finished, and that isn't where this machine looks."""
    return RunError(
        "a part isn't in storage, though its worker put it there",
        where=f"{storage}, {key}",
        fix="workers on other machines need storage that all of them reach: --storage with a "
        "shared folder or a URL",
    )


# -- A recording played by workers, wherever they are: parts, then one run
#
# The run is the one that a single process would have recorded, as far as the environment begins
# every episode afresh: each part has an environment of its own. Where an episode fails, those after
# it don't count, as they would not have been played. A part that is whole isn't played again,
# unless it turns out to be damaged when it is merged, as after a power cut.

MERGE: Final = "gamekeeper.runs.parts.part_tasks:merge_task"
CHECKED: Final = 8
"""Episodes of a run from which on it is tried that one doesn't depend on those before it."""

OnMessage = Callable[[dict[str, Any]], None]


@dataclass(frozen=True, slots=True)
class FanOut:
    """Outcome of a recording by workers.

    Attributes:
        error: of the first episode that failed; None where none did.
        parts: number of parts in the run.
        found: number of them that were there before.
        deaths: number of times that a worker process died, and its task was played again.
        torn: number of parts that were damaged, and were played again.
        depends: an episode that comes out otherwise after those before it than by itself; None:
            the one that was tried doesn't, or none was.
    """

    error: GamekeeperError | None
    parts: int
    found: int
    deaths: int
    torn: int
    depends: int | None = None

    @property
    def note(self) -> str | None:
        """The dependence of an episode in words, and the command that looks for its cause."""
        if self.depends is None:
            return None
        return (
            f"episode {self.depends} comes out otherwise after the episodes before it than by "
            "itself: one process would record another run; the environment or a policy keeps "
            "something over its reset, or draws without its seed (gamekeeper audit ENV --select "
            "GK604 tells of the environment)"
        )


def record_apart(
    plan: RolloutPlan,
    out: Path,
    *,
    executor: Executor,
    storage: Storage,
    limits: Limits = USUAL,
    on_message: OnMessage = lambda fields: None,
) -> FanOut:
    """Records a plan into the run `out`, by tasks that write their parts to `storage`.

    Stopped at any moment (also by Ctrl-C), the parts that are whole stay, and the same call goes on
    from them. Once the run is finalized they are gone; stopped in between, the same call takes them
    away, and leaves the run as it is.

    Args:
        out: a folder that doesn't exist yet, or is empty, on this machine.
        executor: plays the parts; a process of this machine merges them, one of the executor's
            where it is local.
        limits: of each task.
        on_message: called with `episode`, `episodes`, `turns` of all parts together, and with
            `merged` and `parts` once all are played.
    Raises:
        RunError: `out` or `storage` holds something else, or can't be written.
        GamekeeperError: nothing could be recorded, or a policy went wrong.
        WorkerFault: a task of ours is broken.
        KeyboardInterrupt: by Ctrl-C.
    """
    merged = found_merged(storage, plan, out)
    if merged is not None:
        release(storage)
        return FanOut(merged.error, merged.parts, found=merged.parts, deaths=0, torn=0)
    _check_free(out)
    executor.check_storage(storage.place)
    playing = PartProgress(plan, storage, on_message)
    if claim(storage, plan):
        playing.take_whole_parts()
    found, torn = len(playing.whole), 0
    try:
        while True:
            answers = executor.map(playing.tasks(), limits=limits, on_report=playing.take)
            with stopped_after(answers) as ends:
                for done in ends:
                    playing.end(done)
            damaged, error = _merge(playing, executor, out)
            if error is None:
                break
            if torn or not damaged:  # damaged again: it is no power cut that does this
                raise error
            torn = len(damaged)
            playing.forget(damaged)
    except GamekeeperError:
        if not playing.whole:  # nothing to go on from: the fixed command mustn't be refused
            release(storage)
        raise
    depends, parts = _dependence(playing, executor, out, limits), playing.kept()
    release(storage)
    found = max(min(found, parts) - torn, 0)
    return FanOut(playing.first_error(), parts, found, playing.deaths, torn, depends)


def _dependence(playing: PartProgress, executor: Executor, out: Path, limits: Limits) -> int | None:
    """An episode that comes out otherwise after those before it than by itself.

    One that was recorded after others of its part is played again by itself; where each part is one
    episode, the second is played after the first.
    """
    plan = playing.plan
    first = next(plan.ranges(), range(0))
    last = max(first.stop - 1, 1)
    is_wanted = plan.check and plan.level == "full" and not plan.frames
    if not is_wanted or plan.episodes < CHECKED or last >= playing.stop:
        return None
    begin = last if len(first) > 1 else 0
    arguments = {"plan": plan.to_json(), "first": begin, "stop": last + 1}
    found = _by_one(executor, AGAIN, arguments, limits, lambda _: None).value
    recorded = load(out, check=False).header(last)["fingerprint"]
    return last if isinstance(found, str) and found != recorded else None


def _merge(
    playing: PartProgress, executor: Executor, out: Path
) -> tuple[list[str], GamekeeperError | None]:
    """Merges the parts into the run, in another process: no evidence comes through this one.

    Returns:
        The keys of the parts that are damaged, and the error that prevented it.
    """
    reason, parts, first = playing.ended_by(), playing.kept(), playing.first_error()

    def take(fields: dict[str, Any]) -> None:
        playing.on_message({"merged": fields["merged"], "parts": parts})

    arguments = {
        "storage": playing.storage.place,
        "plan": playing.plan.to_json(),
        "out": str(out.absolute()),
        "parts": parts,
        "error": reason,
        "ended": None if first is None else first.to_json(),
    }
    outcome = _by_one(executor, MERGE, arguments, Limits(silence_s=None), take)
    if outcome.status in ("died", "hung"):  # it may have died with its work done
        if found_merged(playing.storage, playing.plan, out) is not None:
            return [], None
        return [], RunError(
            "the process that merges the parts ended",
            where=str(out),
            actual=outcome.error or "",
            fix="the parts are whole: the same command merges them",
        )
    error, value = error_in(outcome), outcome.value
    return (value["torn"] if isinstance(value, dict) else []), error


def _by_one(
    executor: Executor, function: str, arguments: dict[str, Any], limits: Limits, take: OnMessage
) -> TaskOutcome:
    """Outcome of a task of a process of this machine; one that played has imported it all."""
    if not isinstance(executor, LocalExecutor):
        return run_task(function, arguments, silence_s=limits.silence_s, on_message=take)
    task = WorkTask("one", function, arguments)
    once = replace(limits, attempts=1)
    answers = executor.map([task], limits=once, on_report=lambda key, fields: take(fields))
    with stopped_after(answers) as ends:
        (done,) = ends
    return done.outcome


def _check_free(out: Path) -> None:
    """Raises if a run can't be put there, before anything is played.

    Raises:
        RunError: something lies there.
    """
    if os.path.ismount(out):  # Path's own doesn't know Windows before Python 3.12
        raise RunError(
            "a whole run can't take the place of a mounted disk in one step",
            where=str(out),
            fix="name a folder on it",
        )
    try:
        refuse_taken(out)
    except (FileNotFoundError, RunError) as error:
        if isinstance(error, RunError):
            raise
    except OSError as error:
        raise system_error("listing the run's folder", out, error) from None


# -- `gk.rollout(..., workers=N)`: the same evidence, played by processes side by side


def rollout_apart(
    plan: RolloutPlan,
    out: str | PathLike[str] | None,
    *,
    workers: int,
    after_episode: Callable[[int], None] | None,
) -> Evidence:
    """Plays episodes by `workers` processes into the run `out`; see `rollout`.

    Raises:
        EvidenceError: an argument can't go to another process.
        EnvError: the environment failed; the rows up to there are finalized as *failed*.
    """
    if out is None or plan.first:
        raise EvidenceError(
            "workers can only record a whole run, into a folder",
            where="out" if out is None else "first",
            expected="a folder, and episodes from 0 on",
            actual="None" if out is None else str(plan.first),
            fix="name a folder: out='runs/mine'; a range of episodes is played without workers",
        )
    plan = plan.portable()

    def take(fields: dict[str, Any]) -> None:
        if after_episode is not None and "episode" in fields:
            after_episode(fields["episode"])

    folder = Path(out)
    with LocalExecutor(workers) as executor:
        played = record_apart(
            plan,
            folder,
            executor=executor,
            storage=Storage.at(parts_folder(folder)),
            limits=Limits(silence_s=None),  # nor would one process give up
            on_message=take,
        )
    if played.error is not None:
        raise played.error
    if played.note:
        say(played.note)
    return load(folder)
