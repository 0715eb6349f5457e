"""What a node of a Ray cluster does for us: plays tasks in a process that stays beside Ray's own.

An environment never runs inside a process of Ray's: whatever it breaks there, Ray's process goes on
and tells how it ended. `entry` makes the one function that Ray carries over by value; all else is
imported on the node, from where the driver's `sys.path` says.
"""

from __future__ import annotations

import os
import platform
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import DependencyError
from gamekeeper.run.executors.task import Limits, Task
from gamekeeper.run.executors.worker import StayingWorker

TRAVELS: Final = (
    "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS",
    "PYTHONHASHSEED", "SDL_AUDIODRIVER", "SDL_VIDEODRIVER",
)  # fmt: skip
"""Environment variables that a node takes from the driver, unset ones too: sums over other numbers
of threads round differently (Ray sets OMP_NUM_THREADS), hashes order sets, SDL asks for a screen.
"""

_staying: list[StayingWorker] = []  # of this process of Ray's, which plays one task at a time


def surroundings() -> dict[str, Any]:
    """What of this process a node needs to play the same as this machine would."""
    return {
        "path": [entry or str(Path.cwd()) for entry in sys.path],
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
        from gamekeeper.run.executors import ray_node

        return ray_node.obey({**common, **order})

    return gamekeeper_task


def obey(order: Mapping[str, Any]) -> dict[str, Any]:
    """Plays a task, or looks at the storage, as the order says.

    Returns:
        The fields of an `Outcome`; of a look: where it was (`host`) and the error, if any.
    Raises:
        DependencyError: another Gamekeeper is installed here.
    """
    settle(order["surroundings"])
    if "look" in order:
        return look(**order["look"])
    task, limits = Task(**order["task"]), Limits(**order["limits"])
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
            where=platform.node(), expected=wanted["version"], seen=version(),
            mend="install the same version on every node",
        )  # fmt: skip
    with suppress(OSError):  # not shared: what a task opens by a relative path is looked for here
        os.chdir(wanted["folder"])
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


def look(place: str, name: str) -> dict[str, Any]:
    """Puts a file into the storage, so that the driver may see whether both mean the same place."""
    from gamekeeper.errors import GamekeeperError
    from gamekeeper.run.executors.storage import Storage

    host = platform.node()
    try:
        Storage.at(place).put(name, host.encode())
    except GamekeeperError as error:
        return {"host": host, "error": f"{error.what}: {error.seen}".removesuffix(": ")}
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
