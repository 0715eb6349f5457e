"""Two small environments without knobs for benchmarks/fresh.py, with policies that do well in them.

`Lock` (AEC, Discrete): a keeper sets the water of a lock for barges that whistle, pass and moor.
`Glasshouse` (Parallel, Dict): two drones fly to their plants while a heater reaches a temperature.
Nothing is declared of them, and nothing here uses the diagnosis' own code.
"""

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete
from pettingzoo import ParallelEnv

import gamekeeper as gk

GATE, LEVELS, QUAYS = 3, 5, 8
STAY, AHEAD, BACK, WHISTLE, MOOR = range(5)
CLOSE = 0.15


class Lock(gk.TurnEnv):
    """Barges pass a gate whose water has to stand at their own level, and moor at their quay."""

    metadata: ClassVar[dict[str, Any]] = {"name": "lock_v0"}

    def __init__(self, rounds: int = 20, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__(render_mode=render_mode)
        self.rounds, self.barges = rounds, ["barge_0", "barge_1"]
        self.possible_agents = ["keeper", *self.barges]
        seen = MultiDiscrete([QUAYS, QUAYS, LEVELS, LEVELS])
        self.observation_spaces = dict.fromkeys(self.barges, seen) | {
            "keeper": Discrete(2 * LEVELS - 1)
        }
        self.action_spaces = {a: Discrete(5) for a in self.barges} | {"keeper": Discrete(3)}

    def start(self, rng: Any, options: Any) -> None:
        """Draws places, quays and levels."""
        self.water, self.round = int(rng.integers(LEVELS)), 0
        self.places = {a: int(rng.integers(GATE)) for a in self.barges}
        self.quays = {a: GATE + 2 + int(rng.integers(3)) for a in self.barges}
        self.needs = {a: int(rng.integers(LEVELS)) for a in self.barges}
        self.wanted, self.moored = self.water, set[str]()

    def act(self, agent: str, action: Any) -> None:
        """Water rises or falls by one; a barge moves, whistles or moors."""
        if agent == "keeper":
            self.round += 1
            self.water = min(max(self.water + int(action) - 1, 0), LEVELS - 1)
        elif agent not in self.moored:
            self._sail(agent, int(action))
        if len(self.moored) == len(self.barges):
            for each in self.possible_agents:
                self.add_reward(each, 1.0)
                self.terminate(each, "moored")
        elif self.round >= self.rounds and agent == self.barges[-1]:
            for each in self.possible_agents:
                self.truncate(each, "dusk")

    def _sail(self, agent: str, action: int) -> None:
        place = self.places[agent]
        is_shut = place == GATE and self.water != self.needs[agent]
        if action == WHISTLE and place == GATE:
            self.wanted = self.needs[agent]
        elif action == MOOR and place == self.quays[agent]:
            self.moored.add(agent)
        elif action == AHEAD and not is_shut:
            self.places[agent] = min(place + 1, QUAYS - 1)
        elif action == BACK and place != GATE + 1:
            self.places[agent] = max(place - 1, 0)

    def observe(self, agent: str) -> Any:
        """How far the water is from what was whistled for; or a barge's place, quay and levels."""
        if agent == "keeper":
            return self.wanted - self.water + LEVELS - 1
        row = [self.places[agent], self.quays[agent], self.water, self.needs[agent]]
        return np.array(row, np.int64)


def lock(observation: Any, agent: str) -> int:
    """Sets the water; goes on to the quay, and whistles at the gate until it may pass."""
    if agent == "keeper":
        return 1 + int(np.sign(int(observation) - LEVELS + 1))
    place, quay, water, need = (int(each) for each in observation)
    if place == GATE and water != need:
        return WHISTLE
    return MOOR if place == quay else AHEAD if place < quay else BACK


class Glasshouse(ParallelEnv):  # type: ignore[type-arg]  # as users write it
    """Drones hover over their plants in a draught while the heater holds a temperature."""

    metadata: ClassVar[dict[str, Any]] = {"name": "glasshouse_v0"}

    def __init__(self, max_cycles: int = 36, render_mode: str | None = None) -> None:
        """Opens it."""
        self.max_cycles, self.render_mode = max_cycles, render_mode
        self.drones = ["drone_0", "drone_1"]
        self.possible_agents, self.agents = [*self.drones, "heater"], list[str]()
        two, one = Box(-3, 3, (2,), np.float32), Box(-3, 3, (1,), np.float32)
        drone = Dict({"draught": two, "place": two, "plant": two, "speed": two})
        heater = Dict({"air": one, "power": Discrete(5), "wanted": one})
        self.observation_spaces = dict.fromkeys(self.drones, drone) | {"heater": heater}
        self.action_spaces = {a: Box(-1, 1, (2,), np.float32) for a in self.drones}
        self.action_spaces["heater"] = Discrete(3)

    def observation_space(self, agent: str) -> Any:
        """Its space."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Its space."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws places, plants that lie apart from them, draught and temperatures."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents, self.clock, self.held = list(self.possible_agents), 0, 0
        self.places = {a: self.rng.uniform(-1, 1, 2) for a in self.drones}
        self.plants = {a: self.rng.uniform(-1, 1, 2) for a in self.drones}
        for agent, plant in self.plants.items():
            plant += 0.5 * np.sign(plant - self.places[agent])
        self.speeds = {a: np.zeros(2) for a in self.drones}
        self.draught = self.rng.uniform(-0.4, 0.4, 2)
        self.air, self.wanted, self.power = self.rng.uniform(-1, -0.5), self.rng.uniform(0, 1), 0
        return self._seen(), {agent: {} for agent in self.agents}

    def _seen(self) -> dict[str, Any]:
        rows = {
            a: {
                "draught": self.draught,
                "place": self.places[a],
                "plant": self.plants[a],
                "speed": self.speeds[a],
            }
            for a in self.drones
        }
        found: dict[str, Any] = {
            agent: {k: np.clip(v, -3, 3).astype(np.float32) for k, v in row.items()}
            for agent, row in rows.items()
        }
        air, wanted = (np.array([x], np.float32) for x in (self.air, self.wanted))
        return found | {"heater": {"air": air, "power": self.power, "wanted": wanted}}

    def step(self, actions: Any) -> Any:
        """All act at once; three ticks with everything in place are enough."""
        self.clock += 1
        self.power = min(max(self.power + int(actions["heater"]) - 1, 0), 4)
        self.air = float(np.clip(self.air + 0.06 * (self.power - 2), -3, 3))
        for agent in self.drones:
            push = np.clip(np.asarray(actions[agent], np.float64), -1, 1)
            self.speeds[agent] = 0.6 * self.speeds[agent] + 0.12 * (push + self.draught)
            self.places[agent] = np.clip(self.places[agent] + self.speeds[agent], -3, 3)
        off = [np.abs(self.places[a] - self.plants[a]).max() for a in self.drones]
        is_well = max([*off, abs(self.air - self.wanted)]) < CLOSE
        self.held = self.held + 1 if is_well else 0
        is_done = self.held >= 3
        is_late = not is_done and self.clock >= self.max_cycles
        agents = self.agents
        self.agents = [] if is_done or is_late else list(agents)
        return (
            self._seen(),
            dict.fromkeys(agents, float(is_done)),
            dict.fromkeys(agents, is_done),
            dict.fromkeys(agents, is_late),
            {agent: {} for agent in agents},
        )


def glasshouse(observation: Any, agent: str) -> Any:
    """Flies to its plant against the draught; heats until it is as warm as wanted."""
    if agent == "heater":
        missing = float(observation["wanted"][0] - observation["air"][0])
        power = 2 + int(np.clip(round(missing / 0.06), -2, 2))
        return 1 + int(np.sign(power - int(observation["power"])))
    way = np.asarray(observation["plant"], np.float64) - observation["place"]
    push = 2.5 * way - 2.0 * np.asarray(observation["speed"]) - observation["draught"]
    return np.clip(push, -1, 1).astype(np.float32)
