"""Small tasks written on the two base classes, as an author would."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary
from numpy.typing import NDArray

from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv
from gamekeeper.randomness.stream import Stream

Pixels = NDArray[np.uint8]


class _Track:
    """Runners on a track of 9 cells: the state, what is seen of it, and how it is drawn."""

    metadata = {"name": "relay_v0", "render_modes": ["human", "ansi", "rgb_array"]}  # noqa: RUF012

    possible_agents: list[str]
    render_mode: str | None
    drawn = 0

    def _build(self, n: int) -> None:
        self.possible_agents = [f"runner_{i}" for i in range(n)]
        self.observation_spaces = {
            agent: Box(0.0, 9.0, (2,), np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}
        self.state_space = Box(0.0, 9.0, (n + 1,), np.float32)

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        self.rng = rng
        self.goal = float(options.get("goal", rng.integers(6, 10)))
        self.cells = dict.fromkeys(self.possible_agents, 0.0)

    def run(self, agent: str, action: int) -> None:
        """One step ahead of 0, 1 or 2 cells; it slips back with the wind of 0 to 1 cells."""
        ahead = action - self.rng.uniform()
        self.cells[agent] = min(max(self.cells[agent] + ahead, 0.0), self.goal)

    def observe(self, agent: str) -> NDArray[np.float32]:
        return np.array([self.cells[agent], self.goal], np.float32)

    def state(self) -> NDArray[np.float32]:
        return np.array([*self.cells.values(), self.goal], np.float32)

    def render(self) -> str | Pixels | None:
        self.drawn += 1
        if self.render_mode == "ansi":
            return " ".join(f"{cell:.1f}" for cell in self.cells.values())
        if self.render_mode == "rgb_array":
            return np.full((4, 4, 3), int(self.goal), np.uint8)
        return None


class TurnRelay(_Track, TurnEnv):
    """Runners move one after the other; who reaches the goal is paid and leaves."""

    def __init__(self, n: int = 3, render_mode: str | None = None, max_cycles: int = 30) -> None:
        super().__init__(render_mode=render_mode, horizon=max_cycles)
        self._build(n)

    def act(self, agent: str, action: int) -> None:
        self.run(agent, action)
        self.add_reward(agent, -0.1, term="time")
        if self.cells[agent] == self.goal:
            for each in self.agents:
                self.add_reward(each, 1.0, term="goal")
            self.terminate(agent, "arrived")


class TickRelay(_Track, TickEnv):
    """Runners move at the same time; who reaches the goal is paid and leaves."""

    def __init__(self, n: int = 3, render_mode: str | None = None, max_cycles: int = 30) -> None:
        super().__init__(render_mode=render_mode, horizon=max_cycles)
        self._build(n)

    def tick(self, actions: dict[str, int]) -> None:
        self.order = list(actions)
        for agent, action in actions.items():
            self.run(agent, action)
            self.add_reward(agent, -0.1, term="time")
            if self.cells[agent] == self.goal:
                self.terminate(agent, "arrived")
                self.add_reward(agent, 1.0, term="goal")


class _Tickets:
    """Numbered tickets 5 to 8, each to be taken once: who takes what is shown by a mask."""

    def _build(self) -> None:
        self.possible_agents = ["taker_0", "taker_1"]
        self.observation_spaces = {
            agent: Dict(observation=Box(0.0, 4.0, (1,), np.float32), action_mask=MultiBinary(4))
            for agent in self.possible_agents
        }
        self.action_spaces = {agent: Discrete(4, start=5) for agent in self.possible_agents}

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        self.free = [True] * 4
        self.asked = 0

    def observe(self, agent: str) -> dict[str, Any]:
        return {"observation": np.array([sum(self.free)], np.float32)}

    def mask(self, agent: str) -> list[bool]:
        self.asked += 1
        return self.free

    def info(self, agent: str) -> dict[str, Any]:
        return {"free": sum(self.free)}


class TurnTickets(_Tickets, TurnEnv):
    """One taker after the other."""

    def __init__(self) -> None:
        super().__init__()
        self._build()

    def act(self, agent: str, action: int) -> None:
        self.taken = action
        self.free[action - 5] = False
        if not any(self.free):
            for each in self.agents:
                self.terminate(each)


class TickTickets(_Tickets, TickEnv):
    """Both takers at once; the same ticket may go to both."""

    def __init__(self) -> None:
        super().__init__()
        self._build()

    def tick(self, actions: dict[str, int]) -> None:
        self.taken = dict(actions)
        for ticket in actions.values():
            self.free[ticket - 5] = False
        if not any(self.free):
            for each in self.agents:
                self.terminate(each)


class FinedTurnTickets(TurnTickets):
    """Who takes what is gone pays for it and takes nothing."""

    def illegal(self, agent: str, action: Any) -> None:
        self.add_reward(agent, -1.0, term="fine")


class FinedTickTickets(TickTickets):
    """Who takes what is gone pays for it; the second taker gets ticket 8 instead."""

    def illegal(self, agent: str, action: Any) -> int | None:
        self.add_reward(agent, -1.0, term="fine")
        return 8 if agent == "taker_1" else None


def env(**given: Any) -> TurnRelay:
    """What PettingZoo's max_cycles_test calls."""
    return TurnRelay(**given)


def parallel_env(**given: Any) -> TickRelay:
    """What PettingZoo's max_cycles_test calls."""
    return TickRelay(**given)


def played(env: Any, turns: int = 200) -> list[Any]:
    """What a fixed policy is given, turn by turn."""
    seen = []
    for agent in env.agent_iter(turns):
        observation, reward, terminated, truncated, info = env.last()
        seen.append((agent, repr(observation), reward, terminated, truncated, repr(info)))
        env.step(None if terminated or truncated else 1 + env.turns % 2)
    return seen
