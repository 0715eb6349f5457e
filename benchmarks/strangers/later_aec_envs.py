"""A second lot of small AEC environments, written as strangers write them.

Nothing here uses gamekeeper. What is planted in the faulty ones stands in audit.py.
"""

from __future__ import annotations

import random

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv
from pettingzoo.utils import AgentSelector

# Faulty ones.


class Nim(AECEnv):
    """Players take one to three stones; whoever takes the last one wins."""

    metadata = {"name": "nim_v0", "render_modes": []}

    def __init__(self):
        super().__init__()
        self.possible_agents = ["first", "second", "third"]
        self.agents = []
        dict_space = spaces.Dict(
            {
                "observation": spaces.Box(0, 40, (3,), np.int64),
                "action_mask": spaces.Box(0, 1, (3,), np.int8),
            }
        )
        self.observation_spaces = dict.fromkeys(self.possible_agents, dict_space)
        self.action_spaces = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        self.stones = int(self.rng.integers(20, 30))
        self.taken = dict.fromkeys(self.agents, -1)
        self.selector = AgentSelector(self.agents)
        self.agent_selection = self.selector.next()

    def observe(self, agent):
        # nobody may take what they took last; the mask is that of the player before
        names = self.possible_agents
        other = names[(names.index(agent) - 1) % 3]
        mask = np.array([k < self.stones and k != self.taken[other] for k in range(3)], np.int8)
        if not mask.any():
            mask[0] = 1
        seen = np.array([self.stones, *[self.taken[a] + 1 for a in names[:2]]])
        return {"observation": seen, "action_mask": mask}

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        if action == self.taken[agent] and self.stones > 1:
            raise ValueError(f"{agent} took {action + 1} last time")
        self._cumulative_rewards[agent] = 0
        self._clear_rewards()
        self.stones = max(self.stones - int(action) - 1, 0)
        self.taken[agent] = int(action)
        if self.stones == 0:
            for a in self.agents:
                self.rewards[a] = 1 if a == agent else -1
                self.terminations[a] = True
        self._accumulate_rewards()
        self.agent_selection = self.selector.next()


class Ledger(AECEnv):
    """Clerks enter sums; rewards of earlier entries stay in `rewards`."""

    metadata = {"name": "ledger_v0", "render_modes": []}

    def __init__(self, rounds=8):
        super().__init__()
        self.rounds = rounds
        self.possible_agents = ["clerk_a", "clerk_b", "clerk_c"]
        self.agents = []
        self._obs = {a: spaces.Box(-50, 50, (2,), np.float32) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(4) for a in self.possible_agents}

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
        self.balance = float(self.rng.integers(-3, 4))
        self.turns = 0
        self._selector = AgentSelector(self.agents)
        self.agent_selection = self._selector.next()

    def observe(self, agent):
        return np.array([np.clip(self.balance, -50, 50), self.turns], np.float32)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        before = abs(self.balance)
        self.balance += int(action) - 1.5
        self.rewards[agent] = before - abs(self.balance)
        self.turns += 1
        if self.turns >= self.rounds * len(self.agents):
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        self.agent_selection = self._selector.next()


class Icewalk(AECEnv):
    """Walkers cross a frozen pond, and slip now and then."""

    metadata = {"name": "icewalk_v0", "render_modes": []}

    def __init__(self, n=2, width=9):
        super().__init__()
        self.width = width
        self.possible_agents = [f"walker_{i}" for i in range(n)]
        self.agents = []
        self._obs = {a: spaces.Box(0, 60, (n + 1,), np.float32) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(3) for a in self.possible_agents}
        self.ice = random.Random()

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
        self.x = {a: int(self.rng.integers(0, 3)) for a in self.agents}
        self.turns = 0
        self.agent_selection = self.agents[0]

    def observe(self, agent):
        return np.array([*(self.x[a] for a in self.possible_agents), self.turns], np.float32)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        if self.ice.random() < 0.1:
            action = 0
        self.x[agent] = min(max(self.x[agent] + (0, 1, -1)[action], 0), self.width - 1)
        self.turns += 1
        if self.x[agent] == self.width - 1:
            self.rewards[agent] = 1.0
            self.terminations = dict.fromkeys(self.agents, True)
        elif self.turns >= 50:
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        at = self.agents.index(agent)
        self.agent_selection = self.agents[(at + 1) % len(self.agents)]


class Choir(AECEnv):
    """Singers choose tones; late in an episode what they hear is softened."""

    metadata = {"name": "choir_v0", "render_modes": []}

    def __init__(self):
        super().__init__()
        self.possible_agents = ["alto", "bass"]
        self.agents = []
        self._obs = {a: spaces.Box(0, 1, (4,), np.float32) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(5) for a in self.possible_agents}

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
        self.heard = self.rng.random(4).astype(np.float32)
        self.turns = 0
        self._selector = AgentSelector(self.agents)
        self.agent_selection = self._selector.next()

    def observe(self, agent):
        if self.turns > 14:
            return self.heard * 0.5 + np.linspace(0, 0.5, 4)
        return self.heard.copy()

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.heard = np.roll(self.heard, 1)
        self.heard[0] = action / 4
        self.rewards[agent] = float(1 - abs(self.heard[0] - self.heard[1]))
        self.turns += 1
        if self.turns >= 24:
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        self.agent_selection = self._selector.next()


# Sound ones.


class Dice(AECEnv):
    """Players roll or stand; those that roll a one are out, and the order turns each round."""

    metadata = {"name": "dice_v0", "render_modes": [], "is_parallelizable": False}

    def __init__(self, n=4):
        super().__init__()
        self.possible_agents = [f"p{i}" for i in range(n)]
        self.agents = []
        self._obs = {a: spaces.MultiDiscrete([200, 7, 2]) for a in self.possible_agents}
        self._act = {a: spaces.Discrete(2) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        if seed is not None or not hasattr(self, "rng"):
            self.rng = random.Random(seed)
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {"rolls": 0} for a in self.agents}
        self.score = dict.fromkeys(self.agents, 0)
        self.seen = dict.fromkeys(self.agents, 0)
        self.round = 0
        self.waiting = self.agents[:]
        self.rng.shuffle(self.waiting)
        self.agent_selection = self.waiting.pop(0)

    def observe(self, agent):
        return np.array([self.score[agent], self.seen[agent], self.round % 2], np.int64)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0
        self._clear_rewards()
        if action:
            roll = self.rng.randint(1, 6)
            self.seen[agent] = roll
            self.infos[agent] = {"rolls": self.infos[agent]["rolls"] + 1}
            if roll == 1:
                self.terminations[agent] = True
                self.rewards[agent] = -self.score[agent]
            else:
                self.score[agent] += roll
                self.rewards[agent] = roll
        if not self.waiting:
            self.round += 1
            live = [a for a in self.agents if not self.terminations[a]]
            if self.round >= 12 or not live:
                for a in live:
                    self.truncations[a] = True
            else:
                self.waiting = live
                self.rng.shuffle(self.waiting)
        self._accumulate_rewards()
        if self.waiting:
            self.agent_selection = self.waiting.pop(0)
        else:
            self.agent_selection = self.agents[0]
        self._deads_step_first()


class Parley(AECEnv):
    """Envoys speak words of a fixed list, and draw their moods from a generator of their own."""

    metadata = {"name": "parley_v0", "render_modes": ["ansi"], "render_fps": 2}
    WORDS = ("peace", "war", "trade", "silence")

    def __init__(self, render_mode=None):
        super().__init__()
        self.render_mode = render_mode
        self.possible_agents = ["east", "west"]
        self.agents = []
        self._obs = {
            a: spaces.Dict({"heard": spaces.Discrete(5), "mood": spaces.Box(-1, 1, (), np.float32)})
            for a in self.possible_agents
        }
        self._act = {a: spaces.Discrete(4) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        if seed is not None or not hasattr(self, "np_random"):
            self.np_random = np.random.RandomState(seed)
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        self.mood = {a: self.np_random.uniform(-1, 1) for a in self.agents}
        self.said = dict.fromkeys(self.agents, 4)
        self.turns = 0
        self.agent_selection = "east" if self.np_random.rand() < 0.5 else "west"

    def observe(self, agent):
        other = "west" if agent == "east" else "east"
        return {"heard": np.int64(self.said[other]), "mood": np.array(self.mood[agent], np.float32)}

    def render(self):
        if self.render_mode != "ansi":
            return None
        words = [*self.WORDS, "-"]
        return " | ".join(f"{a}: {words[self.said[a]]}" for a in self.possible_agents)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        other = "west" if agent == "east" else "east"
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.said[agent] = int(action)
        shift = {0: 0.2, 1: -0.4, 2: 0.1, 3: 0.0}[int(action)]
        self.mood[other] = float(np.clip(self.mood[other] + shift, -1, 1))
        self.turns += 1
        if action == 0 and self.said[other] == 0:
            self.rewards = dict.fromkeys(self.agents, 1.0)
            self.terminations = dict.fromkeys(self.agents, True)
        elif self.turns >= 30:
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        self.agent_selection = other
