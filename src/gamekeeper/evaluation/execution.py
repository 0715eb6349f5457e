"""The run of an evaluation: inspections, parts that an executor plays, the merge, evidence."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from gamekeeper.errors import EnvError, GamekeeperError
from gamekeeper.evaluation.inspection import (
    INSPECT,
    Inspection,
    check_named,
    choices_of,
    inspect_env,
    opening_of,
    placed,
    portable,
)
from gamekeeper.evaluation.matchups import Match, chunks, played_keys
from gamekeeper.evaluation.spec import Spec
from gamekeeper.evaluation.worker_tasks import EPISODES, KEEP, MERGE, READY, folder_names
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.storage import Storage
from gamekeeper.rollouts.executors.task import (
    Done,
    Executor,
    Limits,
    OnReport,
    WorkTask,
    stopped_after,
)
from gamekeeper.rollouts.worker_main import find
from gamekeeper.rollouts.workers import TaskOutcome
from gamekeeper.runs.worker_errors import error_of

SILENCE_S: Final = 60.0
"""Longest time without a turn before an environment counts as hung, in seconds."""

OnMessage = Callable[[dict[str, Any]], None]


@dataclass(slots=True)
class EvaluationRun:
    """The parts of an evaluation on an executor: inspections, episodes, merge, recorded runs.

    Attributes:
        is_here: this process plays, so that objects needn't be named.
        storage: takes parts and the merged table.
        on_message: takes `episode` and `episodes` as they are played.
    """

    spec: Spec
    executor: Executor
    is_here: bool
    storage: Storage
    limits: Limits
    on_message: OnMessage
    _played: dict[str, tuple[int, int]] = field(default_factory=dict)
    _total: int = 0

    def inspections(self) -> dict[str, Inspection]:
        """Facts about the environments and their policies.

        Raises:
            SpecError: an environment can't be opened.
            PolicyError: a policy can't be found.
            EnvError: opening one ended its process.
        """
        asked = {name: self._asked(name) for name in self.spec.environments}
        if self.is_here:
            return {name: inspect_env(**arguments) for name, arguments in asked.items()}
        tasks = [WorkTask(f"inspect.{k}", INSPECT, each) for k, each in enumerate(asked.values())]
        if isinstance(self.executor, LocalExecutor):  # its processes stay: the others import now
            others = range(len(tasks), self.executor.workers)
            tasks += [WorkTask(f"ready.{k}", READY) for k in others]
        with self._done(tasks) as ends:
            values = {done.key: self._value(done) for done in ends}
        found = {}
        for k, name in enumerate(asked):
            value = values[f"inspect.{k}"]
            policies = {policy: tuple(digests) for policy, digests in value["policies"].items()}
            found[name] = Inspection(**{**value, "policies": policies})
        return found

    def _asked(self, name: str) -> dict[str, Any]:
        environment = self.spec.environments[name]
        opening: Any = opening_of(environment, self.spec)
        options: Any = environment.options
        if not self.is_here:
            opening, options = portable(opening, options)
            for policy, each in self.spec.policies.items():
                check_named(policy, each.runs_in(name))
        return {
            "opening": opening,
            "options": options,
            "policies": {
                policy: [choices_of(choices, self.spec) for choices in each.runs_in(name)]
                for policy, each in self.spec.policies.items()
            },
            "files": {
                policy: [placed(file, self.spec.folder) for file in each.files]
                for policy, each in self.spec.policies.items()
            },
        }

    def play(self, matches: Sequence[Match], first: int, last: int) -> int:
        """Plays the episodes of a range that have no receipt yet; returns their number.

        Raises:
            GamekeeperError: a part can't be played; all others have been.
            KeyboardInterrupt: by Ctrl-C; what was played is kept.
        """
        known = played_keys(self.storage)
        wanted = [(match, a, b) for match in matches for a, b in chunks(first, last)]
        missing = [(m, a, b) for m, a, b in wanted if m.key(a, b) not in known]
        self._total += sum(b - a for _, a, b in wanted)
        kept = sum(b - a for m, a, b in wanted if m.key(a, b) in known)
        self._played[f"kept.{first}"] = (kept, 0)
        self._tell()
        failed: list[GamekeeperError] = []
        names = {match.key(a, b): match for match, a, b in missing}
        tasks = (match.task(a, b, self.storage.place) for match, a, b in missing)
        if missing:
            self.executor.check_storage(self.storage.place)
        with self._done(tasks) as ends:
            for done in ends:
                try:
                    receipt = self._value(done, names[done.key])
                except GamekeeperError as error:
                    failed.append(error)
                    continue
                self._take(done.key, {"episode": receipt["episodes"], "turns": receipt["turns"]})
        if failed:
            raise failed[0]
        return sum(b - a for _, a, b in missing)

    def merge(self, matches: Sequence[Match], last: int) -> tuple[pa.Table, dict[str, Any]]:
        """The table of all episodes, and what the merge says of it."""
        keys = [match.key(a, b) for match in matches for a, b in chunks(0, last)]
        arguments = {"place": self.storage.place, "keys": keys}
        with self._done([WorkTask("merge", MERGE, arguments)]) as ends:
            (merged,) = [self._value(done) for done in ends]
        return pq.read_table(pa.BufferReader(self.storage.get(EPISODES))), merged

    def keep(self, matches: Sequence[Match], last: int) -> list[dict[str, Any]]:
        """Runs of all pairings, for replay.

        Raises:
            GamekeeperError: one can't be recorded; all others have been.
        """
        by_key = {f"keep.{match.digest}": match for match in matches}
        lineups = [(match.environment, match.pairing.name) for match in by_key.values()]
        folders = dict(zip(by_key, folder_names(lineups), strict=True))
        tasks = (
            WorkTask(
                key,
                KEEP,
                {
                    "place": self.storage.place,
                    "key": match.digest,
                    "level": self.spec.record,
                    "name": folders[key],
                    "parts": [match.key(a, b) for a, b in chunks(0, last)],
                    "episodes": last,
                    "lineup": match.arguments["lineup"],
                },
            )
            for key, match in by_key.items()
        )
        with self._done(tasks) as ends:
            found = {done.key: self._value(done, by_key[done.key]) for done in ends}
        return [
            {"environment": match.environment, "pairing": match.pairing.name, **found[key]}
            for key, match in by_key.items()
        ]

    def _done(self, tasks: Iterable[WorkTask]) -> AbstractContextManager[Iterator[Done]]:
        return stopped_after(self.executor.map(tasks, limits=self.limits, on_report=self._take))

    def _value(self, done: Done, match: Match | None = None) -> Any:
        """Value that a task returned.

        Raises:
            GamekeeperError: it returned an error, or didn't return.
            KeyboardInterrupt: it was interrupted.
        """
        if done.outcome.status == "interrupted":
            raise KeyboardInterrupt
        where = "" if match is None else f"{match.pairing.name} in {match.environment}"
        if done.outcome.status != "done":
            raise EnvError(
                f"a worker process {done.outcome.status} while it played",
                where=where or done.key,
                actual=str(done.outcome.error),
                fix="what was played is kept: fix it, and the same command goes on from there",
            )
        value: Any = done.outcome.value
        if isinstance(value, Mapping) and "error" in value:
            raise error_of(value["error"])
        return value

    def _take(self, key: str, fields: Mapping[str, Any]) -> None:
        if "episode" in fields:
            self._played[key] = (fields["episode"], fields.get("turns", 0))
            self._tell()

    def _tell(self) -> None:
        episodes = sum(done for done, _ in self._played.values())
        turns = sum(count for _, count in self._played.values())
        self.on_message({"episode": episodes, "episodes": self._total, "turns": turns})


class InProcessExecutor(Executor):
    """Plays one task after the other in this process; what a task raises comes out."""

    @property
    def workers(self) -> int:
        """One."""
        return 1

    def _play(
        self, tasks: Iterator[WorkTask], limits: Limits, on_report: OnReport | None
    ) -> Iterator[Done]:
        """Yields each task as it ends; no limits are held."""
        for task in tasks:
            begun_s = time.monotonic()
            value = find(task.call)(_Report(task.key, on_report), **task.arguments)
            yield Done(task.key, TaskOutcome("done", value, None, None, time.monotonic() - begun_s))

    def check_storage(self, place: str) -> None:
        """Checks nothing: this process plays."""

    def close(self) -> None:
        """Closes nothing."""


class _Report:
    def __init__(self, key: str, on_report: OnReport | None) -> None:
        self._key, self._on_report = key, on_report

    def __call__(self, /, **fields: Any) -> None:
        if fields and self._on_report is not None:
            self._on_report(self._key, fields)
