"""Environments without knobs, and named policies for them, for benchmarks/good_pairs.py.

`docks` (Parallel) and `pantry` (AEC) are written for it; `spread` (Parallel) and `speaker` (AEC)
are mpe2's, in wrappers that take arguments of their own. Each has arguments that decide whether it
is solved and arguments that don't. Nothing here uses the diagnosis' own code.
"""

import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete
from mpe2 import simple_speaker_listener_v4, simple_spread_v3
from pettingzoo.utils import BaseParallelWrapper, BaseWrapper

sys.path.insert(0, str(Path(__file__).parent))

import undo_causes

import gamekeeper as gk


class Docks(gk.TickEnv):
    """Two tugs on a line, each of which has to lie at its berth at the same time; Parallel."""

    metadata: ClassVar[dict[str, Any]] = {"name": "docks_v0"}

    def __init__(
        self,
        length: int = 9,
        limit: int = 30,
        current: float = 0.0,
        fog: float = 0.0,
        swell: float = 0.0,
        pay: float = 1.0,
        fee: float = 0.0,
        color: str = "red",
        buoys: int = 2,
        depth: float = 10.0,
        lamps: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Opens it; a tug is pushed back with probability `current`, blinded with `fog`."""
        super().__init__(render_mode=render_mode)
        self.length, self.limit, self.current, self.fog = length, limit, current, fog
        self.swell, self.pay, self.fee, self.color = swell, pay, fee, color
        self.buoys, self.depth, self.lamps = buoys, depth, lamps
        self.possible_agents = ["tug_0", "tug_1"]
        box = Box(-100.0, 100.0, (5,), np.float64)
        self.observation_spaces = dict.fromkeys(self.possible_agents, box)
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Draws places and berths; the option `tide` moves what is shown of the berths."""
        self.rng, self.tide = rng, int((options or {}).get("tide", 0))
        self.place = {a: int(rng.integers(self.length)) for a in self.possible_agents}
        self.berth = {a: int(rng.integers(self.length)) for a in self.possible_agents}
        for agent in self.possible_agents:
            if abs(self.place[agent] - self.berth[agent]) < 2:
                self.berth[agent] = (self.place[agent] + 4) % self.length
        self.tick_number = 0

    def tick(self, actions: Any) -> None:
        """Tugs move, unless they are pushed back."""
        self.tick_number += 1
        for agent, action in actions.items():
            step = int(action) - 1
            if float(self.rng.uniform(0.0, 1.0)) < self.current:
                step = -step
            self.place[agent] = min(max(self.place[agent] + step, 0), self.length - 1)
            self.add_reward(agent, -self.fee)
        if not self.left():
            for agent in self.possible_agents:
                self.add_reward(agent, self.pay)
                self.terminate(agent, "docked")
        elif self.tick_number >= self.limit:
            for agent in self.possible_agents:
                self.truncate(agent, "late")

    def left(self) -> int:
        """Number of tugs that aren't at their berth."""
        return sum(self.place[agent] != self.berth[agent] for agent in self.possible_agents)

    def info(self, agent: str) -> dict[str, Any]:
        """Tells how many tugs aren't at their berth."""
        return {"left": self.left()}

    def observe(self, agent: str) -> Any:
        """Place, berth (-1: not seen), and three figures that say nothing."""
        seen = self.berth[agent] + self.tide
        if self.fog and float(self.rng.uniform(0.0, 1.0)) < self.fog:
            seen = -1
        off = self.swell * float(self.rng.uniform(-1.0, 1.0)) if self.swell else 0.0
        return np.array([self.place[agent] + off, seen, self.buoys, self.depth, self.lamps], float)


class Pantry(gk.TurnEnv):
    """A cook dishes up what was ordered, a waiter walks a ring of tables to serve it; AEC."""

    metadata: ClassVar[dict[str, Any]] = {"name": "pantry_v0"}

    def __init__(
        self,
        tables: int = 7,
        patience: int = 40,
        spill: float = 0.0,
        smoke: float = 0.0,
        draft: float = 0.0,
        tip: float = 1.0,
        fine: float = 0.0,
        music: str = "jazz",
        napkins: int = 2,
        candles: bool = False,
        warmth: float = 20.0,
        render_mode: str | None = None,
    ) -> None:
        """Opens it; a dish is spilt with probability `spill`, the order misread with `smoke`."""
        super().__init__(render_mode=render_mode)
        self.tables, self.patience, self.spill, self.smoke = tables, patience, spill, smoke
        self.draft, self.tip, self.fine, self.music = draft, tip, fine, music
        self.napkins, self.candles, self.warmth = napkins, candles, warmth
        self.possible_agents = ["cook", "waiter"]
        box = Box(-100.0, 100.0, (5,), np.float64)
        self.observation_spaces = dict.fromkeys(self.possible_agents, box)
        self.action_spaces = {"cook": Discrete(4), "waiter": Discrete(3)}

    def start(self, rng: Any, options: Any) -> None:
        """Draws an order and a table; with the option `rush` guests wait a fifth as long."""
        self.rng = rng
        rush = bool((options or {}).get("rush", False))
        self.until = self.patience // 5 if rush else self.patience
        self.order, self.table = int(rng.integers(4)), 2 + int(rng.integers(self.tables - 3))
        self.dish, self.place, self.moves, self.is_served = -1, 0, 0, False

    def act(self, agent: str, action: Any) -> None:
        """The cook dishes up; the waiter walks, and serves where it stands still with a dish."""
        self.moves += 1
        if agent == "cook":
            self.dish = int(action)
            if float(self.rng.uniform(0.0, 1.0)) < self.spill:
                self.dish = -1
        else:
            self.place = (self.place + int(action) - 1) % self.tables
            self.is_served = self.place == self.table and self.dish == self.order
        self.add_reward(agent, -self.fine)
        if self.is_served:
            for each in self.possible_agents:
                self.add_reward(each, self.tip)
                self.terminate(each, "served")
        elif self.moves >= self.until:
            for each in self.possible_agents:
                self.truncate(each, "cold")

    def info(self, agent: str) -> dict[str, Any]:
        """Tells whether the order is still to be served."""
        return {"left": int(not self.is_served)}

    def observe(self, agent: str) -> Any:
        """The order for the cook, place and table for the waiter; figures that say nothing."""
        order = self.order
        if self.smoke and float(self.rng.uniform(0.0, 1.0)) < self.smoke:
            order = int(self.rng.integers(4))
        off = self.draft * float(self.rng.uniform(-1.0, 1.0)) if self.draft else 0.0
        rest = [self.napkins, self.warmth, float(self.candles)]
        own = [order, 0] if agent == "cook" else [self.place, self.table]
        return np.array([*own, *rest], float) + off


class _Layer:
    """Noise of sight, sticky actions and scaled sight, as the wrappers below share them."""

    def set_layer(self, jitter: float, sticky: float, gain: float) -> None:
        """Sets it."""
        self.jitter, self.sticky, self.gain = jitter, sticky, gain
        self.rng, self.held = np.random.default_rng(0), dict[str, Any]()

    def begin(self, seed: int | None) -> None:
        """Begins an episode."""
        self.rng, self.held = np.random.default_rng(seed), {}

    def seen(self, observation: Any) -> Any:
        """An observation as the agent gets it."""
        noise = self.rng.normal(0.0, 1.0, np.shape(observation)) * self.jitter
        return (observation * self.gain + noise).astype(np.asarray(observation).dtype)

    def done(self, agent: str, action: Any) -> Any:
        """An action as it is done."""
        if agent in self.held and self.rng.random() < self.sticky:
            return self.held[agent]
        self.held[agent] = action
        return action


class LayerParallel(_Layer, BaseParallelWrapper):  # type: ignore[type-arg]
    """The layer around a Parallel environment."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins an episode."""
        self.begin(seed)
        observations, infos = super().reset(seed=seed, options=options)
        return {agent: self.seen(each) for agent, each in observations.items()}, infos

    def step(self, actions: Any) -> Any:
        """A tick."""
        done = {agent: self.done(agent, action) for agent, action in actions.items()}
        observations, *rest = super().step(done)
        return {agent: self.seen(each) for agent, each in observations.items()}, *rest


class LayerAEC(_Layer, BaseWrapper):  # type: ignore[type-arg]
    """The same around an AEC environment."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Begins an episode."""
        self.begin(seed)
        super().reset(seed=seed, options=options)

    def step(self, action: Any) -> None:
        """A turn."""
        agent = self.agent_selection
        super().step(action if action is None else self.done(agent, action))

    def observe(self, agent: Any) -> Any:
        """A look."""
        return self.seen(super().observe(agent))


def spread(
    max_cycles: int = 40, jitter: float = 0.0, sticky: float = 0.0, gain: float = 1.0, **kwargs: Any
) -> Any:
    """Two agents that cover two landmarks."""
    inner = simple_spread_v3.parallel_env(N=2, max_cycles=max_cycles, **kwargs)
    found = LayerParallel(undo_causes.ArrivedParallel(inner))
    found.set_layer(jitter, sticky, gain)
    return found


def spread_rounded(**kwargs: Any) -> Any:
    """The same; what is seen is rounded to three digits."""
    return _Rounded(spread(**kwargs))


class _Rounded(BaseParallelWrapper):  # type: ignore[type-arg]
    """Observations with three digits."""

    def step(self, actions: Any) -> Any:
        """A tick."""
        observations, *rest = super().step(actions)
        return {agent: np.round(each, 3) for agent, each in observations.items()}, *rest


def speaker(
    max_cycles: int = 40, jitter: float = 0.0, sticky: float = 0.0, gain: float = 1.0, **kwargs: Any
) -> Any:
    """A speaker that knows the goal and a listener that moves."""
    inner = simple_speaker_listener_v4.env(max_cycles=max_cycles, **kwargs)
    found = LayerAEC(undo_causes.ArrivedAEC(inner))
    found.set_layer(jitter, sticky, gain)
    return found


# -- Policies: as good as it gets, the same written otherwise, and bad ones


def _tug(observation: Any) -> int:
    """Action towards the berth; none where it isn't seen."""
    place, berth = float(observation[0]), float(observation[1])
    return 1 if berth < 0 else 1 + int(np.sign(np.round(berth - place)))


def _staff(observation: Any, agent: str) -> int:
    """The dish that was ordered; the shorter way to the table."""
    first, second = np.round(observation[0]), np.round(observation[1])
    if agent == "cook":
        return int(first) % 4
    return 1 + int(np.sign(second - first))


def _acts(observation: Any, agent: str) -> int:
    """The action of the policy that solves it."""
    if agent.startswith("tug"):
        return _tug(observation)
    if agent in ("cook", "waiter"):
        return _staff(observation, agent)
    act = undo_causes.speaker if agent.startswith(("speaker", "listener")) else undo_causes.spread
    return int(act(observation, agent))


def good(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """Solves it."""
    return _acts(observation, agent)


class Again:
    """The same, as an object with a memory that it doesn't use."""

    def reset(self, seed: int) -> None:
        """Forgets."""
        self.count = 0

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> int:
        """The action."""
        self.count += 1
        return _acts(observation, agent)


def careful(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """The same but for one action in fifty, which is drawn."""
    return _acts(observation, agent) if rng.random() > 0.02 else int(rng.integers(3))


def dazed(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """Draws nine actions of ten."""
    return _acts(observation, agent) if rng.random() < 0.1 else int(rng.integers(3))


def idle(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """Does nothing, or always the same."""
    return 1 if agent.startswith(("tug", "waiter")) else 0


def turned(observation: Any, agent: str, info: Any, rng: Any) -> int:
    """Does the contrary."""
    action = _acts(observation, agent)
    if agent.startswith(("tug", "waiter")):
        return 2 - action
    if agent in ("cook", "speaker_0"):
        return (action + 1) % 3
    return (0, 2, 1, 4, 3)[action]
