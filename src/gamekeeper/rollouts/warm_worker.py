"""Workers that fork for each task, so that what all tasks import is loaded once."""

import gc
import importlib
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, Self

from gamekeeper.rollouts.worker_process import WorkerProcess
from gamekeeper.rollouts.workers import JSON, TaskOutcome, WorkerWatch, environment_of

SERVE: Final = f"{__name__}:serve"


class WarmWorker:
    """A worker process that has imported some modules and forks for each task.

    A fork has what the modules loaded and the hash seed of its worker, and nothing that an earlier
    task left; the global generators are seeded from the system's entropy. The process is started
    by the first task, and again after a task that was killed for its time.

    Args:
        modules: names of the modules that are imported before the first task.
        hash_seed: PYTHONHASHSEED; None: as this process's environment has it.
    """

    __slots__ = ("_hash_seed", "_is_ready", "_modules", "_process")

    def __init__(self, modules: Sequence[str], *, hash_seed: int | None = None) -> None:
        self._modules = list(modules)
        self._hash_seed = hash_seed
        self._process: WorkerProcess | None = None
        self._is_ready = False

    def run(
        self,
        task: str,
        arguments: Mapping[str, JSON],
        *,
        silence_s: float | None = 60.0,
        limit_s: float | None = None,
    ) -> TaskOutcome:
        """Runs a task in a fork, and returns how it ended, whatever it does; see `run_task`.

        Raises:
            GamekeeperError: no process can be started here.
            TypeError, ValueError: JSON can't carry the arguments.
        """
        begun_s = time.monotonic()
        process = self.start()
        if not self._is_ready:
            outcome = _outcome(process, begun_s, None, limit_s)
            if outcome.status != "done":
                self.close()
                return outcome
            self._is_ready = True
        process.send({"task": task, "arguments": dict(arguments), "memory_bytes": None})
        outcome = _outcome(process, begun_s, silence_s, limit_s)
        if outcome.status == "hung" or process.has_ended():
            self.close()
        return outcome

    def start(self) -> WorkerProcess:
        """Starts the process where it doesn't run; it ends with the thread that starts it."""
        if self._process is None:
            order = {"task": SERVE, "arguments": {"modules": self._modules}, "memory_bytes": None}
            self._process = WorkerProcess(order, environment_of(self._hash_seed))
            self._is_ready = False
        return self._process

    def bare(self) -> "WarmWorker":
        """Another worker of the same hash seed that imports nothing beforehand."""
        return WarmWorker((), hash_seed=self._hash_seed)

    def close(self) -> None:
        """Ends the process and all that its tasks left behind."""
        process, self._process = self._process, None
        if process is not None:
            process.__exit__()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _outcome(
    process: WorkerProcess, begun_s: float, silence_s: float | None, limit_s: float | None
) -> TaskOutcome:
    """Outcome of a fork, or of the process where that has ended."""
    watch = WorkerWatch(process, lambda: 0, silence_s, limit_s, forks=True, begun_s=begun_s)
    watch.listen(lambda fields: None)
    if watch.code is None and watch.overrun is None:
        watch.code = process.end()
    return watch.outcome(watch.code or 0, None, time.monotonic() - begun_s)


def serve(report: Any, *, modules: Sequence[str]) -> None:
    """Imports the modules, then forks for each order that comes; ends with its parent.

    Args:
        report: the channel; a fork writes its signs of life and its answer into it.
        modules: names of the modules; one that is missing is left to the task that needs it.
    """
    perform: Callable[..., bytes] = sys.modules["__main__"].__dict__["perform"]
    gc.disable()
    for name in modules:
        with suppress(ImportError):  # a task that needs it says so
            importlib.import_module(name)
    gc.freeze()  # no fork looks through, and so copies, what all of them have
    gc.enable()
    report.send("returned", None)
    report.send("ended", 0)  # ready
    while True:
        order = report.order()
        child = os.fork()
        if not child:
            if "numpy" in sys.modules:  # `random` seeds itself in a fork
                sys.modules["numpy"].random.seed()
            report.write(perform(order, report))
            os._exit(0)
        _, status = os.waitpid(child, 0)
        report.send("ended", os.waitstatus_to_exitcode(status))
