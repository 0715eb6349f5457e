"""Two environments without knobs for policies that learn, for benchmarks/learnt.py.

`Plots` (Parallel, Discrete): two harvesters drive to plots of their own, in metres, so that a
network needs its observations normalized. `Lanterns` (AEC, Box): three lanterns rise and move to
places of their own by forces. Nothing is declared, and nothing here uses the diagnosis' own code.
"""

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk

MOVES = np.array([(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)], np.float64)
FIELD, STRIDE, NEAR = 100.0, 9.0, 9.0
REACH = 0.2


class Plots(gk.TickEnv):
    """Harvesters drive to their plots; the day is over once all are there at once."""

    metadata: ClassVar[dict[str, Any]] = {"name": "plots_v0"}

    def __init__(self, day: int = 30, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__(render_mode=render_mode)
        self.day = day
        self.possible_agents = ["harvester_0", "harvester_1"]
        seen = Box(-20.0, FIELD + 20, (5,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = {agent: Discrete(5) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Draws places and plots that lie apart."""
        self.ticks, self.places, self.plots = 0, {}, {}
        for agent in self.possible_agents:
            while True:
                place, plot = ([float(rng.uniform(0, FIELD)) for _ in "xy"] for _ in "ab")
                if min(abs(a - b) for a, b in zip(place, plot, strict=True)) > 2 * STRIDE:
                    break
            self.places[agent], self.plots[agent] = np.array(place), np.array(plot)

    def missing(self, agent: str) -> float:
        """Distance to its plot."""
        return float(np.abs(self.places[agent] - self.plots[agent]).sum())

    def tick(self, actions: Any) -> None:
        """All drive; progress is paid, and all of it once more at the end."""
        self.ticks += 1
        for agent, action in actions.items():
            before = self.missing(agent)
            self.places[agent] = np.clip(
                self.places[agent] + STRIDE * MOVES[int(action)], -10, FIELD + 10
            )
            self.add_reward(agent, (before - self.missing(agent)) / FIELD)
        if all(self.missing(agent) < 2 * NEAR for agent in self.possible_agents):
            for agent in self.possible_agents:
                self.add_reward(agent, 5.0)
                self.terminate(agent, "harvested")
        elif self.ticks >= self.day:
            for agent in self.possible_agents:
                self.truncate(agent, "dusk")

    def observe(self, agent: str) -> Any:
        """Its place, its plot, and the hour."""
        row = [*self.places[agent], *self.plots[agent], self.ticks]
        return np.clip(row, -20, FIELD + 20).astype(np.float32)


class Lanterns(gk.TurnEnv):
    """Three lanterns move by turns, each to a hook of its own."""

    metadata: ClassVar[dict[str, Any]] = {"name": "lanterns_v0"}

    def __init__(self, rounds: int = 20, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__(render_mode=render_mode)
        self.rounds = rounds
        self.possible_agents = ["lantern_0", "lantern_1", "lantern_2"]
        seen, force = Box(-2, 2, (4,), np.float32), Box(-1, 1, (2,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = dict.fromkeys(self.possible_agents, force)

    def start(self, rng: Any, options: Any) -> None:
        """Draws places and hooks that lie apart."""
        self.moves, self.places, self.hooks = 0, {}, {}
        for agent in self.possible_agents:
            while True:
                place, hook = ([float(rng.uniform(-1, 1)) for _ in "xy"] for _ in "ab")
                if min(abs(a - b) for a, b in zip(place, hook, strict=True)) > 2.5 * REACH:
                    break
            self.places[agent], self.hooks[agent] = np.array(place), np.array(hook)

    def missing(self, agent: str) -> float:
        """Distance to its hook."""
        return float(np.abs(self.places[agent] - self.hooks[agent]).max())

    def act(self, agent: str, action: Any) -> None:
        """One moves; progress is paid, and all of it once more at the end."""
        self.moves += 1
        before = self.missing(agent)
        force = np.clip(np.asarray(action, np.float64), -1, 1)
        self.places[agent] = np.clip(self.places[agent] + 0.25 * force, -1.5, 1.5)
        self.add_reward(agent, before - self.missing(agent))
        if all(self.missing(each) < REACH for each in self.possible_agents):
            for each in self.possible_agents:
                self.add_reward(each, 5.0)
                self.terminate(each, "hung")
        elif self.moves >= self.rounds * len(self.possible_agents):
            for each in self.possible_agents:
                self.truncate(each, "late")

    def observe(self, agent: str) -> Any:
        """Its place and its hook."""
        return np.array([*self.places[agent], *self.hooks[agent]], np.float32)
