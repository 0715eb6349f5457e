"""Commands, and the workers that they start, as forks of one process that has imported everything.

What a process of ours takes longest to is to begin: to import. Where processes are killed hundreds
of times, and their imports aren't what is looked at, they are forked from a process that is warm.
A fork does what `worker_main.py` does when it is run: it leads a session of its own, has only the
descriptors that it is given, dies with its parent, and takes its order from the channel.

Run as a script, for every line of its input, [words, where its output goes], a fork runs
`gamekeeper` with these words; its process id is printed, and its exit code once it has ended. With
`--cold` the workers are begun as always; with further arguments, these modules are imported too.
A line whose words begin with `-c` is a script of Python: its text, then its arguments.
"""

import importlib
import io
import json
import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Final

from gamekeeper.cli import main
from gamekeeper.rollouts import worker_main, worker_process
from gamekeeper.runs.recording import rollout

IMPORTED: Final = (
    "gamekeeper.cli._app",
    "gamekeeper.cli.rollout",
    "gamekeeper.cli._fan",
    "gamekeeper.runs.load_run",
    "gamekeeper.runs.parts.fan_out",
    "gamekeeper.runs.parts.part_tasks",
    "gamekeeper.runs.run_check",
    "gamekeeper.tasks.two_robot_line",
    "gamekeeper.rollouts.executors.local",
    "pyarrow.parquet",
)
TASK: Final = "two_robot_line"
LOOK_S: Final = 0.002


class Fork:
    """A worker as `subprocess.Popen` would have begun it, as far as `WorkerProcess` looks at it."""

    def __init__(self, words: Sequence[str], *, pass_fds: Sequence[int], **_: object) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        self.returncode: int | None = None
        self.pid = os.fork()
        if not self.pid:
            _work(words[-3:], frozenset(pass_fds))

    def poll(self) -> int | None:
        """The exit code; None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float) -> int:
        """The exit code, waited for.

        Raises:
            subprocess.TimeoutExpired: it still runs.
        """
        deadline_s = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > deadline_s:
                raise subprocess.TimeoutExpired("worker_main.py", timeout)
            time.sleep(LOOK_S)
        return code


def _work(words: Sequence[str], passed: frozenset[int]) -> None:
    """Is the worker, to its end; the thread that forked is the only one that is left."""
    code = 1
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        open_now = [int(path.name) for path in Path("/proc/self/fd").iterdir()]
        for number in set(open_now) - passed - {0, 1, 2}:
            with suppress(OSError):  # the listing's own
                os.close(number)
        sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__  # whatever they were led to
        sys.argv = ["worker_main.py", *words]
        worker_main.main()
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def run(words: Sequence[str], said: str) -> int:
    """Runs a line in this process, its output into a file; the exit code."""
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
    os.dup2(1, 2)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    if words[0] != "-c":
        return main(list(words))
    sys.argv = list(words)
    exec(compile(words[1], "<script>", "exec"), {"__name__": "__main__"})
    return 0


def _warm() -> None:
    """What is imported, or compiled, when it is first needed is needed once."""
    with redirect_stdout(io.StringIO()), tempfile.TemporaryDirectory() as folder:
        main(["explain", "GK402"])
        rollout(TASK, episodes=1, seed=0, out=Path(folder, "run"))


def serve() -> None:
    """Forks for every line, one after the other."""
    for module in IMPORTED + tuple(word for word in sys.argv[1:] if word != "--cold"):
        importlib.import_module(module)
    if "--cold" not in sys.argv[1:]:
        worker_process.subprocess = SimpleNamespace(  # type: ignore[attr-defined]
            Popen=Fork, DEVNULL=subprocess.DEVNULL, TimeoutExpired=subprocess.TimeoutExpired
        )
    _warm()
    for line in sys.stdin:
        pid = os.fork()
        if not pid:
            code = 1
            try:
                code = run(*json.loads(line))
            except BaseException:
                traceback.print_exc()
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        print(pid, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


class Forks:
    """What begins commands, one at a time."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        self._orders, self._answers = process.stdin, process.stdout

    def begin(self, words: Sequence[str], said: str) -> int:
        """A command begins; its process."""
        self._orders.write(json.dumps([list(words), said]) + "\n")
        self._orders.flush()
        return int(self._answers.readline())

    def code(self) -> int:
        """Waits for the command's end; its exit code."""
        return int(self._answers.readline())


@contextmanager
def forks(*modules: str, is_cold: bool = False) -> Iterator[Forks]:
    """A process that forks commands.

    Args:
        modules: to be imported before, beside what recording takes.
        is_cold: workers are begun as always, and import what they need.
    """
    path = os.pathsep.join(filter(None, sys.path))
    flags = ["--cold"] if is_cold else []
    # OpenBLAS ends its threads before a fork, and waits for ever where two threads fork at once.
    environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, __file__, *flags, *modules],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield Forks(process)


def children_of(pid: int) -> list[int]:
    """The processes that this one started and that run yet."""
    found: set[int] = set()
    for thread in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):  # gone meanwhile
            found.update(map(int, thread.read_text().split()))
    return sorted(child for child in found if is_there(child))


def is_there(pid: int) -> bool:
    """Whether the process runs; one that its parent hasn't reaped doesn't."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


if __name__ == "__main__":
    serve()
