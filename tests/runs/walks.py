"""Two small environments for tests of recording; tests also write their text into files."""

from typing import ClassVar

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

TURNS = 5


class Walk(ParallelEnv):
    """Agents draw their observations from a generator that a seeded reset makes anew."""

    metadata: ClassVar = {"name": "walk_v0", "is_parallelizable": True}
    render_mode = None

    def __init__(self, turns=TURNS):
        self.turns = turns
        self.possible_agents = ["a", "b"]
        self.observation_spaces = {
            agent: spaces.Box(-99, 99, (3,), np.float64) for agent in self.possible_agents
        }
        self.action_spaces = {agent: spaces.Discrete(3) for agent in self.possible_agents}
        self.agents = []

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.turn, self.total = 0, (options or {}).get("start", 0)
        return self.see(), {agent: {} for agent in self.agents}

    def see(self):
        return {agent: self.rng.normal(size=3) for agent in self.agents}

    def state(self):
        return np.array([self.turn, self.total], np.int64)

    def step(self, actions):
        self.turn += 1
        self.total += sum(int(action) for action in actions.values())
        rewards = {agent: float(actions.get(agent, 0)) for agent in self.agents}
        ended = self.turn >= self.turns
        terminations = dict.fromkeys(self.agents, ended)
        truncations = dict.fromkeys(self.agents, False)
        infos = {agent: {"turn": self.turn} for agent in self.agents}
        observations = self.see()
        if ended:
            self.agents = []
        return observations, rewards, terminations, truncations, infos


class Turns(AECEnv):
    """The same one after the other."""

    metadata: ClassVar = {"name": "turns_v0", "is_parallelizable": False}
    render_mode = None

    def __init__(self, turns=TURNS):
        self.turns = turns
        self.possible_agents = ["a", "b"]
        self.observation_spaces = {
            agent: spaces.Box(-99, 99, (2,), np.float64) for agent in self.possible_agents
        }
        self.action_spaces = {agent: spaces.Discrete(3) for agent in self.possible_agents}

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.turn, self.agent_selection = 0, "a"
        self.sight = self.rng.normal(size=2)

    def observe(self, agent):
        return self.sight

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent]:
            self._was_dead_step(action)
            return
        self.turn += 1
        self.sight = self.rng.normal(size=2)
        self._cumulative_rewards[agent] = 0.0
        other = "b" if agent == "a" else "a"
        self.rewards = {agent: float(action), other: 0.5 if action == 2 else 0.0}
        if self.turn >= self.turns:
            self.terminations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        self.agent_selection = other
