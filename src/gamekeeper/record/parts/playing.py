"""The parts of a plan while they are played: what is wanted yet, what came, what ended the run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.errors import BundleError, EnvError, GamekeeperError
from gamekeeper.record.parts.plan import Plan, key_of
from gamekeeper.record.told import error_in
from gamekeeper.run.executors.storage import Storage
from gamekeeper.run.executors.task import Done, Task
from gamekeeper.run.workers import run_task

if TYPE_CHECKING:
    from gamekeeper.record.parts.receipt import Receipt

PLAY: Final = "gamekeeper.record.parts.play:part_task"
REMAINS: Final = "gamekeeper.record.parts.play:remains_task"
NEVER: Final = 1 << 62


@dataclass(slots=True)
class Playing:
    """The bookkeeping of one recording by workers.

    Attributes:
        whole: by the keys of the parts that have a receipt, what it says.
        stop: the first episode of the first part that failed; those after it aren't begun.
        errors: what parts ended with, by their first episode.
        deaths: how often a worker process died, and its task was played again.
    """

    plan: Plan
    storage: Storage
    on_message: Callable[[dict[str, Any]], None]
    whole: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    stop: int = NEVER
    errors: dict[int, GamekeeperError] = field(default_factory=dict)
    deaths: int = 0
    _killed: dict[int, tuple[range, str | None]] = field(default_factory=dict)
    _episodes: int = 0
    _turns: int = 0
    _begun: dict[str, range] = field(default_factory=dict)
    _now: dict[str, dict[str, int]] = field(default_factory=dict)
    _lock: Any = field(default_factory=Lock)

    def look(self) -> None:
        """Takes the parts that are in storage already.

        Raises:
            BundleError: a receipt can't be read.
        """
        from gamekeeper.record.parts.receipt import receipts_of, whole_keys

        there = whole_keys(self.storage)
        ranges = [each for each in self.plan.ranges() if key_of(each) in there]
        found = receipts_of(self.storage, map(key_of, ranges))
        for episodes, receipt in zip(ranges, found, strict=True):
            if receipt is not None:
                self._take_receipt(episodes, receipt)
        self._say()

    def tasks(self) -> Iterator[Task]:
        """The parts that are wanted yet, in their order; asked for as workers get free."""
        given = {"storage": self.storage.place, "plan": self.plan.to_json()}
        for episodes in self.plan.ranges():
            key = key_of(episodes)
            if episodes.start > self.stop:
                return
            if key in self.whole:
                continue
            self._begun[key] = episodes
            yield Task(key, PLAY, {**given, "first": episodes.start, "stop": episodes.stop})

    def take(self, key: str, fields: Mapping[str, Any]) -> None:
        """A report: how far a part is."""
        with self._lock:
            now = self._now.setdefault(key, {})
            now.update({name: fields[name] for name in ("episode", "turns") if name in fields})
        self._say()

    def end(self, done: Done) -> None:
        """A task has ended.

        Raises:
            BundleError: its part isn't in storage.
            WorkerFault: the task itself is broken.
            KeyboardInterrupt: it was interrupted.
        """
        episodes = self._begun.pop(done.key)
        with self._lock:
            self._now.pop(done.key, None)
        self.deaths += done.attempts - 1
        if done.outcome.status == "interrupted":
            raise KeyboardInterrupt
        error = error_in(done.outcome)
        if error is None:
            value: Any = done.outcome.value
            if value["failed"]:
                self._take_receipt(episodes, self._receipt(done.key))
            else:
                self._count(episodes, value)
        else:
            if done.outcome.status != "done":
                self._killed[episodes.start] = episodes, done.outcome.traceback
            self._fail(episodes.start, error)
        self._say()

    def forget(self, keys: Collection[str]) -> None:
        """These parts are damaged: they are to be played again.

        Raises:
            BundleError: the storage refuses.
        """
        from gamekeeper.record.parts.receipt import forget

        for episodes in self.plan.ranges():
            if key_of(episodes) in keys:
                forget(self.storage, key_of(episodes))
                said = self.whole.pop(key_of(episodes))
                self._episodes -= said["episodes"]
                self._turns -= said["turns"]
                self.errors.pop(episodes.start, None)
        self.stop = min(self.errors, default=NEVER)
        self._say()

    def first_error(self) -> GamekeeperError | None:
        """What the first part that failed ended with; None where none did."""
        return self.errors.get(self.stop)

    def ended_by(self) -> str | None:
        """Sees to the part that ended the run; why it ended, where no part is there to tell.

        Raises:
            GamekeeperError: it wasn't the environment that failed; or nothing of it is left.
        """
        error = self.first_error()
        if error is None or key_of(self._range_at(self.stop)) in self.whole:
            return None
        if not isinstance(error, EnvError):
            raise error
        if self.stop in self._killed and self._seal_remains(error):
            return None
        if self.stop == 0:
            raise error
        return f"{error.what}: {error.seen}".removesuffix(": ")

    def kept(self) -> int:
        """How many parts one process would have recorded: up to the first that failed."""
        return sum(
            1
            for each in self.plan.ranges()
            if each.start < self.stop or (each.start == self.stop and key_of(each) in self.whole)
        )

    def _seal_remains(self, error: GamekeeperError) -> bool:
        """Whether anything is left of a part whose every attempt was killed."""
        from gamekeeper.record.tasks import error_fields

        episodes, stack = self._killed[self.stop]
        outcome = run_task(
            REMAINS,
            {"storage": self.storage.place, "first": episodes.start, "stop": episodes.stop,
             "error": error_fields(error), "stack": stack},
            silence_s=None,
        )  # fmt: skip
        if outcome.status == "interrupted":
            raise KeyboardInterrupt
        found = error_in(outcome)
        if found is not None:
            raise found
        value: Any = outcome.value
        if not value["failed"]:
            raise BundleError(
                "a worker ended just after its part was whole",
                where=f"{self.storage}, {key_of(episodes)}",
                seen=error.seen,
                mend="repeat the same command: it goes on from there",
            )
        if value["episodes"]:
            self._count(episodes, value)
        return bool(value["episodes"])

    def _range_at(self, first: int) -> range:
        return next(each for each in self.plan.ranges() if each.start == first)

    def _receipt(self, key: str) -> Receipt:
        from gamekeeper.record.parts.receipt import receipt_of

        receipt = receipt_of(self.storage, key)
        if receipt is None:
            raise lost(self.storage, key)
        return receipt

    def _take_receipt(self, episodes: range, receipt: Receipt) -> None:
        from gamekeeper.record.tasks import error_of

        self._count(episodes, receipt.said())
        if receipt.error is not None:
            self._fail(episodes.start, error_of(receipt.error))

    def _count(self, episodes: range, said: Mapping[str, Any]) -> None:
        self.whole[key_of(episodes)] = said
        self._episodes += said["episodes"]
        self._turns += said["turns"]

    def _fail(self, first: int, error: GamekeeperError) -> None:
        self.errors[first] = error
        self.stop = min(self.stop, first)

    def _say(self) -> None:
        with self._lock:
            now = list(self._now.values())
        self.on_message({
            "episode": self._episodes + sum(each.get("episode", 0) for each in now),
            "episodes": self.plan.episodes,
            "turns": self._turns + sum(each.get("turns", 0) for each in now),
        })  # fmt: skip


def lost(storage: Storage, key: str) -> BundleError:
    """A worker says that a part is whole, and it isn't where this machine looks."""
    return BundleError(
        "a part isn't in storage, though its worker put it there",
        where=f"{storage}, {key}",
        mend="workers on other machines need storage that all of them reach: --storage with a "
        "shared folder or a URL",
    )
