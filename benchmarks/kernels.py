"""Kernels beside C++ that does the same work, and beside their peers.

The work: copies of one task, stepped together; random legal actions drawn beforehand, observations,
rewards and ends written, new episodes begun. A figure is agent-steps a second of wall time, the
best of five parts, and of as many rounds in which every subject runs in a process of its own.
C++ (benchmarks/cpp) writes the same arrays, checks the same actions and plays the same seeds; it is
built here with g++ -O3 -march=native, and `--check` compares what it shows and pays with ours.

    python benchmarks/kernels.py [--tasks two_robot_line spread ...] [--envs 1024 4096] [--rounds 3]
    python benchmarks/kernels.py --peer jaxmarl=PATH/bin/python --peer vmas=... --peer jumanji=...
    python benchmarks/kernels.py --only face|compile|memory|threads|check

Peers live in environments of their own: benchmarks/peers/*.in name them, the scripts
kernel_peers_*.py beside these say how they are called.

One JSON line a subject: {"figure", "task", "subject", "envs", "threads", "agent_steps_per_s",
"to_cpp", "load"}; `load` is how many processes wanted a core while it ran, at its least: on a quiet
machine of two cores it is about 1. `threads` compares two threads with one, and beside it two
processes that know nothing of each other with one: more than that the machine doesn't give.
"""

import argparse
import contextlib
import importlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from gamekeeper.kernels.batch import Batch

FIGURE: Final = "kernels"
HERE: Final = Path(__file__).parent
ARGUMENTS: Final[dict[str, dict[str, Any]]] = {
    "two_robot_line": {},
    "spread": {},
    "robotic_warehouse": {"n_agents": 4},
    "foraging": {},
    "warehouse": {},
}
"""Our tasks; those of C++ and peers are the same sizes."""
PEERS: Final = {
    "spread": ("jaxmarl", "vmas", "mpe2"),
    "robotic_warehouse": ("jumanji", "rware"),
    "foraging": ("jumanji", "lbforaging"),
}
SCRIPTS: Final = {"spread": "particles", "robotic_warehouse": "grid", "foraging": "grid"}
PYTHON_PEERS: Final = ("mpe2", "rware", "lbforaging")
"""Peers without batches: 16 copies one after the other are as good as 1,024."""
PARTS: Final = 5
RATE: Final = "agent_steps_per_s"
DRAWN: Final = 16
LONGEST_S: Final = 600
"""A subject that takes longer is given up."""
LONG: Final = 10**8
"""Agent-steps over which memory may not grow."""


# -- one subject, in a process of its own


MODULES: Final = {
    "foraging": "foraging.foraging",
    "robotic_warehouse": "robotic_warehouse.robotic_warehouse",
    "spread": "particles.spread",
    "two_robot_line": "two_robot_line",
    "warehouse": "warehouse.warehouse",
}
"""Module of each task, below `gamekeeper.tasks`."""


def kernel_of(task: str) -> Any:
    """Kernel of a task."""
    module = importlib.import_module(f"gamekeeper.tasks.{MODULES[task]}")
    return getattr(module, f"{task}_kernel")(**ARGUMENTS[task])


def stepper(task: str, envs: int, threads: int) -> Any:
    """What plays so many steps, legal actions drawn beforehand; and the batch."""
    import numpy as np

    kernel = kernel_of(task)
    batch = Batch(kernel, envs, threads=threads)
    batch.reset(0)
    rng, drawn = np.random.default_rng(0), []
    for _ in range(DRAWN):
        batch.arrays.actions[...] = legal_actions(kernel, batch.arrays, rng)
        drawn.append(batch.arrays.actions.copy())
        batch.step()
    if kernel.mask is not None and not kernel.plays_illegal:
        return lambda steps: masked_steps(batch, steps), batch

    def play(steps: int) -> None:
        for k in range(steps):
            batch.step(drawn[k % DRAWN])

    return play, batch


def legal_actions(kernel: Any, arrays: Any, rng: Any) -> Any:
    """Random actions, legal now."""
    (group,) = kernel.groups
    if not kernel.flags(group):
        return rng.integers(0, group.action_space.n, arrays.actions.shape)
    return (rng.random(arrays.masks.shape) * (arrays.masks > 0)).argmax(-1)


def masked_steps(batch: Any, steps: int) -> None:
    """Where masks change, what is legal is chosen between steps; that is measured along."""
    for _ in range(steps):
        batch.arrays.actions[...] = batch.arrays.masks.argmax(-1)
        batch.step()


def speed(task: str, envs: int, threads: int, seconds: float) -> dict[str, Any]:
    """Agent-steps a second of one batch."""
    play, batch = stepper(task, envs, threads)
    play(8)
    a_step, best = envs * (1 if batch.kernel.api == "aec" else len(batch.kernel.agents)), 0.0
    for _ in range(PARTS):
        start, steps = time.perf_counter(), 0
        while time.perf_counter() - start < seconds:
            play(DRAWN)
            steps += DRAWN
        best = max(best, steps * a_step / (time.perf_counter() - start))
    return {RATE: round(best)}


def memory(task: str, envs: int, threads: int, seconds: float) -> dict[str, Any]:
    """By how many bytes the process grew over 10^8 agent-steps."""
    play, batch = stepper(task, envs, threads)
    steps = LONG // (envs * len(batch.kernel.agents))
    play(steps // 10)
    before = resident()
    play(steps)
    return {"agent_steps": LONG, "grown_bytes": resident() - before}


def resident() -> int:
    """Bytes of memory that this process has now."""
    with contextlib.suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGESIZE")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def face(task: str, envs: int, threads: int, seconds: float) -> dict[str, Any]:
    """One copy through the PettingZoo face, and the same task written by hand on TickEnv."""
    import numpy as np

    sys.path.insert(0, str(HERE.parent))
    from gamekeeper.tasks.two_robot_line import TwoRobotLine
    from tests.references.two_robot_line import TwoRobotLine as ByHand

    both, best = {"face": TwoRobotLine(), "by_hand": ByHand()}, {"face": 1.0, "by_hand": 1.0}
    rows = np.random.default_rng(0).integers(0, 3, (64, 2)).tolist()
    end = time.perf_counter() + PARTS * seconds
    for env in both.values():
        env.reset(seed=0)
    while time.perf_counter() < end:
        for name, env in both.items():
            start = time.perf_counter()
            for row in rows:
                env.step(dict(zip(env.possible_agents, row, strict=True)))
                if not env.agents:
                    env.reset()
            best[name] = min(best[name], (time.perf_counter() - start) / len(rows))
    return {
        "tick_us": {name: round(1e6 * value, 2) for name, value in best.items()},
        "to_by_hand": round(best["face"] / best["by_hand"], 3),
    }


def start(task: str, envs: int, threads: int, seconds: float) -> dict[str, Any]:
    """Seconds of this process until a first step is done, imports of all libraries included."""
    import numba  # noqa: F401  # its import is a part of the figure

    imported = time.process_time()
    batch = Batch(kernel_of(task), 64)
    ours = time.process_time()
    batch.reset(0)
    batch.step()
    return {
        "numba_s": round(imported, 2),
        "gamekeeper_s": round(ours - imported, 2),
        "first_step_s": round(time.process_time() - ours, 2),
    }


SUBJECTS: Final = {"ours": speed, "memory": memory, "face": face, "start": start}


# -- all subjects, from above


class Bench:
    """Runs subjects, round after round, and keeps the best of each.

    Args:
        asked: the arguments.
        folder: where C++ is built.
    """

    def __init__(self, asked: argparse.Namespace, folder: Path) -> None:
        self.asked, self.folder = asked, folder
        self.best: dict[tuple[str, str, int, int], dict[str, Any]] = {}

    def run(self, task: str, subject: str, command: list[str], envs: int, threads: int) -> None:
        """Runs a command that prints a JSON line, and keeps it if it is the best so far."""
        sys.stderr.write(f"{task} {subject}, {envs} copies, {threads} threads\n")
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, timeout=LONGEST_S
            )
        except subprocess.TimeoutExpired:
            self.best.setdefault((task, subject, envs, threads), {"why": f"over {LONGEST_S} s"})
            return
        lines = done.stdout.splitlines()
        if done.returncode or not lines:
            found = {"why": (done.stderr.strip().splitlines() or ["?"])[-1][:200]}
        else:
            found = json.loads(lines[-1])
        key, load = (task, subject, envs, threads), os.getloadavg()[0]
        last = self.best.get(key, {})
        is_better = found.get(RATE, 0) >= last.get(RATE, 0)
        kept = found if is_better else last
        self.best[key] = {**kept, "load": min(load, last.get("load", load))}

    def ours(self, task: str, subject: str, envs: int, threads: int = 1) -> list[str]:
        """The command of one of our subjects."""
        return [
            sys.executable,
            __file__,
            "--subject",
            subject,
            "--tasks",
            task,
            "--envs",
            str(envs),
            "--threads",
            str(threads),
            "--seconds",
            str(self.asked.seconds),
        ]

    def built(self, task: str) -> str | None:
        """The C++ program of a task; None where there is none, or nothing to build it with."""
        source, program = HERE / "cpp" / f"{task}.cpp", self.folder / task
        if not source.exists() or shutil.which("g++") is None:
            return None
        if not program.exists():
            flags = ["-O3", "-march=native", "-ffp-contract=off"]
            subprocess.run(["g++", *flags, str(source), "-o", str(program)], check=True)
        return str(program)

    def speeds(self) -> None:
        """Ours and C++ by turns, then peers at their batch sizes."""
        for _ in range(self.asked.rounds):
            for task in self.asked.tasks:
                program = self.built(task)
                for envs in self.asked.envs:
                    self.run(task, "ours", self.ours(task, "ours", envs), envs, 1)
                    if program:
                        command = [program, str(envs), str(self.asked.seconds)]
                        self.run(task, "c++", command, envs, 1)
        peers = dict(pair.split("=", 1) for pair in self.asked.peer)
        for task in self.asked.tasks:
            for peer in PEERS.get(task, ()):
                if peer not in peers:
                    continue
                script = str(HERE / "peers" / f"kernel_peers_{SCRIPTS[task]}.py")
                more = ["--task", task] if SCRIPTS[task] == "grid" else []
                for envs in [16] if peer in PYTHON_PEERS else [64, *self.asked.envs]:
                    command = [
                        peers[peer],
                        script,
                        peer,
                        *more,
                        "--envs",
                        str(envs),
                        "--seconds",
                        str(self.asked.seconds),
                    ]
                    self.run(task, peer, command, envs, 1)

    def threads(self) -> None:
        """One thread, two threads, two processes."""
        for _ in range(self.asked.rounds):
            for task in self.asked.tasks:
                for envs in self.asked.envs:
                    for count in (1, 2):
                        command = self.ours(task, "ours", envs, count)
                        self.run(task, "ours", command, envs, count)
                    both = [
                        subprocess.Popen(self.ours(task, "ours", envs), stdout=subprocess.PIPE)
                        for _ in range(2)
                    ]
                    told = [json.loads(each.communicate()[0].splitlines()[-1]) for each in both]
                    total = sum(each[RATE] for each in told)
                    key, load = (task, "two_processes", envs, 2), os.getloadavg()[0]
                    if total > self.best.get(key, {}).get(RATE, 0):
                        self.best[key] = {RATE: total, "load": load}

    def compiled(self) -> None:
        """A cold start, with an empty cache, and warm ones; processor seconds."""
        for task in self.asked.tasks:
            with tempfile.TemporaryDirectory() as cache:
                for name in ("cold", "warm", "warm"):
                    more = {"NUMBA_CACHE_DIR": cache, "XDG_CACHE_HOME": cache}
                    environment = {**os.environ, **more}
                    done = subprocess.run(
                        self.ours(task, "start", 64),
                        env=environment,
                        capture_output=True,
                        text=True,
                        check=True,
                    )
                    self.best[task, name, 64, 1] = json.loads(done.stdout.splitlines()[-1])

    def same(self) -> None:
        """C++ and ours play 1,000 steps of the same seeds and actions: the same sums."""
        for task in self.asked.tasks:
            program = self.built(task)
            if program:
                self.best[task, "same_as_c++", 64, 1] = {"same": checked(task, program)}

    def lines(self) -> Iterator[dict[str, Any]]:
        """What was found, beside C++ where that ran."""
        for (task, subject, envs, threads), found in self.best.items():
            mine = found.get(RATE)
            base = self.best.get((task, "c++", envs, 1), {}).get(RATE)
            told = {"figure": FIGURE, "task": task, "subject": subject, "envs": envs}
            ratio = {"to_cpp": round(mine / base, 3)} if mine and base else {}
            rest = {name: value for name, value in found.items() if name not in told}
            yield {**told, "threads": threads, **rest, **ratio}


def checked(task: str, program: str, envs: int = 64, steps: int = 1000) -> bool:
    """Whether C++ shows and pays what ours does."""
    import numpy as np

    from gamekeeper.randomness.seeds import EpisodeSeeds

    seeds, kernel = EpisodeSeeds(5), kernel_of(task)
    command = [program, str(envs), "check", str(seeds.pool), str(seeds.constant)]
    theirs = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    batch = Batch(kernel, envs, seed=5)
    batch.reset()
    (group,) = kernel.groups
    count, state, numbers = 64 * envs * group.count, 12345, []
    for _ in range(count):
        state = (state * 6364136223846793005 + 1442695040888963407) % 2**64
        numbers.append((state >> 33) % int(group.action_space.n))  # type: ignore[attr-defined]  # Discrete
    drawn = np.array(numbers, np.int64).reshape(64, envs, group.count)
    shown = paid = 0.0
    for k in range(steps):
        obs, rewards, _, _ = batch.step(drawn[k % 64])
        shown, paid = shown + obs.sum(dtype=np.float64), paid + rewards.sum()
    return bool(np.allclose([shown, paid], [theirs["shown"], theirs["paid"]], rtol=1e-9))


def main() -> None:
    """Measures what was asked for and prints a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", nargs="+", default=list(ARGUMENTS), choices=list(ARGUMENTS))
    parser.add_argument("--envs", nargs="+", type=int, default=[1024, 4096])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=0.5, help="of each of five parts")
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=PYTHON")
    parser.add_argument(
        "--only", choices=("speed", "threads", "face", "compile", "memory", "check")
    )
    parser.add_argument("--subject", choices=SUBJECTS)
    parser.add_argument("--threads", type=int, default=1)
    asked = parser.parse_args()
    if asked.subject:
        measure = SUBJECTS[asked.subject]
        print(json.dumps(measure(asked.tasks[0], asked.envs[0], asked.threads, asked.seconds)))
        return
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(asked, Path(folder))
        line, whole = "two_robot_line", asked.only is None
        if whole or asked.only == "check":
            bench.same()
        if whole or asked.only == "speed":
            bench.speeds()
        if whole or asked.only == "threads":
            bench.threads()
        if whole or asked.only == "compile":
            bench.compiled()
        if whole or asked.only == "face":
            bench.run(line, "face", bench.ours(line, "face", 1), 1, 1)
        if whole or asked.only == "memory":
            bench.run(line, "memory", bench.ours(line, "memory", 4096), 4096, 1)
        for found in bench.lines():
            print(json.dumps(found))


if __name__ == "__main__":
    main()
