"""Small environments with all that a vector environment has to cope with."""

from typing import Any

import numpy as np
from gymnasium import spaces

import gamekeeper as gk


class Camp(gk.TickEnv):
    """Scouts and a cook with other spaces; one scout leaves early; masks stand in infos."""

    metadata = {"name": "camp_v0"}  # noqa: RUF012

    def __init__(self, length: int = 6) -> None:
        super().__init__()
        self.length = length
        self.possible_agents = ["scout_0", "scout_1", "cook"]
        scout = spaces.Dict({"at": spaces.Box(-9, 9, (2,), np.float32), "n": spaces.Discrete(9)})
        cook = spaces.Box(0, 255, (3,), np.uint8)
        self.observation_spaces = {"scout_0": scout, "scout_1": scout, "cook": cook}
        self.action_spaces = {
            "scout_0": spaces.Discrete(3),
            "scout_1": spaces.Discrete(3),
            "cook": spaces.MultiDiscrete([2, 3]),
        }

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Draws where things are."""
        self.rng, self.time = rng, 0
        self.at = {agent: rng.integers(5) for agent in self.possible_agents}
        self.leaves = 2 + rng.integers(self.length)

    def tick(self, actions: dict[str, Any]) -> None:
        """Pays by what was done; one scout leaves early, a reward comes with it."""
        self.time += 1
        for agent, action in actions.items():
            self.at[agent] = (self.at[agent] + int(np.sum(action)) + self.rng.integers(2)) % 9
            self.add_reward(agent, float(self.at[agent]))
        if self.time == self.leaves and "scout_0" in actions:
            self.terminate("scout_0", "tired")
        if self.time >= self.length + self.leaves:
            for agent in actions:
                self.truncate(agent, "night")

    def observe(self, agent: str) -> Any:
        """Dictionaries for scouts, bytes for the cook."""
        if agent == "cook":
            return np.array([self.at["cook"], self.time, 255], np.uint8)
        place = np.array([self.at[agent], self.time - 4], np.float32)
        return {"at": np.clip(place, -9, 9), "n": np.int64(self.at[agent] % 9)}

    def mask(self, agent: str) -> Any:
        """Not all is always legal."""
        if agent == "cook":
            return np.array([1, 1], np.int8), np.array([1, 0, 1], np.int8)
        return np.array([1, self.at[agent] % 2, 1], np.int8)


class Walk(gk.TickEnv):
    """Two agents of one kind with continuous actions; one of them may fall at any tick."""

    metadata = {"name": "walk_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["a", "b"]
        self.observation_spaces = dict.fromkeys(
            self.possible_agents, spaces.Box(-np.inf, np.inf, (2,), np.float32)
        )
        self.action_spaces = dict.fromkeys(
            self.possible_agents, spaces.Box(-1, 1, (2,), np.float32)
        )

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Both at the origin."""
        self.rng, self.time = rng, 0
        self.at = {agent: np.zeros(2) for agent in self.possible_agents}

    def tick(self, actions: dict[str, Any]) -> None:
        """Walks; falls with probability 0.1, is stopped after ten ticks."""
        self.time += 1
        for agent, action in actions.items():
            self.at[agent] += action
            self.add_reward(agent, float(self.at[agent][0]))
            if self.rng.uniform() < 0.1:
                self.terminate(agent, "fell")
            elif self.time >= 10:
                self.truncate(agent, "time")

    def observe(self, agent: str) -> Any:
        """Where it is."""
        return self.at[agent].astype(np.float32)


class Late(gk.TickEnv):
    """One scout is there from the start, the other and a cook with other spaces join later."""

    metadata = {"name": "late_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["scout_0", "scout_1", "cook"]
        self.observation_spaces = dict.fromkeys(
            self.possible_agents[:2], spaces.Box(0, 99, (1,), np.int64)
        ) | {"cook": spaces.Discrete(100)}
        self.action_spaces = {agent: spaces.Discrete(3) for agent in self.possible_agents}

    def starting_agents(self) -> list[str]:
        """The others join."""
        return ["scout_1"]

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Draws when who joins."""
        self.time, self.joins = 0, {1 + rng.integers(3): "cook", 5 + rng.integers(2): "scout_0"}

    def tick(self, actions: dict[str, Any]) -> None:
        """Pays one's action and the time; all ends after ten ticks."""
        self.time += 1
        for agent, action in actions.items():
            self.add_reward(agent, float(action + self.time))
        if self.time in self.joins:
            self.join(self.joins[self.time])
        if self.time == 10:
            for agent in list(self.agents):
                self.truncate(agent, "night")

    def observe(self, agent: str) -> Any:
        """The time."""
        return self.time if agent == "cook" else np.array([self.time])

    def mask(self, agent: str) -> Any:
        """Now and then there is none: all is legal then."""
        return np.array([1, 0, 1], np.int8) if self.time % 2 == 0 else None


class LateTurns(gk.TurnEnv):
    """Turn by turn; a cook, who has other spaces than the scout, joins in the third turn."""

    metadata = {"name": "late_turns_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["scout", "cook"]
        self.observation_spaces = {
            "scout": spaces.Box(0, 99, (2,), np.float32),
            "cook": spaces.Discrete(100),
        }
        self.action_spaces = {
            "scout": spaces.Discrete(3),
            "cook": spaces.Box(-1, 1, (1,), np.float32),
        }

    def starting_agents(self) -> list[str]:
        """The scout alone."""
        return ["scout"]

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Nothing has happened."""
        self.count = rng.integers(2)

    def act(self, agent: str, action: Any) -> None:
        """Pays the sum of what was done; the cook leaves first."""
        self.count += 1
        self.add_reward(agent, float(np.sum(action)))
        if self.count == 3:
            self.join("cook")
        if self.count == 8 and "cook" in self.agents:
            self.terminate("cook", "fed")
        if self.count >= 12:
            self.truncate("scout", "night")

    def observe(self, agent: str) -> Any:
        """How many turns there were."""
        return self.count if agent == "cook" else np.full(2, self.count, np.float32)


class Raises(Walk):
    """Breaks in its first tick."""

    def tick(self, actions: dict[str, Any]) -> None:
        """Raises."""
        super().tick(actions)
        if self.time == 1:
            raise ValueError("the bridge is out")


class Hangs(Walk):
    """Never comes back from its first tick."""

    def tick(self, actions: dict[str, Any]) -> None:
        """Waits for ever."""
        super().tick(actions)
        while self.time == 1:
            pass


class Dies(Walk):
    """Kills its process in the first tick."""

    def tick(self, actions: dict[str, Any]) -> None:
        """Ends the process without a word."""
        import os
        import signal

        super().tick(actions)
        if self.time == 1:
            os.kill(os.getpid(), signal.SIGKILL)


class Leaves(gk.TurnEnv):
    """Three count turns; `a` ends by its own third turn, `b` by another's, `c` by the horizon."""

    metadata = {"name": "leaves_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["a", "b", "c"]
        seen = spaces.Box(0, 99, (2,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(3))

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Nobody has had a turn."""
        self.count = 0

    def act(self, agent: str, action: Any) -> None:
        """Pays by the action."""
        self.count += 1
        self.add_reward(agent, float(action))
        if self.count == 7:
            self.terminate("a", "tired")
        if self.count == 9:
            self.truncate("b", "sent home")
        if self.count == 14:
            self.terminate("c", "done")

    def mask(self, agent: str) -> Any:
        """The first is never legal."""
        return np.array([0, 1, 1], np.int8)

    def observe(self, agent: str) -> Any:
        """The number of turns, and which place the agent has."""
        return np.array([self.count, self.possible_agents.index(agent)], np.float32)


class Early(gk.TickEnv):
    """Two count ticks; `a` is paid 10 as it ends in the fourth, `b` goes on until the tenth."""

    metadata = {"name": "early_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["a", "b"]
        seen = spaces.Box(0, 10, (1,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(2))

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """No tick yet."""
        self.time = 0

    def tick(self, actions: dict[str, Any]) -> None:
        """Ends them one after the other."""
        self.time += 1
        if self.time == 4:
            self.add_reward("a", 10.0)
            self.terminate("a", "there")
        if self.time == 10:
            self.truncate("b", "night")

    def observe(self, agent: str) -> Any:
        """The time."""
        return np.array([self.time], np.float32)


class Shown(Early):
    """Goes on showing the time to agents that have ended, which breaks PettingZoo's rules."""

    def step(self, actions: Any) -> Any:
        """Shows it to both, always."""
        _, *rest = super().step(actions)
        return {agent: self.observe(agent) for agent in self.possible_agents}, *rest
