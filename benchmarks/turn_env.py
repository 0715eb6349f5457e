"""What PettingZoo's AEC interface costs a turn: `TurnEnv` beside the documented pattern.

    python benchmarks/turn_env.py [--quick]

Prints one JSON line for each figure: microseconds an agent-turn of `agent_iter`, `last` and `step`
around trivial rules, by number of agents: the median of segments that take turns with each other,
in time of the processor, so that a busy machine slows all of them alike; and the exponent of the
power law fitted to them (0: the cost doesn't grow with the agents, 1: it grows as they do).
"""

import argparse
import json
import math
from collections.abc import Callable
from statistics import median
from time import thread_time
from typing import Any

from gymnasium.spaces import Discrete
from pettingzoo import AECEnv
from pettingzoo.utils import AgentSelector, wrappers

from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv

SIZES = (2, 8, 32, 128, 512, 2048)
SEGMENT_S = 0.02  # long against the clock and the caches, short against what else the machine does
SLOW = 6  # figures that can't keep to it take part in every sixth round


def names(n: int) -> list[str]:
    """The possible agents."""
    return [f"agent_{i}" for i in range(n)]


class Ours(TurnEnv):
    """Trivial rules on the base class: an action pays its agent or doesn't, ends it or doesn't."""

    def __init__(self, n: int, *, pays: bool = True, ends: bool = False) -> None:
        """As many agents as asked for."""
        super().__init__()
        self.possible_agents = names(n)
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}
        self.observation_spaces = self.action_spaces
        self.pays, self.ends = pays, ends

    def observe(self, agent: str) -> int:
        """Nothing to see."""
        return 0

    def act(self, agent: str, action: int) -> None:
        """Pays and ends as it was told to."""
        if self.pays:
            self.add_reward(agent, 1.0)
        if self.ends:
            self.terminate(agent)


class Documented(AECEnv):
    """The same rules in the pattern that PettingZoo's documentation teaches."""

    metadata = {"name": "documented_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way
    render_mode = None

    def __init__(self, n: int, *, pays: bool = True, ends: bool = False) -> None:
        """As many agents as asked for."""
        self.possible_agents = names(n)
        self._action_spaces = {agent: Discrete(3) for agent in self.possible_agents}
        self.pays, self.ends = pays, ends

    def observation_space(self, agent: str) -> Any:
        """The space of an agent's observations."""
        return self._action_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The space of an agent's actions."""
        return self._action_spaces[agent]

    def observe(self, agent: str) -> int:
        """Nothing to see."""
        return 0

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Opens the books."""
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self._agent_selector = AgentSelector(self.agents)
        self.agent_selection = self._agent_selector.next()

    def step(self, action: Any) -> None:
        """Keeps the books by PettingZoo's own helpers."""
        if self.terminations[self.agent_selection] or self.truncations[self.agent_selection]:
            self._was_dead_step(action)
            if self.agents:
                self._agent_selector.reinit(self.agents)
                self.agent_selection = self._agent_selector.next()
            return
        agent = self.agent_selection
        self._clear_rewards()
        self._cumulative_rewards[agent] = 0
        if self.pays:
            self.rewards[agent] += 1
        if self.ends:
            self.terminations[agent] = True
        self.agent_selection = self._agent_selector.next()
        self._accumulate_rewards()
        self._deads_step_first()


def wrapped(n: int, **rules: bool) -> AECEnv:
    """The documented pattern in the documented wrappers: order enforcement and action checks."""
    return wrappers.OrderEnforcingWrapper(wrappers.AssertOutOfBoundsWrapper(Documented(n, **rules)))


class OursTick(TickEnv):
    """Trivial rules on the Parallel base class."""

    def __init__(self, n: int) -> None:
        """As many agents as asked for."""
        super().__init__()
        self.possible_agents = names(n)
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}
        self.observation_spaces = self.action_spaces

    def observe(self, agent: str) -> int:
        """Nothing to see."""
        return 0

    def tick(self, actions: dict[str, int]) -> None:
        """Pays everybody."""
        for agent in actions:
            self.add_reward(agent, 1.0)


def turns_of(env: Any) -> Callable[[int], float]:
    """Plays a number of turns and says how long one took; whole episodes where they end."""

    def play(turns: int) -> float:
        start = thread_time()
        for _ in env.agent_iter(turns):
            _, _, terminated, truncated, _ = env.last()
            env.step(None if terminated or truncated else 1)
        return (thread_time() - start) / turns * 1e6

    env.reset()
    return play


def episodes_of(env: Any) -> Callable[[int], float]:
    """Plays whole episodes, resets included, and says how long a turn took; each agent has two."""

    def play(turns: int) -> float:
        episodes = -(-turns // (2 * len(env.possible_agents)))
        start = thread_time()
        for _ in range(episodes):
            env.reset()
            for _ in env.agent_iter():
                _, _, terminated, truncated, _ = env.last()
                env.step(None if terminated or truncated else 1)
        return (thread_time() - start) / (episodes * 2 * len(env.possible_agents)) * 1e6

    return play


def ticks_of(env: OursTick) -> Callable[[int], float]:
    """Plays whole ticks and says how long an agent's part in one took."""
    env.reset()
    actions = dict.fromkeys(env.agents, 1)

    def play(turns: int) -> float:
        ticks = -(-turns // len(actions))
        start = thread_time()
        for _ in range(ticks):
            env.step(actions)
        return (thread_time() - start) / (ticks * len(actions)) * 1e6

    return play


def snapshots_of(env: Ours) -> Callable[[int], float]:
    """Takes snapshots and puts them back, and says how long such a pair took."""
    env.reset()

    def play(turns: int) -> float:
        start = thread_time()
        for _ in range(turns):
            env.restore(env.snapshot())
        return (thread_time() - start) / turns * 1e6

    return play


def measured(plays: dict[Any, Callable[[int], float]], rounds: int) -> dict[Any, float]:
    """Median cost of each, from segments of some 20 ms, one of each in a round."""
    for play in plays.values():
        play(64)
    sizes = {key: max(8, int(SEGMENT_S / (play(64) * 1e-6))) for key, play in plays.items()}
    seen: dict[Any, list[float]] = {key: [] for key in plays}
    slow: set[Any] = set()
    for number in range(rounds):
        for key, play in plays.items():
            if number % SLOW and key in slow:
                continue
            start = thread_time()
            seen[key].append(play(sizes[key]))
            if thread_time() - start > 5 * SEGMENT_S:
                slow.add(key)
    return {key: median(costs) for key, costs in seen.items()}


def exponent(costs: dict[int, float]) -> float:
    """Slope of the straight line through the logarithms, by least squares."""
    xs = [math.log(n) for n in costs]
    ys = [math.log(cost) for cost in costs.values()]
    x, y = sum(xs) / len(xs), sum(ys) / len(ys)
    over = sum((a - x) * (b - y) for a, b in zip(xs, ys, strict=True))
    return over / sum((a - x) ** 2 for a in xs)


def main() -> None:
    """Measures everything in one run and prints it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few rounds: seconds, and rough")
    rounds = 5 if parser.parse_args().quick else 31
    quiet, paid, ended = {"pays": False}, {"pays": True}, {"pays": True, "ends": True}
    figures: dict[str, Callable[[int], Callable[[int], float]]] = {
        "TurnEnv, nobody paid": lambda n: turns_of(Ours(n, **quiet)),
        "TurnEnv, the actor paid": lambda n: turns_of(Ours(n, **paid)),
        "TurnEnv, all end, one a turn, with resets": lambda n: episodes_of(Ours(n, **ended)),
        "TickEnv, everybody paid": lambda n: ticks_of(OursTick(n)),
        "documented pattern, the actor paid": lambda n: turns_of(Documented(n, **paid)),
        "documented pattern in its wrappers": lambda n: turns_of(wrapped(n, **paid)),
        "documented pattern, all end, with resets": lambda n: episodes_of(Documented(n, **ended)),
        "snapshot and restore, a pair": lambda n: snapshots_of(Ours(n, **paid)),
    }
    plays = {(name, n): make(n) for name, make in figures.items() for n in SIZES}
    costs = measured(plays, rounds)
    for name in figures:
        of = {n: costs[name, n] for n in SIZES}
        line = {
            "figure": name,
            "unit": "us",
            "by_agents": {n: round(cost, 2) for n, cost in of.items()},
            "exponent": round(exponent(of), 3),
        }
        if name.endswith("with resets"):
            line["exponent_from_8"] = round(exponent({n: of[n] for n in SIZES[1:]}), 3)
        print(json.dumps(line))


if __name__ == "__main__":
    main()
