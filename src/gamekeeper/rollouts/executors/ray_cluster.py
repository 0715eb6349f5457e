"""A Ray cluster as its driver sees it, and the nodes that play tasks in it."""

import os
import platform
import secrets
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from gamekeeper import import_guard
from gamekeeper.errors import DependencyError, GamekeeperError, not_installed
from gamekeeper.rollouts.executors.local import StayingWorker
from gamekeeper.rollouts.executors.task import Limits, WorkTask

# -- The Ray cluster that tasks are played on: one that runs already, or one of this machine alone
#
# Source: Ray 2.60, `ray.init`, token authentication, scheduling by node.

LOOPBACK: Final = "127.0.0.1"
OBJECTS_BYTES: Final = 100_000_000
"""Room for Ray's objects in a cluster of ours: outcomes are small and never go there."""
REACH_S: Final = 5.0
"""Seconds in which the head of a cluster must answer at all; Ray itself waits for minutes."""
AHEAD: Final = 2
"""Tasks in flight for each core: one is played, the other waits for its place."""
FRESH_S: Final = 5.0
"""Age in seconds up to which the number of cores counts: nodes come and go."""
ALONE_S: Final = 300.0
"""Seconds that a cluster may be without any core: replacing a node takes a while."""


class Cluster:
    """A connection to Ray, with the number of its cores, closed only if it was opened here.

    Args:
        address: `host:port` of the head, `auto`, or None for a cluster of this machine alone, whose
            every port is bound to 127.0.0.1; a connection that this process has already is taken.
        workers: cores of a cluster of ours; None: as many as there are.
    Raises:
        DependencyError: Ray isn't installed.
        GamekeeperError: the cluster doesn't answer, or can't be one.
    """

    def __init__(self, address: str | None, workers: int | None) -> None:
        self._variables = ours() if address is None else {}
        os.environ.update(self._variables)  # Ray reads some of them when it is imported
        self.ray = the_ray()
        self._is_ours = not self.ray.is_initialized()
        self._is_alone = self._is_ours and address is None  # then Ray itself keeps to `workers`
        self._cores, self._seen_s = 0, -FRESH_S
        self._alone_s: float | None = None
        if self._is_ours:
            self._connect(address, workers)
        elif address not in (None, "auto", self.ray.get_runtime_context().gcs_address):
            raise GamekeeperError(
                "this process is connected to another cluster",
                where="address",
                expected=self.ray.get_runtime_context().gcs_address,
                actual=address,
                fix="call ray.shutdown() first, or leave the address out",
            )

    def _connect(self, address: str | None, workers: int | None) -> None:
        if address is None:
            how: dict[str, Any] = {
                "address": "local",
                "num_cpus": workers,
                "include_dashboard": False,
                "object_store_memory": OBJECTS_BYTES,
                "_node_ip_address": LOOPBACK,
            }
        else:
            how = {"address": address}
            if reached(address):
                how["_node_ip_address"] = LOOPBACK  # else Ray binds the network card's address
        try:
            with _guarded_path():
                self.ray.init(**how, log_to_driver=False, logging_level="ERROR")
        except Exception as error:  # a bare one where a node doesn't start in time
            self.close()
            raise _unreachable(address, _told(error)) from error

    def cores(self) -> int:
        """Number of tasks of one core that find room now.

        Raises:
            GamekeeperError: there has been none for `ALONE_S`.
        """
        now_s = time.monotonic()
        if now_s - self._seen_s >= FRESH_S:
            self._cores, self._seen_s = int(self.ray.cluster_resources().get("CPU", 0)), now_s
        if self._cores:
            self._alone_s = None
        elif self._alone_s is None:
            self._alone_s = now_s
        elif now_s - self._alone_s > ALONE_S:
            raise GamekeeperError(
                f"the cluster has had no core for {ALONE_S:g} s",
                expected="a node with at least one",
                fix="start a node (ray start --address=...); the same command goes on from what "
                "was kept",
            )
        return self._cores

    def room(self, asked: int | None) -> int:
        """Number of tasks that may be in flight, where `asked` may run at a time.

        Raises:
            GamekeeperError: there has been no core for long.
        """
        ahead = AHEAD * max(self.cores(), 1)
        return ahead if asked is None or self._is_alone else asked

    def nodes(self) -> list[str]:
        """The ids of the nodes that are alive and play tasks."""
        return [
            node["NodeID"]
            for node in self.ray.nodes()
            if node["Alive"] and node["Resources"].get("CPU", 0) >= 1
        ]

    def on(self, node: str) -> Any:
        """Option that binds a task to a node."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        return NodeAffinitySchedulingStrategy(node, soft=False)

    def close(self) -> None:
        """Lets the cluster go, if this process joined it here; ends it, if it is ours."""
        if self._is_ours and self.ray.is_initialized():
            self.ray.shutdown()
        for name in self._variables:
            os.environ.pop(name, None)
        self._variables = {}


def the_ray() -> Any:
    """Ray itself.

    Raises:
        DependencyError: it isn't installed.
    """
    try:
        import ray
    except ImportError as error:
        raise not_installed(error, "Ray", "ray", "executor ray", ", on every node") from error
    return ray


def reached(address: str) -> bool:
    """Tells whether the head of a cluster is on this machine, once it is known to answer.

    Raises:
        GamekeeperError: nobody answers there, or it is no address of a head.
    """
    if address == "auto":
        return False
    host, colon, port = address.rpartition(":")
    if "://" in address or not colon or not port.isdecimal():
        raise GamekeeperError(
            "no address of a Ray cluster",
            where="address",
            expected="HOST:PORT of its head, auto",
            actual=address,
            fix="run on a node of the cluster, with the head's address (ray://, for machines "
            "outside, is another protocol)",
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), REACH_S).close()
    except OSError as error:
        raise _unreachable(address, str(error)) from error
    return host == "localhost" or host.startswith("127.")


def ours() -> dict[str, str]:
    """Environment variables for a cluster that is started here.

    Nobody is told of it. And nobody else on this machine may hand tasks to it: Ray's own default is
    one token in the user's home for all clusters; ours have one each, which nobody writes down. Who
    has set a mode of authentication, or has imported Ray already, keeps what they have.
    """
    wanted = {"RAY_USAGE_STATS_ENABLED": "0"}
    if "RAY_AUTH_MODE" not in os.environ and "ray" not in sys.modules:
        wanted |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    return {name: value for name, value in wanted.items() if name not in os.environ}


@contextmanager
def _guarded_path() -> Iterator[None]:
    """Keeps from the processes that Ray starts what an import guard keeps from this one."""
    before = os.environ.get("PYTHONPATH")
    after = import_guard.worker_environment(os.environ).get("PYTHONPATH", "")
    if before is None or after == before:
        yield
        return
    os.environ["PYTHONPATH"] = after
    try:
        yield
    finally:
        os.environ["PYTHONPATH"] = before


def _unreachable(address: str | None, seen: str) -> GamekeeperError:
    if address is None:
        return GamekeeperError(
            "no Ray cluster can be started here",
            where="executor ray",
            actual=seen,
            fix="Ray's own logs (session_latest/logs in its temporary folder) say more; `local` "
            "needs no Ray",
        )
    return GamekeeperError(
        "the Ray cluster doesn't answer",
        where=address,
        actual=seen,
        fix="check that it runs (ray status) and that this process is on one of its nodes; where "
        "it asks for a token, set RAY_AUTH_MODE and RAY_AUTH_TOKEN_PATH as its head has them",
    )


def _told(error: BaseException) -> str:
    """Origin of an error of Ray's, in one line."""
    cause: BaseException = error
    while cause.__cause__ is not None:
        cause = cause.__cause__
    lines = str(cause).strip().splitlines() or [type(cause).__name__]
    return lines[-1][:300]


# -- What a node of a Ray cluster does for us: plays tasks in a process that stays beside Ray's own
#
# An environment never runs inside a process of Ray's: whatever it breaks there, Ray's process
# goes on and tells how it ended. `entry` makes the one function that Ray carries over by value;
# all else is imported on the node, from where the driver's `sys.path` says.

TRAVELS: Final = (
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "PYTHONHASHSEED",
    "SDL_AUDIODRIVER",
    "SDL_VIDEODRIVER",
)
"""Environment variables that a node takes from the driver, unset ones too: sums over other numbers
of threads round differently (Ray sets OMP_NUM_THREADS), hashes order sets, SDL asks for a screen.
"""

_staying: list[StayingWorker] = []  # of this process of Ray's, which plays one task at a time


def surroundings() -> dict[str, Any]:
    """Facts of this process that a node needs to play the same as this machine would."""
    return {
        "path": [entry or str(Path.cwd()) for entry in sys.path],
        "guard": None if (guard := import_guard.active()) is None else guard.to_json(),
        "folder": str(Path.cwd()),
        "variables": {name: os.environ.get(name) for name in TRAVELS},
        "version": version(),
    }


def version() -> str:
    """Gamekeeper's version in this process."""
    return str(sys.modules["gamekeeper"].__version__)  # the front stands above all layers


def entry(common: Mapping[str, Any]) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """The function that Ray carries to nodes, once for all its calls.

    It stands in a function so that it is pickled by value: a node that hasn't Gamekeeper installed
    finds it in the driver's folders, where these are shared.

    Args:
        common: what all calls share: `surroundings`, and for tasks their `limits`.
    """

    def gamekeeper_task(order: Mapping[str, Any]) -> dict[str, Any]:
        import sys

        path = common["surroundings"]["path"]
        if sys.path[: len(path)] != path:
            sys.path[:] = [*path, *(entry for entry in sys.path if entry not in path)]
        from gamekeeper.rollouts.executors.ray_cluster import obey

        return obey({**common, **order})

    return gamekeeper_task


def obey(order: Mapping[str, Any]) -> dict[str, Any]:
    """Plays a task, or tries the storage, as the order says.

    Returns:
        The fields of an `Outcome`; of a try of the storage: `host` and the `error`, if any.
    Raises:
        DependencyError: another Gamekeeper is installed here.
    """
    settle(order["surroundings"])
    if "storage" in order:
        return try_storage(**order["storage"])
    task, limits = WorkTask(**order["task"]), Limits(**order["limits"])
    stop = threading.Event()
    with interrupts(stop):
        outcome = staying().play(task, limits=limits, on_report=lambda fields: None, stop=stop)
    return asdict(outcome)


def settle(wanted: Mapping[str, Any]) -> None:
    """Makes this process like the driver's, as far as results hang on it.

    Raises:
        DependencyError: another Gamekeeper is installed here.
    """
    if version() != wanted["version"]:
        raise DependencyError(
            "a node has another Gamekeeper",
            where=platform.node(),
            expected=wanted["version"],
            actual=version(),
            fix="install the same version on every node",
        )
    with suppress(OSError):  # not shared: what a task opens by a relative path is looked for here
        os.chdir(wanted["folder"])
    guard = wanted["guard"]
    import_guard.install(None if guard is None else import_guard.ImportGuard(**guard))
    for name, value in wanted["variables"].items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def staying() -> StayingWorker:
    """The worker of this process of Ray's; it dies with it."""
    if not _staying:
        _staying.append(StayingWorker())
    return _staying[0]


def try_storage(place: str, name: str) -> dict[str, Any]:
    """Puts a file into the storage, so that the driver may see whether both mean the same place."""
    from gamekeeper.errors import GamekeeperError
    from gamekeeper.rollouts.executors.storage import Storage

    host = platform.node()
    try:
        Storage.at(place).put(name, host.encode())
    except GamekeeperError as error:
        return {"host": host, "error": f"{error.what}: {error.actual}".removesuffix(": ")}
    return {"host": host, "error": None}


@contextmanager
def interrupts(stop: threading.Event) -> Iterator[None]:
    """Sets `stop` where Ray cancels the task (it interrupts the main thread, as Ctrl-C does)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: stop.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
