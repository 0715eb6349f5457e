"""Copies of one environment, stepped together: `gk.vector` beside a plain loop and its peers.

The work is the same for all: 64 copies, the same numbers of steps, random actions drawn beforehand,
every observation and reward as an array at hand after each step (the plain loop keeps dictionaries,
as whoever writes it would). Every subject runs in a process of its own, in rounds that go through
all subjects in another order each; the figure is the best round's agent-steps a second of wall
time, resets included. `two_loops` are two plain loops over half of the copies each, in processes
that know nothing of each other: what this machine's two cores can give at best.

    python benchmarks/vector.py [--tasks spread rware line textbook] [--rounds 3] [--seconds 4]
    python benchmarks/vector.py --peer supersuit=PATH/bin/python --peer agilerl=PATH/bin/python

Peers live in environments of their own; benchmarks/peers/supersuit.in and agilerl.in name them
(`requirements/setup.sh make DIR && requirements/setup.sh install DIR benchmarks/peers/NAME.in`;
AgileRL's without Gamekeeper, which wants a newer PettingZoo: `DIR/bin/python -m pip install
-r benchmarks/peers/agilerl.in`, several gigabytes). mpe2 and rware stand in the
first of them, whose Python is a good one for this script. PufferLib 3 and 2 don't install from the
index alone: their build fetches files from elsewhere.

One JSON line a subject: {"figure", "task", "subject", "agent_steps_s", "to_loop", "why"}.
"""

import argparse
import json
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

FIGURE: Final = "vector"
COPIES: Final = 64
TASKS: Final = {
    "spread": "mpe2.simple_spread_v3:parallel_env",
    "rware": "rware:rware-tiny-2ag-v2",
    "line": "two_robot_line",
    "textbook": str(Path(__file__).with_name("textbook_line.py")) + ":parallel_env",
}
OURS: Final = (
    "loop",
    "two_loops",
    "serial",
    "process",
    "kernel",
    "gymnasium_sync",
    "gymnasium_async",
)
WITH_KERNEL: Final = frozenset({"line"})
PEERS: Final = {"supersuit": ("supersuit_0", "supersuit_2"), "agilerl": ("agilerl",)}
WARM: Final = 8
"""Steps before the clock."""


# -- subjects, each in a process of its own


def environment(task: str) -> Any:
    """One copy as it ships."""
    import gamekeeper as gk

    return gk.make(TASKS[task], slim=False)


def loop(task: str, copies: int = COPIES) -> Callable[[int], int]:
    """A plain loop over the copies."""
    envs = [environment(task) for _ in range(copies)]
    drawn = _drawn(envs[0])
    for seed, env in enumerate(envs):
        env.reset(seed=seed)

    def step(number: int) -> int:
        done = 0
        for env in envs:
            agents = env.agents
            actions = drawn[number % len(drawn)]
            env.step({agent: actions[agent] for agent in agents})
            done += len(agents)
            if not env.agents:
                env.reset()
        return done

    return step


def halves(task: str, seconds: float) -> dict[str, Any]:
    """Two plain loops at once, over half of the copies each."""
    command = [sys.executable, __file__, "--subject", "loop", "--task", task]
    more = ["--seconds", str(seconds), "--copies", str(COPIES // 2)]
    both = [subprocess.Popen([*command, *more], stdout=subprocess.PIPE) for _ in range(2)]
    found = [json.loads(each.communicate()[0])["agent_steps_s"] for each in both]
    return {"agent_steps_s": sum(found)}


def _drawn(env: Any) -> list[dict[Any, Any]]:
    """Sixteen joint actions."""
    spaces = {agent: env.action_space(agent) for agent in env.possible_agents}
    for number, space in enumerate(spaces.values()):
        space.seed(number)
    return [{agent: space.sample() for agent, space in spaces.items()} for _ in range(16)]


def serial(task: str, **options: Any) -> Callable[[int], int]:
    """`gk.vector` in this process."""
    import gamekeeper as gk

    venv = gk.vector.make(TASKS[task], COPIES, **options)
    venv.action_space.seed(0)
    drawn = [venv.action_space.sample() for _ in range(16)]
    _, infos = venv.reset(seed=0)
    live = int(infos["live"].sum())

    def step(number: int) -> int:
        nonlocal live
        done = live
        live = int(venv.step(drawn[number % 16])[4]["live"].sum())
        return done

    return step


def process(task: str) -> Callable[[int], int]:
    """`gk.vector` in two workers."""
    return serial(task, engine="process", workers=2)


def kernel(task: str) -> Callable[[int], int]:
    """`gk.vector` over compiled rules."""
    return serial(task, engine="kernel")


def gymnasium_sync(task: str) -> Callable[[int], int]:
    """Gymnasium's SyncVectorEnv over the joint environment."""
    from gymnasium.vector import SyncVectorEnv

    return _gymnasium(task, SyncVectorEnv)


def gymnasium_async(task: str) -> Callable[[int], int]:
    """Gymnasium's AsyncVectorEnv over the joint environment: a process for each copy."""
    from gymnasium.vector import AsyncVectorEnv

    return _gymnasium(task, AsyncVectorEnv)


def _gymnasium(task: str, kind: Any) -> Callable[[int], int]:
    def one() -> Any:
        return joint(environment(task))

    venv = kind([one] * COPIES)
    agents = one().agents_count
    venv.action_space.seed(0)
    drawn = [venv.action_space.sample() for _ in range(16)]
    venv.reset(seed=0)

    def step(number: int) -> int:
        venv.step(drawn[number % 16])
        return COPIES * agents

    return step


def joint(env: Any) -> Any:
    """All agents of a Parallel environment as one of Gymnasium's: observations side by side."""
    import gymnasium
    import numpy as np
    from gymnasium.spaces import Tuple
    from gymnasium.vector.utils import batch_space

    class Joint(gymnasium.Env[Any, Any]):
        agents_count = len(env.possible_agents)

        def __init__(self) -> None:
            names = env.possible_agents
            self.observation_space = batch_space(env.observation_space(names[0]), len(names))
            spaces = [env.action_space(name) for name in names]
            self.action_space = (
                batch_space(spaces[0], len(names))
                if len(set(map(str, spaces))) == 1
                else Tuple(spaces)
            )

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            observations, _ = env.reset(seed=seed)
            return np.stack([observations[name] for name in env.possible_agents]), {}

        def step(self, action: Any) -> Any:
            acts = {name: action[k] for k, name in enumerate(env.possible_agents)}
            observations, rewards, terms, _truncs, _ = env.step(acts)
            stacked = np.stack([observations[name] for name in env.possible_agents])
            is_over = not env.agents
            return stacked, sum(rewards.values()), is_over and any(terms.values()), is_over, {}

    return Joint()


def measured(subject: str, task: str, seconds: float, copies: int) -> dict[str, Any]:
    """Agent-steps a second of one subject in this process."""
    if subject == "two_loops":
        return halves(task, seconds)
    step = loop(task, copies) if subject == "loop" else globals()[subject](task)
    for number in range(WARM):
        step(number)
    done, number, begun_s = 0, WARM, time.perf_counter()
    while time.perf_counter() - begun_s < seconds:
        done += step(number)
        number += 1
    return {"agent_steps_s": round(done / (time.perf_counter() - begun_s))}


# -- the run


def runs(arguments: argparse.Namespace) -> Iterator[tuple[str, str, list[str]]]:
    """Task, subject and command of everything that is measured."""
    peers = dict(each.split("=", 1) for each in arguments.peer)
    here = Path(__file__)
    for task in arguments.tasks:
        for subject in OURS:
            if subject == "kernel" and task not in WITH_KERNEL:
                continue
            yield task, subject, [sys.executable, str(here), "--subject", subject]
        for peer, subjects in PEERS.items():
            for subject in subjects:
                script = here.parent / "peers" / "vector_peers.py"
                python = peers.get(peer)
                yield task, subject, [] if python is None else [python, str(script), subject]


def main() -> None:
    """Measures everything in rounds and prints a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--peer", action="append", default=[], metavar="NAME=PYTHON")
    parser.add_argument("--subject", choices=OURS)
    parser.add_argument("--task", choices=list(TASKS))
    parser.add_argument("--copies", type=int, default=COPIES)
    arguments = parser.parse_args()
    if arguments.subject:
        print(
            json.dumps(
                measured(arguments.subject, arguments.task, arguments.seconds, arguments.copies)
            )
        )
        return
    everything = list(runs(arguments))
    best: dict[tuple[str, str], int] = {}
    why: dict[tuple[str, str], str] = {}
    for number in range(arguments.rounds):
        order = everything[:]
        random.Random(number).shuffle(order)
        for task, subject, command in order:
            key = task, subject
            if not command:
                why[key] = "its environment isn't installed: see --peer"
                continue
            more = ["--task", task, "--seconds", str(arguments.seconds)]
            done = subprocess.run([*command, *more], capture_output=True, text=True, timeout=600)
            if done.returncode:
                why[key] = (done.stderr.strip().splitlines() or ["?"])[-1][:200]
                continue
            found = json.loads(done.stdout.splitlines()[-1])["agent_steps_s"]
            best[key] = max(best.get(key, 0), found)
    for task, subject, _ in everything:
        figure, base = best.get((task, subject)), best.get((task, "loop"))
        ratio = None if figure is None or not base else round(figure / base, 3)
        print(
            json.dumps(
                {
                    "figure": FIGURE,
                    "task": task,
                    "subject": subject,
                    "agent_steps_s": figure,
                    "to_loop": ratio,
                    "why": why.get((task, subject)) if figure is None else None,
                }
            )
        )


if __name__ == "__main__":
    main()
