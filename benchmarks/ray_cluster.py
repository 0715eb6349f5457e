"""The same evidence from one machine's processes and from a Ray cluster, also where a node is lost.

Two nodes of a cluster run on this machine, in a network namespace that has nothing but loopback
(`unshare --net`, which takes root). Recordings of `simple_spread` are compared by fingerprint: 1, 2
and 4 local processes, both nodes, and both where one is killed in mid-run, with all its processes.
Then null tasks: how many a second, and the driver's memory on the way.

Prints JSON lines: {"figure": "recording", "run", "fingerprint", "episodes", "in_order", "seconds",
"parts_at_kill", "died": what is said of deaths}, {"figure": "null tasks", "run", "tasks_per_s",
"cpu_us_a_task", "rss_mb": {tasks: MB}}, and at the end {"figure": "same", "fingerprints": how many
different ones, "ok"}.

    python benchmarks/ray_cluster.py [--runs local-1,local-2,local-4,nodes,killed]
        [--episodes 192] [--tasks 10000]
"""

import argparse
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

from gamekeeper.rollouts.executors.ray import RayExecutor
from gamekeeper.rollouts.executors.task import WorkTask
from gamekeeper.rollouts.worker_process import MAIN
from gamekeeper.runs.load_run import load

RUNS: Final = "local-1,local-2,local-4,nodes,killed"
INSIDE: Final = "GAMEKEEPER_IN_NAMESPACE"
HERE: Final = Path(__file__).resolve()
ENV: Final = ("mpe2.simple_spread_v3:parallel_env", "--kwargs", '{"max_cycles": 60}')
PARTS_FIRST: Final = 8
"""Parts that are whole before the node is killed; it has to be at work, too."""
UP_S: Final = 90.0
RECORD_S: Final = 300.0


@dataclass
class TwoNodes:
    """A Ray cluster of two nodes on 127.0.0.1, one core each, with a token of its own."""

    cores: int = 1
    folder: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="gk-ray-")))
    port: int = field(default_factory=lambda: free_port())
    nodes: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def address(self) -> str:
        """Of its head."""
        return f"127.0.0.1:{self.port}"

    @property
    def environment(self) -> dict[str, str]:
        """What a process needs to join."""
        return {**os.environ, **self.variables}

    def __post_init__(self) -> None:
        """Nobody else may join."""
        self.variables = {
            "RAY_USAGE_STATS_ENABLED": "0",
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(32),
        }

    def __enter__(self) -> Self:
        try:
            self._start(
                "--head",
                f"--port={self.port}",
                "--include-dashboard=false",
                "--no-monitor",
                f"--temp-dir={self.folder / 'r'}",
            )
            self._start(f"--address={self.address}")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _start(self, *how: str) -> None:
        for is_last in (False, True):
            node, text = self._tried(how)
            self.nodes.append(node)
            if node.poll() is None:
                return
            kill_tree(self.nodes.pop())
            if is_last or "timed out during startup" not in text:  # Ray waits 30 s, busy or not
                raise RuntimeError(f"a node didn't start: {text[-2000:]}")

    def _tried(self, how: tuple[str, ...]) -> tuple[subprocess.Popen[bytes], str]:
        log = self.folder / f"node{len(self.nodes)}.log"
        command = [
            str(Path(sys.executable).with_name("ray")),
            "start",
            *how,
            "--block",
            "--node-ip-address=127.0.0.1",
            f"--num-cpus={self.cores}",
            "--disable-usage-stats",
            "--object-store-memory=80000000",
            "--include-log-monitor=false",
        ]
        with log.open("wb") as sink:
            node = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=sink,
                env=self.environment,
                start_new_session=True,
            )
        try:
            wait(lambda: "Ray runtime started" in log.read_text() or node.poll() is not None, UP_S)
        except BaseException:
            kill_tree(node)
            raise
        return node, log.read_text()

    def is_playing(self) -> bool:
        """Whether the second node has a process in which an environment is played."""
        return any(MAIN.name in command_of(pid) for pid in offspring(self.nodes[1].pid))

    def kill(self) -> int:
        """Kills the second node as a power cut would; returns how many processes that were."""
        return kill_tree(self.nodes[1])

    def close(self) -> None:
        """Nothing of it is left."""
        for node in reversed(self.nodes):
            kill_tree(node)
        shutil.rmtree(self.folder, ignore_errors=True)


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def wait(is_so: Any, limit_s: float) -> None:
    """Looks until something is so."""
    deadline_s = time.monotonic() + limit_s
    while not is_so():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"not so after {limit_s:g} s")
        time.sleep(0.05)


def kill_tree(process: subprocess.Popen[bytes]) -> int:
    """Kills a process and all it started, the starters first, so that none starts another."""
    found = [process.pid, *offspring(process.pid)]
    for pid in found:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    process.wait()
    return len(found)


def command_of(pid: int) -> str:
    """The command line of a process; empty where it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(errors="replace")
    except OSError:
        return ""


def offspring(pid: int) -> Iterator[int]:
    """The processes that a process started, and theirs, on Linux."""
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            for child in (thread / "children").read_text().split():
                yield int(child)
                yield from offspring(int(child))


def recorded(run: str, folder: Path, cluster: TwoNodes | None, episodes: int) -> dict[str, Any]:
    """A recording from the command line; where it is `killed`, a node goes while it runs."""
    kind, _, workers = run.partition("-")
    out, parts = folder / run, folder / f"{run}-parts"
    who = ["local", "--workers", workers] if cluster is None else [f"ray:{cluster.address}"]
    command = [
        sys.executable,
        "-m",
        "gamekeeper",
        "rollout",
        *ENV,
        "--episodes",
        str(episodes),
        "--seed",
        "7",
        "--out",
        str(out),
        "--storage",
        str(parts),
        "--json",
        "--executor",
        *who,
    ]
    environment = dict(os.environ) if cluster is None else cluster.environment
    began_s, at_kill = time.monotonic(), None
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            if kind == "killed" and cluster is not None:
                whole = (parts / "parts").glob
                wait(
                    lambda: (
                        (cluster.is_playing() and len(list(whole("*.json"))) >= PARTS_FIRST)
                        or process.poll() is not None
                    ),
                    RECORD_S,
                )
                cluster.kill()
                at_kill = len(list(whole("*.json")))
            text, said = process.communicate(timeout=RECORD_S)
        finally:
            process.kill()
    seconds = time.monotonic() - began_s
    if process.returncode:
        raise RuntimeError(f"{run}: exit code {process.returncode}\n{said}")
    numbers = load(out).episode_table.column("episode").to_pylist()
    return {
        "figure": "recording",
        "run": run,
        "fingerprint": json.loads(text)["fingerprint"],
        "episodes": len(numbers),
        "in_order": numbers == list(range(episodes)),
        "seconds": round(seconds, 2),
        "parts_at_kill": at_kill,
        "died": [line for line in said.splitlines() if "died" in line],
    }


def null(report: Any) -> None:
    """The least that a task can be."""


def null_tasks(address: str, number: int) -> dict[str, Any]:
    """Null tasks by a cluster, with this process's memory on the way."""
    seen, done = {}, 0
    executor = RayExecutor(address)
    tasks = (WorkTask(f"null-{k}", f"{HERE.stem}:null") for k in range(number))
    began_s, began_cpu_s = time.monotonic(), time.process_time()
    for each in executor.map(tasks):
        done += each.outcome.status == "done"
        if done in (100, number // 2, number):
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            seen[done] = round(pages * os.sysconf("SC_PAGESIZE") / 1e6, 1)
    seconds, cpu_s = time.monotonic() - began_s, time.process_time() - began_cpu_s
    cores = executor.workers
    executor.close()
    return {
        "figure": "null tasks",
        "run": f"ray, {cores} cores",
        "tasks": done,
        "tasks_per_s": round(number / seconds),
        "cpu_us_a_task": round(1e6 * cpu_s / number),
        "rss_mb": seen,
    }


@contextmanager
def variables(given: dict[str, str]) -> Iterator[None]:
    """This process has these environment variables meanwhile."""
    os.environ.update(given)
    try:
        yield
    finally:
        for name in given:
            os.environ.pop(name, None)


def figures(runs: list[str], episodes: int, tasks: int) -> Iterator[dict[str, Any]]:
    """Every figure, one at a time."""
    folder = Path(tempfile.mkdtemp(prefix="gk-cluster-"))
    try:
        for run in runs:
            if run.startswith("local"):
                yield recorded(run, folder, None, episodes)
        clustered = [run for run in runs if not run.startswith("local")]
        with TwoNodes() if clustered else nullcontext() as cluster:
            if cluster is not None and tasks:
                with variables(cluster.variables):
                    yield null_tasks(cluster.address, tasks)
            for run in clustered:  # the one that is killed comes last
                yield recorded(run, folder, cluster, episodes)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> int:
    """Goes into a namespace of its own and prints the figures there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", default=RUNS)
    parser.add_argument("--episodes", type=int, default=192)
    parser.add_argument("--tasks", type=int, default=10_000)
    given = parser.parse_args()
    if INSIDE not in os.environ:
        return inside([sys.executable, str(HERE), *sys.argv[1:]]).returncode
    prints, is_ok = set(), True
    for figure in figures(given.runs.split(","), given.episodes, given.tasks):
        print(json.dumps(figure), flush=True)
        if figure["figure"] == "recording":
            prints.add(figure["fingerprint"])
            is_ok &= figure["in_order"]
            is_ok &= bool(figure["died"]) == (figure["run"] == "killed")  # it was at work
    is_ok &= len(prints) == 1
    print(json.dumps({"figure": "same", "fingerprints": len(prints), "ok": is_ok}))
    return 0 if is_ok else 1


def read(lines: str) -> list[dict[str, Any]]:
    """The figures of lines that `main` printed."""
    return [json.loads(line) for line in lines.splitlines()]


def inside(command: list[str], **how: Any) -> subprocess.CompletedProcess[str]:
    """Runs a command in a network namespace with loopback alone."""
    return subprocess.run(
        ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh", *command],
        env={**os.environ, INSIDE: "1"},
        check=False,
        **how,
    )


if __name__ == "__main__":
    sys.exit(main())
