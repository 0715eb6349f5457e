"""Objects that are handed out, and written to later."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import faulty
from tests.faults.lanterns import Lanterns
from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


@faulty("GK610")
class ViewUsedAgain(Traders):
    """An observation is written into the array that its trader was given before.

    One array for each trader, at every turn.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """An array for each trader."""
        super().reset(seed, options)
        self.views = {a: np.zeros(self.count + 3, np.float32) for a in self.possible_agents}

    def observe(self, agent: str) -> Any:
        """The trader's own array, written anew."""
        self.views[agent][:] = super().observe(agent)
        return self.views[agent]


@faulty("GK611")
class MaskUsedAgain(Rovers):
    """The array in each rover's info is one that is written to at every step.

    One array in all infos of a rover.
    """

    def info(self, agent: str) -> dict[str, Any]:
        """What is left in the battery, in an array."""
        if not hasattr(self, "gauges"):
            self.gauges = {a: np.zeros(1) for a in self.possible_agents}
        self.gauges[agent][0] = self.battery[agent]
        return {"battery": self.battery[agent], "gauge": self.gauges[agent]}


@faulty("GK612")
class StateUsedAgain(Rovers):
    """state() writes into the array that it gave before.

    One array for all states.
    """

    def state(self) -> Any:
        """The same array, written anew."""
        if not hasattr(self, "whole"):
            self.whole = np.zeros(4 * self.count, np.float32)
        self.whole[:] = super().state()
        return self.whole


@faulty("GK613")
class RewardsUsedAgain(Rovers):
    """The rewards of every step come in one dictionary, which is written to.

    One dictionary of rewards.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """A dictionary for all steps."""
        self.paid: dict[str, float] = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """The same dictionary, written anew."""
        observations, rewards, *rest = super().step(actions)
        self.paid.clear()
        self.paid.update(rewards)
        return observations, self.paid, *rest


@faulty("GK614")
class OneViewForAll(Rovers):
    """All rovers are given views of one array that lie upon each other.

    Every rover sees the same array.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """One array for all."""
        observations, *rest = super().step(actions)
        view = next(iter(observations.values()), None)
        return dict.fromkeys(observations, view), *rest


@faulty("GK615")
class OneInfoForAll(Rovers):
    """All rovers are given one dictionary as their info.

    dict.fromkeys with a dictionary.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """One dictionary for all."""
        *rest, infos = super().step(actions)
        info = {"time": self.time}
        return *rest, dict.fromkeys(infos, info)


# The array that all are given is the rules' own.
@faulty("GK615", also=("GK611", "GK621"))
class CellInInfos(Rovers):
    """The infos of all rovers hold the array of batteries that the rules read.

    One array is put into every info.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Takes the batteries as they stand in the infos of the last step."""
        if not self.agents:
            return super().step(actions)
        for place, agent in enumerate(self.possible_agents):
            self.battery[agent] = int(self.levels[place])
        *rest, infos = super().step(actions)
        self.levels = np.array([self.battery[a] for a in self.possible_agents])
        return *rest, {agent: {**info, "levels": self.levels} for agent, info in infos.items()}

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Fills the array."""
        observations, infos = super().reset(seed, options)
        self.levels = np.array([self.battery[a] for a in self.possible_agents])
        return observations, infos


# One array that is handed out to all, at every turn, is also written to.
@faulty("GK620", also=("GK610", "GK614"))
class LevelsAreSeen(Lanterns):
    """The array that the rules read again is the observation itself.

    The observation is the game's own array.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        space = spaces.Box(0.0, 3.0, (self.count,), np.float32)
        self._seen = dict.fromkeys(self.possible_agents, space)

    def observe(self, agent: str) -> Any:
        """The lanterns themselves."""
        return self.level


@faulty("GK621")
class CellsInInfos(Rovers):
    """The cell in a rover's info is the array that the rules read again.

    The info holds the game's own array.
    """

    def info(self, agent: str) -> dict[str, Any]:
        """The rover's cell itself."""
        return {"cell": self.cells[agent]}


# The array that is handed out is also written to.
@faulty("GK622", also=("GK612",))
class StateIsTheGame(Lanterns):
    """state() gives a view of the array that the rules read again.

    The state is the game's own array.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.state_space = spaces.Box(0.0, 3.0, (self.count,), np.float32)

    def state(self) -> Any:
        """The lanterns themselves."""
        return self.level


@faulty("GK623")
class BooksAreReturned(Rovers):
    """step returns the dictionary of infos that it reads again at the next step.

    The environment's own books are returned.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has ended."""
        self.flags: dict[str, bool] = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Returns the books; who was in them before is paid for that."""
        observations, rewards, flags, *rest = super().step(actions)
        rewards = {a: rewards[a] + 0.125 * (a in self.flags) for a in rewards}
        self.flags = flags
        return observations, rewards, self.flags, *rest


@faulty("GK624")
class MaskIsTheRule(Tokens):
    """The mask that is handed out is the array that step asks what is legal.

    The mask is the rule itself.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """The rules' array begins as they have it."""
        super().reset(seed, options)
        self.rule = self.legal()

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask of who is next is the rules' own array."""
        seen = super().observe(agent)
        if agent == self.agent_selection and seen["action_mask"].any():
            seen["action_mask"] = self.rule
        return seen

    def step(self, action: Any) -> None:
        """Asks the array that was handed out."""
        if action is not None and not self.rule[int(action)]:
            raise ValueError(f"cell {action} is taken")
        super().step(action)
        self.rule = self.legal()
