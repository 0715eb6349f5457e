"""Tasks of benchmarks/pivots.py, and what is true of an episode, by plain loops over environments.

Nothing of the search for pivots is used here. A continuation is played from the reset: the recorded
actions up to a turn, then the task's policy on draws of its own, with other draws of the rules.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.tasks.handover.handover_rules import reference as arm
from gamekeeper.tasks.two_robot_line import DOWN, UP
from gamekeeper.tasks.warehouse.warehouse import reference as robot

Actions = dict[Any, Any]


class Ferry(ParallelEnv):
    """Two rowers keep a boat between the banks for 14 ticks, in gusts that nobody foresees."""

    metadata = {"name": "ferry_v0"}  # noqa: RUF012  # as PettingZoo has it
    possible_agents = ["bow", "stern"]  # noqa: RUF012  # likewise

    def observation_space(self, agent: str) -> Box:
        """Place of the boat, and its drift."""
        return Box(-20.0, 20.0, (2,), np.float64)

    def action_space(self, agent: str) -> Box:
        """A stroke."""
        return Box(-2.0, 2.0, (1,), np.float64)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins a trip."""
        self.agents, self.time, self.out = list(self.possible_agents), 0, False
        self.rng = np.random.default_rng(seed)
        self.at, self.drift = 0.0, 0.0
        return self._seen(), {agent: {} for agent in self.agents}

    def _seen(self) -> Any:
        return {agent: np.array([self.at, self.drift]) for agent in self.possible_agents}

    def step(self, actions: Any) -> Any:
        """Both row, and the wind blows."""
        self.time += 1
        gust = float(self.rng.normal(0.0, 0.3))
        self.drift = 0.5 * self.drift + sum(float(each[0]) for each in actions.values()) + gust
        self.at = float(np.clip(self.at + self.drift, -20, 20))
        self.out |= abs(self.at) > 2.2
        live, over = self.agents, self.time == 14
        self.agents = [] if over else live
        paid = 1.0 if over and not self.out else 0.0
        return (
            self._seen(),
            dict.fromkeys(live, paid),
            dict.fromkeys(live, over),
            dict.fromkeys(live, False),
            {agent: {} for agent in live},
        )


def row(observation: Any, agent: Any, info: Any, rng: Any) -> Any:
    """Steers to the middle, with a hand that shakes."""
    at, drift = observation
    return np.clip([-0.3 * at - 0.25 * drift + rng.normal(0.0, 0.15)], -2.0, 2.0)


def meet(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Walks to the middle of seven cells, and one time in eight anywhere."""
    if rng.random() < 0.125:
        return int(rng.integers(3))
    cell = int(observation[0])
    return UP if cell < 3 else DOWN if cell > 3 else 1


def hand(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """The reference policy, but for one legal action in a hundred and twenty."""
    if rng.random() < 1 / 120:
        return int(rng.choice(np.flatnonzero(info["action_mask"])))
    return arm(observation, agent, info, rng)


def deliver(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """The reference policy, but for one legal action in ten."""
    if rng.random() < 0.1:
        return int(rng.choice(np.flatnonzero(info["action_mask"])))
    return int(robot(observation, agent, info, rng))


LINES = [(0, 1, 2), (3, 4, 5), (6, 7, 8), (0, 3, 6), (1, 4, 7), (2, 5, 8), (0, 4, 8), (2, 4, 6)]


def noughts(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Completes a line, else mostly blocks one, else plays anywhere."""
    planes = observation["observation"].reshape(9, 2)
    legal = np.flatnonzero(observation["action_mask"])
    for plane, chance in ((0, 1.0), (1, 0.8)):
        for line in LINES:
            open_cells = [c for c in line if c in legal]
            is_open = planes[list(line), plane].sum() == 2 and len(open_cells) == 1
            if is_open and rng.random() < chance:
                return int(open_cells[0])
    return int(rng.choice(legal))


def fixed(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Draws nothing: what it plays is a function of the board."""
    legal = np.flatnonzero(observation["action_mask"])
    return int(
        legal[int(observation["observation"].astype(int).ravel() @ np.arange(18)) % len(legal)]
    )


@dataclass(frozen=True)
class Task:
    """A task with a policy for all agents.

    Attributes:
        spec, kwargs: the environment.
        policy: draws only from the stream that it is given.
        failed: the condition of a failed episode, as gk.pivots takes it.
        is_success: the same, of the returns and the environment at the end.
        reseed: gives the rules other draws.
        is_certain: policy and rules draw nothing.
    """

    name: str
    spec: Any
    policy: Callable[..., Any]
    failed: str
    is_success: Callable[[Mapping[str, float], Any], bool]
    kwargs: Mapping[str, Any]
    reseed: Callable[[Any, int], None] = lambda env, number: None
    is_certain: bool = False


def _gusts(env: Any, number: int) -> None:
    env.unwrapped.rng = np.random.default_rng([99, number])


def _is_done(returns: Any, env: Any) -> bool:
    return set(env.unwrapped.endings.values()) == {"done"}


def _paid(returns: Mapping[str, float], env: Any) -> bool:
    return sum(returns.values()) >= 1


def _kept(returns: Mapping[str, float], env: Any) -> bool:
    return returns["player_1"] >= 0


CLASSIC = "pettingzoo.classic.tictactoe_v3:env"
TASKS = {
    task.name: task
    for task in (
        Task("line", "two_robot_line", meet, "return < 1", _paid, {"n": 7, "horizon": 4}),
        Task("handover", "handover", hand, "undelivered > 0", _is_done, {"parts": 2}),
        Task("tictactoe", CLASSIC, noughts, "player_1.return < 0", _kept, {}),
        Task("ferry", Ferry, row, "return < 1", _paid, {}, _gusts),
        Task("certain", CLASSIC, fixed, "player_1.return < 0", _kept, {}, is_certain=True),
    )
}
"""The tasks whose truth is worked out; `certain` is asked for the last action."""
WAREHOUSE = Task("warehouse", "warehouse", deliver, "length > 125", _paid, {"orders": 6})


class Plain:
    """Plays continuations of a task by a plain loop."""

    def __init__(self, task: Task) -> None:
        self.task, self.env = task, gk.make(task.spec, **task.kwargs)

    def succeeds(
        self, seed: int, actions: list[Actions], turn: int, number: int, held: Actions | None = None
    ) -> bool:
        """One continuation from a turn, with these actions of agents at it."""
        env, rngs, returns = self.env, {}, {}
        env.reset(seed=seed)
        self.out = None
        is_parallel = isinstance(env, ParallelEnv)
        if is_parallel:
            self.out = env.reset(seed=seed)
        place = 0
        while env.agents:
            if place == turn:
                self.task.reseed(env, number)
            acts = actions[place] if place < turn else None
            if acts is None:
                acts = self._chosen(rngs, number) | ((held or {}) if place == turn else {})
            if is_parallel:
                out = env.step(acts)
                self.out = out[0], out[4]
                for agent, paid in out[1].items():
                    returns[str(agent)] = returns.get(str(agent), 0.0) + float(paid)
            else:
                env.step(acts[env.agent_selection])
                for agent, paid in env.rewards.items():
                    returns[str(agent)] = returns.get(str(agent), 0.0) + float(paid)
            place += 1
        return self.task.is_success(returns, env)

    def _chosen(self, rngs: dict[Any, Any], number: int) -> Actions:
        env = self.env
        if self.out is None:
            observation, _, terminated, truncated, info = env.last()
            seen = {env.agent_selection: (observation, info)}
            if terminated or truncated:
                return {env.agent_selection: None}
        else:
            seen = {agent: (self.out[0][agent], self.out[1].get(agent)) for agent in env.agents}
        found = {}
        for agent, (observation, info) in seen.items():
            rng = rngs.setdefault(agent, np.random.default_rng([7, number, len(rngs)]))
            found[agent] = self.task.policy(observation, agent, info, rng)
        return found

    def share(
        self, seed: int, actions: list[Actions], turn: int, count: int, held: Any = None
    ) -> float:
        """Share of continuations from a turn that succeed; numbers differ from turn to turn."""
        first = 1_000_003 * (turn + 1)
        hits = (self.succeeds(seed, actions, turn, first + k, held) for k in range(count))
        return sum(hits) / count

    def others(self, actions: Actions) -> list[tuple[Any, Any]]:
        """Every other action of every agent; of a continuous one, nine of its range."""
        found: list[tuple[Any, Any]] = []
        for agent, action in actions.items():
            space = self.env.action_space(agent)
            if action is None:
                continue
            if isinstance(space, Discrete):
                found += [(agent, k) for k in range(int(space.n)) if k != int(action)]
            else:
                found += [(agent, np.full(space.shape, x)) for x in np.linspace(-2, 2, 9)]
        return found
