"""Tasks played on a Ray cluster, each in a process of ours beside Ray's.

Ray places tasks and tells of nodes that were lost; retries are counted here and nowhere else
(`max_retries=0`), so that they don't multiply. What is large goes from nodes to storage: only an
`Outcome` comes back.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from secrets import token_hex
from typing import Any, Final

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.executors.ray_cluster import Cluster, entry, surroundings, the_ray
from gamekeeper.rollouts.executors.task import (
    Done,
    Executor,
    Limits,
    OnReport,
    WorkTask,
    check_workers,
)
from gamekeeper.rollouts.workers import GRACE_S, TaskOutcome

PATIENCE_S: Final = 0.2
"""Seconds of one wait, so that Ctrl-C gets through."""
FAREWELL_S: Final = GRACE_S + 5.0
"""Seconds in which cancelled tasks may finalize their evidence and end."""
TRY_S: Final = 60.0
"""Seconds in which a node must have tried the storage; it starts a process for that."""
LOSSES: Final = 10
"""Times that a task is placed anew after its node was lost.

That is no fault of the task's, as a rule, so it doesn't count towards `Limits.attempts`; but a
task that ruins every node must end somewhere.
"""


class RayExecutor(Executor):
    """Plays tasks on the nodes of a Ray cluster; connects to it when first used.

    A task whose process died is tried again up to `Limits.attempts` times, one whose node was lost
    up to `LOSSES` times; both stand in `Done.attempts`. Reports don't come back from nodes.

    Args:
        address: `host:port` of a cluster's head, or `auto`; None: a cluster of this machine alone,
            started now and ended by `close` or with this process.
        workers: how many tasks are played at a time; None: as many as the cluster has cores, now
            and whenever nodes come or go.
    Raises:
        DependencyError: Ray isn't installed.
        GamekeeperError: there would be nobody.
    """

    def __init__(self, address: str | None = None, workers: int | None = None) -> None:
        if find_spec("ray") is None:
            the_ray()
        check_workers(workers)
        self._address, self._asked = address, workers
        self._joined: Cluster | None = None

    @property
    def workers(self) -> int:
        """Number of tasks that run at a time; asking connects to the cluster.

        Raises:
            GamekeeperError: the cluster doesn't answer.
        """
        return self._asked or max(self._cluster().cores(), 1)

    def _play(
        self, tasks: Iterator[WorkTask], limits: Limits, on_report: OnReport | None
    ) -> Iterator[Done]:
        """Yields each task as it ends; see `Executor.map`. `on_report` is never called.

        Raises:
            DependencyError: a node has another Gamekeeper.
            GamekeeperError: the cluster doesn't answer, is without cores, or a node can't play.
        """
        cluster = self._cluster()
        flight, drawn = _Flight(cluster, limits), tasks

        def fill() -> None:
            room = cluster.room(self._asked)
            while len(flight) < room and (task := next(drawn, None)) is not None:
                flight.launch(_Try(task))

        try:
            fill()
            while len(flight):
                ended = list(flight.landed())
                fill()  # before whoever asked looks at what ended, so that nobody is idle meanwhile
                yield from ended
        finally:
            flight.cancel()

    def check_storage(self, place: str) -> None:
        """Every node writes to the storage, and this process reads it there.

        A folder that isn't shared looks the same on every node, and each would fill its own.
        Raises:
            RunError: the storage refuses this process.
            GamekeeperError: a node doesn't reach it, means another place, or doesn't answer.
        """
        cluster = self._cluster()
        mark, nodes = token_hex(8), cluster.nodes()
        names = [f"storage.{mark}.{number}" for number in range(len(nodes))]
        try_storage = entry({"surroundings": surroundings()})
        remote = cluster.ray.remote(max_retries=0, num_cpus=0)(try_storage)
        asked = [
            remote.options(scheduling_strategy=cluster.on(node)).remote(
                {"storage": {"place": place, "name": name}}
            )
            for node, name in zip(nodes, names, strict=True)
        ]
        ready, late = cluster.ray.wait(asked, num_returns=len(asked), timeout=TRY_S)
        for ref in late:
            cluster.ray.cancel(ref, force=True)
        seen = dict(zip(asked, zip(names, nodes, strict=True), strict=True))
        answers = [(seen[ref][0], _answer(cluster.ray, ref, seen[ref][1])) for ref in ready]
        _judge(place, answers, [seen[ref][1] for ref in late])

    def close(self) -> None:
        """Leaves the cluster; one that was started here ends."""
        joined, self._joined = self._joined, None
        if joined is not None:
            joined.close()

    def _cluster(self) -> Cluster:
        if self._joined is None:
            self._joined = Cluster(self._address, self._asked)
        return self._joined


@dataclass(slots=True)
class _Try:
    """A task, and how often it was tried."""

    task: WorkTask
    died: int = 0
    lost: int = 0


class _Flight:
    """The tasks that Ray has."""

    def __init__(self, cluster: Cluster, limits: Limits) -> None:
        self._ray, self._limits = cluster.ray, limits
        self._refs: dict[Any, _Try] = {}
        common = {"surroundings": surroundings(), "limits": asdict(limits)}
        self._remote = self._ray.remote(max_retries=0, num_cpus=1)(entry(common))

    def __len__(self) -> int:
        return len(self._refs)

    def launch(self, tried: _Try) -> None:
        """Hands a task to Ray."""
        task = tried.task
        order = {"key": task.key, "call": task.call, "arguments": dict(task.arguments)}
        self._refs[self._remote.remote({"task": order})] = tried

    def landed(self) -> Iterator[Done]:
        """Those that ended for good, after waiting a little; the others are launched again."""
        ready, _ = self._ray.wait(list(self._refs), num_returns=1, timeout=PATIENCE_S)
        if ready:
            refs = list(self._refs)
            ready, _ = self._ray.wait(refs, num_returns=len(refs), timeout=0)
        for ref in ready:
            tried = self._refs.pop(ref)
            outcome = self._outcome(ref, tried)
            if outcome is None:
                self.launch(tried)
            else:
                yield Done(tried.task.key, outcome, tried.died + tried.lost)

    def _outcome(self, ref: Any, tried: _Try) -> TaskOutcome | None:
        """Result of a task; None where it is to be tried again."""
        errors = self._ray.exceptions
        try:
            outcome = TaskOutcome(**_answer(self._ray, ref, tried.task.key))
        except errors.OutOfMemoryError as error:  # Ray ended it: the node ran short, by its hunger
            outcome = TaskOutcome("died", None, _first_line(error), None, 0.0)
        except errors.RayError as error:
            tried.lost += 1
            if tried.lost < LOSSES:
                return None
            what = f"the node was lost {tried.lost} times; the last: {_first_line(error)}"
            return TaskOutcome("died", None, what, None, 0.0)
        tried.died += 1
        again = outcome.status == "died" and tried.died < self._limits.attempts
        return None if again else outcome

    def cancel(self) -> None:
        """Interrupts what is in flight, waits for it a while, and ends what is left then."""
        refs, self._refs = list(self._refs), {}
        if not refs or not self._ray.is_initialized():
            return
        for ref in refs:
            self._ray.cancel(ref)
        _, left = self._ray.wait(refs, num_returns=len(refs), timeout=FAREWELL_S)
        for ref in left:
            self._ray.cancel(ref, force=True)


def _answer(ray: Any, ref: Any, where: str) -> dict[str, Any]:
    """Answer of a node.

    Raises:
        GamekeeperError: it can't play anything; what Ray raises of lost nodes comes out as it is.
    """
    try:
        answer: dict[str, Any] = ray.get(ref)
    except ray.exceptions.TaskCancelledError:
        raise
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, GamekeeperError):
            raise error.cause from error
        raise GamekeeperError(
            "a node can't play",
            where=where,
            actual=(str(error).strip().splitlines() or [type(error).__name__])[-1][:300],
            fix="install Gamekeeper, and what the environment needs, on every node, or run from "
            "folders that all of them share",
        ) from error
    return answer


def _judge(place: str, answers: Sequence[tuple[str, dict[str, Any]]], late: Sequence[str]) -> None:
    """Refuses where a node's file isn't where this process looks for it."""
    from gamekeeper.rollouts.executors.storage import Storage

    storage = Storage.at(place)
    strangers = []
    for name, answer in answers:
        if storage.exists(name):
            storage.delete(name)
        else:
            why = answer["error"] or "wrote to a place of its own"
            strangers.append(f"{answer['host']} ({why})")
    strangers += [f"node {node[:12]} (no answer within {TRY_S:g} s)" for node in late]
    if strangers:
        raise GamekeeperError(
            "not every node reaches the storage",
            where=str(storage),
            expected=f"all of {len(answers) + len(late)} nodes",
            actual=", ".join(strangers[:8]) + (", ..." if len(strangers) > 8 else ""),
            fix="name a folder that all nodes share, or a URL (s3://, gs://)",
        )


def _first_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {str(error).strip().splitlines()[0][:300]}"
