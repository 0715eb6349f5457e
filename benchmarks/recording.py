"""What recording adds to a step, against the bare environment, paired in one run.

Prints a JSON line for each task: medians over interleaved segments, in microseconds of wall time
per agent-step, closing the run included, with the least and the most; ratios are of paired
segments. `bytes` is the size of the finalized run per agent-step.

    python benchmarks/recording.py [--tasks two_robot_line,spread,...] [--segments 15]
"""

import argparse
import json
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from pettingzoo import AECEnv
from pettingzoo.utils import AgentSelector

import gamekeeper as gk

ROOT = Path(__file__).resolve().parent.parent


class Documented(AECEnv):
    """Trivial rules in PettingZoo's documented pattern: rewards cleared and added up each turn."""

    metadata: ClassVar = {"name": "documented_v0", "is_parallelizable": False}

    def __init__(self, n: int, turns: int) -> None:
        self.possible_agents = [f"agent_{i}" for i in range(n)]
        self.observation_spaces = dict.fromkeys(
            self.possible_agents, gymnasium.spaces.Box(-1, 1, (4,), np.float32)
        )
        self.action_spaces = dict.fromkeys(self.possible_agents, gymnasium.spaces.Discrete(3))
        self.turns, self.render_mode = turns, None
        self.view = np.zeros(4, np.float32)

    def observation_space(self, agent: str) -> Any:
        """The space of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The space of an agent."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """A new episode."""
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.selector = AgentSelector(self.agents)
        self.agent_selection = self.selector.next()
        self.turn = 0

    def observe(self, agent: str) -> Any:
        """The same array always."""
        return self.view

    def step(self, action: Any) -> None:
        """One turn."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0
        self._clear_rewards()
        self.rewards[agent] = float(action - 1)
        self.turn += 1
        if self.turn >= self.turns:
            self.truncations = dict.fromkeys(self.agents, True)
        self.agent_selection = self.selector.next()
        self._accumulate_rewards()


class Ours(gk.TurnEnv):
    """The same rules on our base class."""

    metadata: ClassVar = {"name": "ours_v0"}

    def __init__(self, n: int, turns: int) -> None:
        super().__init__()
        self.possible_agents = [f"agent_{i}" for i in range(n)]
        space = gymnasium.spaces.Box(-1, 1, (4,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, space)
        self.action_spaces = dict.fromkeys(self.possible_agents, gymnasium.spaces.Discrete(3))
        self.turn_limit = turns
        self.view = np.zeros(4, np.float32)

    def start(self, rng: Any, options: Any) -> None:
        """A new episode."""
        self.turn = 0

    def observe(self, agent: str) -> Any:
        """The same array always."""
        return self.view

    def act(self, agent: str, action: int) -> None:
        """One turn."""
        self.add_reward(agent, float(action - 1))
        self.turn += 1
        if self.turn >= self.turn_limit:
            for each in self.agents:
                self.truncate(each, "limit")


def play_parallel(env: Any, steps: int, rng: Any) -> int:
    """Random play for `steps` ticks; returns agent-steps."""
    count = done = 0
    seed = 0
    while done < steps:
        env.reset(seed=seed)
        seed += 1
        sizes = {agent: _size(env.action_space(agent)) for agent in env.agents}
        while env.agents and done < steps:
            draws = rng.random(len(env.agents))
            actions = {a: sizes[a](d) for a, d in zip(env.agents, draws, strict=True)}
            count += len(actions)
            env.step(actions)
            done += 1
    return count


def play_aec(env: Any, steps: int, rng: Any) -> int:
    """Random play for `steps` turns in the loop that PettingZoo documents; returns agent-steps."""
    env.reset(seed=0)
    done = 0
    draws = iter(rng.integers(3, size=steps + 1).tolist())
    for _ in env.agent_iter():
        _, _, terminated, truncated, _ = env.last()
        done += not (terminated or truncated)
        if done > steps:
            break
        env.step(None if terminated or truncated else next(draws))
    return min(done, steps)


def _size(space: Any) -> Callable[[float], Any]:
    if isinstance(space, gymnasium.spaces.Discrete):
        n = int(space.n)
        return lambda draw: int(draw * n)
    low, high, dtype = space.low, space.high, space.dtype
    return lambda draw: (low + draw * (high - low)).astype(dtype)


def tasks() -> Iterator[tuple[str, Callable[[], Any], Callable[..., int], int]]:
    """Name, factory, player and turns of a segment."""
    line = f"{ROOT / 'examples' / 'two_robot_line.py'}:make"
    yield "two_robot_line", lambda: gk.make(line), play_parallel, 100_000
    for n in (2, 8, 32, 128, 512):
        turns = 200_000
        yield f"aec_ours_{n}", lambda n=n, t=turns: Ours(n, t), play_aec, turns
        turns = 200_000 if n < 32 else 20_000
        yield f"aec_documented_{n}", lambda n=n, t=turns: Documented(n, t), play_aec, turns
    yield "spread", _spread, play_parallel, 10_000
    yield "pistonball", _pistonball, play_parallel, 250


def _spread() -> Any:
    from mpe2 import simple_spread_v3

    return simple_spread_v3.parallel_env()


def _pistonball() -> Any:
    from pettingzoo.butterfly import pistonball_v6

    return pistonball_v6.parallel_env(render_mode="rgb_array")


def measure(
    make: Callable[[], Any], player: Callable[..., int], turns: int, folder: Path, kind: str
) -> tuple[float, float]:
    """Seconds and bytes of a run per agent-step, from a fresh environment to a closed one."""
    env = make()
    if kind != "bare":
        env = gk.record(env, folder / "run", level=kind)
    rng = np.random.default_rng(0)
    start = time.perf_counter()
    count = player(env, turns, rng)
    env.close()
    seconds = time.perf_counter() - start
    size = sum(file.stat().st_size for file in (folder / "run").rglob("*") if file.is_file())
    shutil.rmtree(folder / "run", ignore_errors=True)
    return seconds / count, size / count


def spread(name: str, values: list[float], digits: int) -> dict[str, float]:
    """The median of paired segments, and between what they lie."""
    return {
        name: round(statistics.median(values), digits),
        f"{name}_low": round(min(values), digits),
        f"{name}_high": round(max(values), digits),
    }


def main() -> None:
    """Measures the tasks asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", default="")
    parser.add_argument("--segments", type=int, default=15)
    options = parser.parse_args()
    wanted = [part for part in options.tasks.split(",") if part]
    for name, make, player, turns in tasks():
        if wanted and not any(name.startswith(part) for part in wanted):
            continue
        kinds = ("bare", "full", "digest", "actions")
        times: dict[str, list[float]] = {kind: [] for kind in kinds}
        sizes: dict[str, float] = {}
        with tempfile.TemporaryDirectory() as folder:
            for segment in range(options.segments + 1):
                for kind in kinds[segment % 4 :] + kinds[: segment % 4]:
                    seconds, size = measure(make, player, turns, Path(folder), kind)
                    sizes[kind] = size
                    if segment:
                        times[kind].append(seconds * 1e6)
        bare = times["bare"]
        row: dict[str, Any] = {
            "figure": "recording",
            "task": name,
            "bare_us": round(statistics.median(bare), 2),
        }
        for kind in kinds[1:]:
            pairs = list(zip(times[kind], bare, strict=True))
            row |= spread(f"{kind}_added_us", [a - b for a, b in pairs], 2)
            row |= spread(f"{kind}_ratio", [a / b for a, b in pairs], 3)
            row[f"{kind}_bytes"] = round(sizes[kind], 2)
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
