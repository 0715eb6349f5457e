"""A second lot of small Parallel environments, written as strangers write them.

Nothing here uses gamekeeper. What is planted in the faulty ones stands in audit.py.
"""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

# Faulty ones.


class Drones(ParallelEnv):
    """Drones fly a ring until their batteries are empty."""

    metadata = {"name": "drones_v0", "render_modes": []}

    def __init__(self, n=3):
        self.possible_agents = [f"drone_{i}" for i in range(n)]
        self.agents = []
        self.energy = dict.fromkeys(self.possible_agents, 40)
        self._o = {a: spaces.Box(0, 50, (3,), np.float32) for a in self.possible_agents}
        self._a = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._o[agent]

    def action_space(self, agent):
        return self._a[agent]

    def _obs(self, agents):
        return {a: np.array([self.pos[a], self.energy[a], self.t], np.float32) for a in agents}

    def reset(self, seed=None, options=None):
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.pos = {a: int(self.rng.integers(12)) for a in self.agents}
        for a in self.agents:
            if self.energy[a] <= 0:
                self.energy[a] = 40
        self.t = 0
        return self._obs(self.agents), {a: {} for a in self.agents}

    def step(self, actions):
        self.t += 1
        acting = self.agents
        for a in acting:
            if actions[a]:
                self.pos[a] = (self.pos[a] + (1 if actions[a] == 1 else -1)) % 12
                self.energy[a] -= 1
        rewards = {a: float(self.pos[a] == 0) for a in acting}
        terms = {a: self.energy[a] <= 0 for a in acting}
        truncs = {a: self.t >= 30 and not terms[a] for a in acting}
        self.agents = [a for a in acting if not (terms[a] or truncs[a])]
        return self._obs(acting), rewards, terms, truncs, {a: {} for a in acting}


class Quarry(ParallelEnv):
    """Diggers take stones from three heaps; the last stone of a heap goes to one of them."""

    metadata = {"name": "quarry_v0", "render_modes": []}

    def __init__(self):
        self.possible_agents = ["ann", "bob", "cid", "dee"]
        self.agents = []
        box = spaces.Box(0, 20, (4,), np.int64)
        self.observation_spaces = dict.fromkeys(self.possible_agents, box)
        self.action_spaces = {a: spaces.Discrete(4) for a in self.possible_agents}

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.heaps = self.rng.integers(8, 14, 3)
        self.own = dict.fromkeys(self.agents, 0)
        obs = {a: np.array([*self.heaps, self.own[a]]) for a in self.agents}
        return obs, {a: {} for a in self.agents}

    def step(self, actions):
        rewards = dict.fromkeys(self.agents, 0.0)
        for a, act in actions.items():
            if act < 3 and self.heaps[act] > 0:
                self.heaps[act] -= 1
                self.own[a] += 1
                rewards[a] = 1.0
        done = bool((self.heaps == 0).all())
        obs = {a: np.array([*self.heaps, self.own[a]]) for a in self.agents}
        terms = dict.fromkeys(self.agents, done)
        truncs = dict.fromkeys(self.agents, False)
        infos = {a: {"own": self.own[a]} for a in self.agents}
        if done:
            self.agents = []
        return obs, rewards, terms, truncs, infos


class Kiln(ParallelEnv):
    """Potters heat a kiln; how long it has burnt in all is seen."""

    metadata = {"name": "kiln_v0", "render_modes": []}

    def __init__(self):
        self.possible_agents = ["p0", "p1"]
        self.agents = []
        self.burnt = 0
        self.observation_spaces = {
            a: spaces.Box(0, 60, (2,), np.float32) for a in self.possible_agents
        }
        self.action_spaces = {a: spaces.Discrete(2) for a in self.possible_agents}

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents.copy()
        self.heat = float(self.rng.uniform(0, 5))
        self.t = 0
        return self._obs(), {a: {} for a in self.agents}

    def _obs(self):
        return {a: np.array([self.heat, self.burnt], np.float32) for a in self.agents}

    def step(self, actions):
        self.t += 1
        self.burnt += 1
        self.heat = min(self.heat * 0.9 + sum(map(int, actions.values())), 60.0)
        over = self.t >= 25
        rewards = {a: -abs(self.heat - 8) - 0.1 * actions[a] for a in self.agents}
        obs = self._obs()
        terms = dict.fromkeys(self.agents, False)
        truncs = dict.fromkeys(self.agents, over)
        infos = {a: {} for a in self.agents}
        if over:
            self.agents = []
        return obs, rewards, terms, truncs, infos


class Ferry(ParallelEnv):
    """Two ferries carry cars; the harbour master sees all of it in state()."""

    metadata = {"name": "ferry_v0", "render_modes": []}

    def __init__(self):
        self.possible_agents = ["north", "south"]
        self.agents = []
        self.observation_spaces = {
            a: spaces.Box(0, 30, (2,), np.float32) for a in self.possible_agents
        }
        self.action_spaces = {a: spaces.Discrete(3) for a in self.possible_agents}
        self.state_space = spaces.Box(0, 30, (4,), np.float32)

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.queue = {a: int(self.rng.integers(3, 9)) for a in self.agents}
        self.load = dict.fromkeys(self.agents, 0)
        self.t = 0
        self._note()
        return self._obs(), {a: {} for a in self.agents}

    def _note(self):
        both = self.possible_agents
        values = [*(self.queue[a] for a in both), *(self.load[a] for a in both)]
        self._state = np.array(values, np.float32)

    def _obs(self):
        return {a: np.array([self.queue[a], self.load[a]], np.float32) for a in self.agents}

    def state(self):
        return self._state.copy()

    def step(self, actions):
        self._note()
        self.t += 1
        rewards = {}
        for a in self.agents:
            rewards[a] = 0.0
            if actions[a] == 1 and self.queue[a] and self.load[a] < 4:
                self.queue[a] -= 1
                self.load[a] += 1
            elif actions[a] == 2 and self.load[a]:
                rewards[a] = float(self.load[a])
                self.load[a] = 0
            if self.rng.random() < 0.3 and self.queue[a] < 30:
                self.queue[a] += 1
        over = self.t >= 35
        obs = self._obs()
        out = (
            obs,
            rewards,
            dict.fromkeys(self.agents, False),
            dict.fromkeys(self.agents, over),
            {a: {} for a in self.agents},
        )
        if over:
            self.agents = []
        return out


# Sound ones.


class Market(ParallelEnv):
    """Stalls open one after another; rewards are arrays without an axis, infos say prices."""

    metadata = {"name": "market_v0", "render_modes": []}

    def __init__(self):
        self.possible_agents = [f"stall{i}" for i in range(5)]
        self.agents = []
        self._o = {
            a: spaces.Dict(
                {
                    "observation": spaces.Box(-np.inf, np.inf, (3,), np.float64),
                    "action_mask": spaces.MultiBinary(4),
                }
            )
            for a in self.possible_agents
        }
        self._a = {a: spaces.Discrete(4) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._o[agent]

    def action_space(self, agent):
        return self._a[agent]

    def _obs(self, agents):
        out = {}
        for a in agents:
            mask = np.array([1, self.stock[a] > 0, self.stock[a] > 1, self.cash[a] > 1], np.int8)
            seen = np.array([self.stock[a], self.cash[a], self.price])
            out[a] = {"observation": seen, "action_mask": mask}
        return out

    def reset(self, seed=None, options=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        elif not hasattr(self, "rng"):
            self.rng = np.random.default_rng()
        self.t = 0
        self.price = float(self.rng.uniform(1, 2))
        self.stock = {a: int(self.rng.integers(1, 4)) for a in self.possible_agents}
        self.cash = dict.fromkeys(self.possible_agents, 3.0)
        self.agents = self.possible_agents[:2]
        return self._obs(self.agents), {a: {"price": self.price} for a in self.agents}

    def step(self, actions):
        acting = self.agents
        sold = {a: int(actions[a]) if actions[a] < 3 else 0 for a in acting}
        rewards = {}
        for a in acting:
            self.stock[a] -= sold[a]
            self.cash[a] += sold[a] * self.price
            if actions[a] == 3:
                self.cash[a] -= 1
                self.stock[a] += 1
            rewards[a] = np.float64(sold[a] * self.price - (actions[a] == 3))
        self.t += 1
        self.price = float(np.clip(self.price + self.rng.normal(0, 0.1), 0.5, 3))
        over = self.t >= 30
        terms = dict.fromkeys(acting, False)
        truncs = dict.fromkeys(acting, over)
        joined = [] if over or self.t % 6 else self.possible_agents[len(acting) : len(acting) + 1]
        for a in joined:
            rewards[a], terms[a], truncs[a] = np.float64(0), False, False
        obs = self._obs([*acting, *joined])
        self.agents = [] if over else [*acting, *joined]
        return obs, rewards, terms, truncs, {a: {"price": self.price} for a in obs}


class Cameras(ParallelEnv):
    """Two cameras look at a large picture of which a light moves; they leave when they see it."""

    metadata = {"name": "cameras_v0", "render_modes": []}

    def __init__(self, size=96):
        self.possible_agents = ["left", "right"]
        self.agents = []
        self.size = size
        self._o = {a: spaces.Box(0, 255, (size, size, 3), np.uint8) for a in self.possible_agents}
        self._a = {a: spaces.Box(-1, 1, (2,), np.float32) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._o[agent]

    def action_space(self, agent):
        return self._a[agent]

    def _obs(self, agents):
        out = {}
        for a in agents:
            picture = np.zeros((self.size, self.size, 3), np.uint8)
            y, x = self.light
            picture[y, x] = 255
            cy, cx = self.at[a].astype(int)
            picture[cy, cx, 0] = 128
            out[a] = picture
        return out

    def reset(self, seed=None, options=None):
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.light = self.rng.integers(0, self.size, 2)
        self.at = {a: np.full(2, self.size / 2) for a in self.agents}
        self.t = 0
        return self._obs(self.agents), {a: {} for a in self.agents}

    def step(self, actions):
        self.t += 1
        acting = self.agents
        rewards, terms = {}, {}
        for a in acting:
            move = np.clip(np.asarray(actions[a], float), -1, 1) * 12
            self.at[a] = np.clip(self.at[a] + move, 0, self.size - 1)
            near = float(np.abs(self.at[a] - self.light).max())
            terms[a] = near < 6
            rewards[a] = -near / self.size
        self.light = (self.light + self.rng.integers(-1, 2, 2)) % self.size
        truncs = {a: self.t >= 40 and not terms[a] for a in acting}
        obs = self._obs(acting)
        self.agents = [a for a in acting if not terms[a] and not truncs[a]]
        return obs, rewards, terms, truncs, {a: {} for a in acting}


class Shuffle(ParallelEnv):
    """Card sharps whose order in `agents` is drawn anew in every tick; the highest card wins."""

    metadata = {"name": "shuffle_v0", "render_modes": []}

    def __init__(self):
        self.possible_agents = ["red", "green", "blue"]
        self.agents = []
        self._o = spaces.Tuple((spaces.Discrete(10), spaces.MultiDiscrete([3, 31])))
        self._os = dict.fromkeys(self.possible_agents, self._o)
        self._as = {a: spaces.MultiDiscrete([2, 3]) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._os[agent]

    def action_space(self, agent):
        return self._as[agent]

    def _obs(self):
        return {
            a: (np.int64(self.card[a]), np.array([self.bets[a], self.t], np.int64))
            for a in self.agents
        }

    def reset(self, seed=None, options=None):
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.t = 0
        self.bets = dict.fromkeys(self.possible_agents, 0)
        self.card = {a: int(self.rng.integers(10)) for a in self.possible_agents}
        self.agents = list(self.possible_agents)
        self.rng.shuffle(self.agents)
        return self._obs(), {a: {} for a in self.agents}

    def step(self, actions):
        for a in sorted(actions):
            self.bets[a] = int(actions[a][1])
        best = max(self.card[a] + int(actions[a][0]) for a in self.agents)
        winners = [a for a in self.agents if self.card[a] + int(actions[a][0]) == best]
        pot = sum(self.bets[a] for a in self.agents)
        rewards = {
            a: (pot / len(winners) if a in winners else 0.0) - self.bets[a] for a in self.agents
        }
        for a in self.possible_agents:
            self.card[a] = int(self.rng.integers(10))
        self.t += 1
        over = self.t >= 30
        self.rng.shuffle(self.agents)
        obs = self._obs()
        flags = dict.fromkeys(self.agents, over)
        terms = dict.fromkeys(self.agents, False)
        infos = {a: {} for a in self.agents}
        if over:
            self.agents = []
        return obs, rewards, terms, flags, infos
