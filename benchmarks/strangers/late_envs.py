"""Small environments that pay a step late, by mistake or by their rules, as strangers write them.

Nothing here uses gamekeeper. What is planted in the faulty ones stands in audit.py.
"""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import AgentSelector

# Faulty ones.


class Orchard(ParallelEnv):
    """Pickers fill a basket together; each apple pays its picker, each full basket pays all."""

    metadata = {"name": "orchard_v0", "render_modes": []}

    def __init__(self, pickers=3, trees=5):
        self.possible_agents = [f"picker_{i}" for i in range(pickers)]
        self.agents = []
        self.trees = trees
        self._obs = {a: spaces.Box(0, 60, (3,), np.float32) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(4) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def _see(self):
        return {
            a: np.array([self.at[a], self.apples[self.at[a]], self.basket], np.float32)
            for a in self.agents
        }

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.apples = self.rng.integers(2, 9, self.trees)
        self.at = {a: int(self.rng.integers(self.trees)) for a in self.agents}
        self.basket, self.full, self.t = 0, 0, 0
        return self._see(), {a: {} for a in self.agents}

    def step(self, actions):
        # baskets that were filled are paid for
        rewards = dict.fromkeys(self.agents, 2.0 * self.full)
        self.full = 0
        for a in self.agents:
            if actions[a] == 1:
                self.at[a] = min(self.at[a] + 1, self.trees - 1)
            elif actions[a] == 2:
                self.at[a] = max(self.at[a] - 1, 0)
            elif actions[a] == 3 and self.apples[self.at[a]] > 0:
                self.apples[self.at[a]] -= 1
                self.basket += 1
                rewards[a] += 0.25
        if self.basket >= 4:
            self.basket -= 4
            self.full = 1
        self.t += 1
        out = self._see()
        over = self.t >= 40
        ended = dict.fromkeys(self.agents, False), dict.fromkeys(self.agents, over)
        infos = {a: {} for a in self.agents}
        if over:
            self.agents = []
        return out, rewards, *ended, infos


class Tollway(AECEnv):
    """Drivers go round a ring road by turns; each field pays, and the gate takes its toll."""

    metadata = {"name": "tollway_v0", "render_modes": [], "is_parallelizable": False}

    def __init__(self, drivers=3, length=7):
        super().__init__()
        self.length = length
        self.possible_agents = [f"driver_{i}" for i in range(drivers)]
        self.agents = []
        self._obs = {a: spaces.Box(0, 99, (drivers + 1,), np.int64) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        self.place = {a: int(self.rng.integers(self.length)) for a in self.agents}
        self.charged = dict.fromkeys(self.agents, 0.0)
        self.turns = 0
        self._selector = AgentSelector(self.agents)
        self.agent_selection = self._selector.next()

    def observe(self, agent):
        return np.array([*(self.place[a] for a in self.possible_agents), self.turns], np.int64)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.rewards[agent] -= self.charged[agent]
        self.charged[agent] = 0.0
        place = self.place[agent] + int(action)
        self.rewards[agent] += 0.1 * int(action)
        if place >= self.length:
            self.charged[agent] = 1.0
        self.place[agent] = place % self.length
        self.turns += 1
        if self.turns >= 75:
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        self.agent_selection = self._selector.next()


class Convoy(ParallelEnv):
    """Lorries keep their distance to the one ahead; fuel costs at once."""

    metadata = {"name": "convoy_v0", "render_modes": []}

    def __init__(self, lorries=3):
        self.possible_agents = [f"lorry_{i}" for i in range(lorries)]
        self.agents = []
        box = spaces.Box(-100, 100, (2,), np.float32)
        self._obs = dict.fromkeys(self.possible_agents, box)
        self._act = {a: spaces.Box(-1, 1, (1,), np.float32) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def _gaps(self):
        order = self.possible_agents
        return {a: self.x[b] - self.x[a] for a, b in zip(order, [*order[1:], "lead"], strict=True)}

    def _see(self):
        gaps = self._gaps()
        return {a: np.array([gaps[a], self.x[a] / 4], np.float32) for a in self.agents}

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.x = {a: 2.0 * i + float(self.rng.random()) for i, a in enumerate(self.agents)}
        self.x["lead"] = 2.0 * len(self.agents) + 1
        self.t = 0
        return self._see(), {a: {} for a in self.agents}

    def step(self, actions):
        gaps = self._gaps()
        rewards = {}
        for a in self.agents:
            push = float(np.clip(actions[a][0], -1, 1))
            rewards[a] = -abs(gaps[a] - 2) - 0.1 * push**2
            self.x[a] += push
        self.x["lead"] += 0.3
        self.t += 1
        out = self._see()
        over = self.t >= 30
        ended = dict.fromkeys(self.agents, False), dict.fromkeys(self.agents, over)
        infos = {a: {} for a in self.agents}
        if over:
            self.agents = []
        return out, rewards, *ended, infos


# Sound ones.


class Invoices(ParallelEnv):
    """Workshops sell for cash at once, or on account: what is due is seen, and paid next tick."""

    metadata = {"name": "invoices_v0", "render_modes": []}

    def __init__(self, shops=2):
        self.possible_agents = [f"shop_{i}" for i in range(shops)]
        self.agents = []
        self._obs = {a: spaces.Box(0, 99, (3,), np.float64) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def _see(self):
        return {a: np.array([self.stock[a], self.due[a], self.t], np.float64) for a in self.agents}

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.stock = {a: int(self.rng.integers(3, 9)) for a in self.agents}
        self.due = dict.fromkeys(self.agents, 0.0)
        self.t = 0
        return self._see(), {a: {} for a in self.agents}

    def step(self, actions):
        rewards = {}
        for a in self.agents:
            rewards[a] = self.due[a]
            self.due[a] = 0.0
            if actions[a] == 0:
                self.stock[a] = min(self.stock[a] + 1, 20)
            elif self.stock[a] and actions[a] == 1:
                self.stock[a] -= 1
                rewards[a] += 1.0
            elif self.stock[a]:
                self.stock[a] -= 1
                self.due[a] = 1.5
        self.t += 1
        over = self.t >= 40
        out = self._see()
        ended = dict.fromkeys(self.agents, False), dict.fromkeys(self.agents, over)
        infos = {a: {} for a in self.agents}
        if over:
            self.agents = []
        return out, rewards, *ended, infos


class Bakery(AECEnv):
    """Bakers fill an oven and serve by turns: a loaf is done and sold at one's next turn."""

    metadata = {"name": "bakery_v0", "render_modes": [], "is_parallelizable": False}

    def __init__(self):
        super().__init__()
        self.possible_agents = ["rye", "wheat"]
        self.agents = []
        self._obs = {a: spaces.Box(0, 99, (4,), np.int64) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        self.flour = {a: int(self.rng.integers(4, 9)) for a in self.agents}
        self.oven = dict.fromkeys(self.agents, 0)
        self.turns = 0
        self._selector = AgentSelector(self.agents)
        self.agent_selection = self._selector.next()

    def observe(self, agent):
        other = "wheat" if agent == "rye" else "rye"
        seen = [self.flour[agent], self.oven[agent], self.oven[other], self.turns]
        return np.array(seen, np.int64)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.rewards[agent] += 2.0 * self.oven[agent]
        self.oven[agent] = 0
        if action == 0:
            self.flour[agent] = min(self.flour[agent] + 2, 20)
        elif action == 1 and self.flour[agent]:
            self.flour[agent] -= 1
            self.rewards[agent] += 0.5
        elif action == 2 and self.flour[agent]:
            self.flour[agent] -= 1
            self.oven[agent] = 1
        self.turns += 1
        if self.turns >= 60:
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        self.agent_selection = self._selector.next()
