"""Base classes beside careful plain environments of the same rules, copies included.

    python benchmarks/base_classes.py [--quick]

Gatherers walk on a grid and pick up food, which comes back elsewhere by chance; each sees its own
place and where the food is, exactly or (noisy) with two normal numbers drawn at each move. The
rules stand once. Around them: `TickEnv` and `TurnEnv`, which copy and convert what `observe`
returns; and a ParallelEnv and an AECEnv as a careful author writes them, whose own code keeps
PettingZoo's promises, refuses actions outside the space, draws from NumPy's generator and copies.
Prints one JSON line for each pair and number of agents: agent steps a second of each, and their
ratio; the median of segments that take turns with each other, in time of the processor, resets
included.
"""

import argparse
import json
from collections.abc import Callable
from statistics import median
from time import thread_time
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv

SIZES = (2, 8, 64)
SEGMENT_S = 0.05
SIDE = 16
HORIZON = 50
MOVES = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))


class Rules:
    """The grid: where gatherers and food are, in one array that the next move overwrites."""

    def begin(self, n: int, rng: Any, *, is_noisy: bool) -> None:
        """Everybody and the food, anywhere."""
        self.rng, self.is_noisy = rng, is_noisy
        self.places = [[int(rng.integers(SIDE)), int(rng.integers(SIDE))] for _ in range(n)]
        self.views = np.zeros((n, 4), np.float32)
        self.views[:, :2] = self.places
        self.feed()

    def feed(self) -> None:
        """Food in another place, which all see."""
        self.food = [int(self.rng.integers(SIDE)), int(self.rng.integers(SIDE))]
        self.views[:, 2:] = self.food

    def move(self, i: int, action: int) -> float:
        """A gatherer goes a step, and is paid if there is food."""
        place, (x, y) = self.places[i], MOVES[action]
        place[0] = min(max(place[0] + x, 0), SIDE - 1)
        place[1] = min(max(place[1] + y, 0), SIDE - 1)
        if self.is_noisy:
            noise = self.rng.normal
            self.views[i, 0], self.views[i, 1] = place[0] + noise(), place[1] + noise()
        else:
            self.views[i, 0], self.views[i, 1] = place
        if place != self.food:
            return 0.0
        self.feed()
        return 1.0


def spaces_of(agents: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Spaces of the observations and of the actions."""
    sight = Box(0, SIDE, (4,), np.float32)
    return dict.fromkeys(agents, sight), {agent: Discrete(5) for agent in agents}


def names(n: int) -> list[str]:
    """The possible agents."""
    return [f"gatherer_{i}" for i in range(n)]


class Ours:
    """Rules on either base class."""

    def __init__(self, n: int, *, is_noisy: bool) -> None:
        super().__init__(horizon=HORIZON)  # type: ignore[call-arg]  # the base class
        self.is_noisy = is_noisy
        self.possible_agents = names(n)
        self.index = {agent: i for i, agent in enumerate(self.possible_agents)}
        self.observation_spaces, self.action_spaces = spaces_of(self.possible_agents)

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Makes the grid."""
        self.rules = Rules()
        self.rules.begin(len(self.index), rng, is_noisy=self.is_noisy)

    def observe(self, agent: str) -> Any:
        """Row of the views."""
        return self.rules.views[self.index[agent]]


class OurTicks(Ours, TickEnv):
    """All at once."""

    metadata = {"name": "our_ticks_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way

    def tick(self, actions: dict[str, int]) -> None:
        """Moves everybody."""
        for agent, action in actions.items():
            paid = self.rules.move(self.index[agent], action)
            if paid:
                self.add_reward(agent, paid)


class OurTurns(Ours, TurnEnv):
    """One after the other."""

    metadata = {"name": "our_turns_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way

    def act(self, agent: str, action: int) -> None:
        """Moves one."""
        paid = self.rules.move(self.index[agent], action)
        if paid:
            self.add_reward(agent, paid)


class Plain:
    """Spaces, seeds and actions, as a careful author writes them for either API."""

    render_mode = None

    def __init__(self, n: int, *, is_noisy: bool) -> None:
        self.is_noisy = is_noisy
        self.possible_agents = names(n)
        self.index = {agent: i for i, agent in enumerate(self.possible_agents)}
        self.observation_spaces, self.action_spaces = spaces_of(self.possible_agents)
        self.rules, self.rng = Rules(), np.random.default_rng()

    def observation_space(self, agent: str) -> Any:
        """The space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The space of an agent's actions."""
        return self.action_spaces[agent]

    def observe(self, agent: str) -> Any:
        """Row of the views."""
        return self.rules.views[self.index[agent]].copy()

    def begin(self, seed: int | None) -> None:
        """Opens an episode."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents, self.ticks = self.possible_agents[:], 0
        self.rules.begin(len(self.agents), self.rng, is_noisy=self.is_noisy)

    def refuse(self, agent: str, action: Any) -> None:
        """Raises where an action isn't in its space."""
        if not self.action_spaces[agent].contains(action):
            raise ValueError(f"{agent} did {action!r}, which isn't in its space")


class PlainTicks(Plain, ParallelEnv):  # type: ignore[type-arg,misc]
    """A careful ParallelEnv."""

    metadata = {"name": "plain_ticks_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins an episode."""
        self.begin(seed)
        return {a: self.observe(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """Plays one step."""
        if set(actions) != set(self.agents):
            raise ValueError(f"actions of {list(actions)}, and {self.agents} are live")
        for agent, action in actions.items():
            self.refuse(agent, action)
        rewards = dict.fromkeys(self.agents, 0.0)
        for agent in self.agents:
            rewards[agent] += self.rules.move(self.index[agent], int(actions[agent]))
        self.ticks += 1
        is_over = self.ticks == HORIZON
        observations = {agent: self.observe(agent) for agent in self.agents}
        terminations = dict.fromkeys(self.agents, False)
        truncations = dict.fromkeys(self.agents, is_over)
        infos: dict[str, Any] = {agent: {} for agent in self.agents}
        if is_over:
            self.agents = []
        return observations, rewards, terminations, truncations, infos


class PlainTurns(Plain, AECEnv):  # type: ignore[type-arg,misc]
    """A careful AECEnv, in the pattern that PettingZoo's documentation teaches."""

    metadata = {"name": "plain_turns_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Begins an episode."""
        self.begin(seed)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.turn = 0
        self.agent_selection = self.agents[0]

    def step(self, action: Any) -> None:
        """Plays one step."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self.refuse(agent, action)
        self._clear_rewards()
        self._cumulative_rewards[agent] = 0.0
        self.rewards[agent] += self.rules.move(self.index[agent], int(action))
        self.turn += 1
        if self.turn == len(self.agents):
            self.turn, self.ticks = 0, self.ticks + 1
            if self.ticks == HORIZON:
                self.truncations = dict.fromkeys(self.agents, True)
        self.agent_selection = self.agents[self.turn]
        self._accumulate_rewards()


def ticks_of(env: Any) -> Callable[[int], float]:
    """Plays whole episodes of ticks, and says how many seconds an agent step took."""
    n = len(env.possible_agents)
    drawn = np.random.default_rng(0).integers(5, size=(HORIZON, n))
    actions = [dict(zip(env.possible_agents, row, strict=True)) for row in drawn]

    def play(episodes: int) -> float:
        start = thread_time()
        for episode in range(episodes):
            env.reset(seed=episode)
            for each in actions:
                env.step(each)
        return (thread_time() - start) / (episodes * HORIZON * n)

    return play


def turns_of(env: Any) -> Callable[[int], float]:
    """Plays whole episodes of turns, and says how many seconds an agent step took."""
    n = len(env.possible_agents)
    actions = np.random.default_rng(0).integers(5, size=HORIZON * n)

    def play(episodes: int) -> float:
        start = thread_time()
        for episode in range(episodes):
            env.reset(seed=episode)
            number = 0
            for _ in env.agent_iter():
                _, _, terminated, truncated, _ = env.last()
                if terminated or truncated:
                    env.step(None)
                else:
                    env.step(actions[number])
                    number += 1
        return (thread_time() - start) / (episodes * HORIZON * n)

    return play


def measured(plays: dict[Any, Callable[[int], float]], rounds: int) -> dict[Any, float]:
    """Median seconds of each, from segments one of each in a round."""
    sizes = {}
    for key, play in plays.items():
        play(1)
        agents = key[2]
        sizes[key] = max(1, int(SEGMENT_S / (play(2) * HORIZON * agents)))
    seen: dict[Any, list[float]] = {key: [] for key in plays}
    for _ in range(rounds):
        for key, play in plays.items():
            seen[key].append(play(sizes[key]))
    return {key: median(costs) for key, costs in seen.items()}


def main() -> None:
    """Measures everything in one run and prints it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few rounds: seconds, and rough")
    rounds = 5 if parser.parse_args().quick else 31
    pairs: dict[str, tuple[Any, Any, Any]] = {
        "TickEnv": (OurTicks, PlainTicks, ticks_of),
        "TurnEnv": (OurTurns, PlainTurns, turns_of),
    }
    plays = {
        (name, is_noisy, n, which): play(kinds[which](n, is_noisy=is_noisy))
        for name, (*kinds, play) in pairs.items()
        for is_noisy in (False, True)
        for n in SIZES
        for which in (0, 1)
    }
    costs = measured(plays, rounds)
    for name, is_noisy, n, which in plays:
        if which == 0:
            ours, plain = costs[name, is_noisy, n, 0], costs[name, is_noisy, n, 1]
            line = {
                "figure": f"{name}, noisy" if is_noisy else name,
                "agents": n,
                "agent_steps_per_s": round(1 / ours),
                "plain": round(1 / plain),
                "ratio": round(plain / ours, 3),
            }
            print(json.dumps(line))


if __name__ == "__main__":
    main()
