"""Small AEC environments, written as a stranger writes them: own books, own wrappers.

Nothing here uses gamekeeper. What is planted in the faulty ones stands in audit.py.
"""

from __future__ import annotations

import random
import time

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv
from pettingzoo.utils import AgentSelector, BaseWrapper, wrappers

# Faulty ones.


class Auction(AECEnv):
    """Bidders buy lots until they are bankrupt; whoever owns most at the end has a prize."""

    metadata = {"name": "auction_v0", "render_modes": []}

    def __init__(self, bidders=3, lots=8):
        super().__init__()
        self.lots = lots
        self.possible_agents = [f"bidder_{i}" for i in range(bidders)]
        self.observation_spaces = {
            a: spaces.Box(0, 100, (bidders + 2,), np.float32) for a in self.possible_agents
        }
        self.action_spaces = {a: spaces.Discrete(4) for a in self.possible_agents}
        self.agents = []

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options={}):  # noqa: B006  # as strangers write it
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        options = {} if options is None else options
        budgets = options.setdefault("budgets", dict.fromkeys(self.agents, 9))
        self.money = budgets
        self.owned = dict.fromkeys(self.agents, 0)
        for a in self.agents:
            self.money[a] = min(self.money[a], 12)
        self.bids = {}
        self.lot = 0
        self.value = int(self.rng.integers(1, 5))
        self.order = AgentSelector(self.agents)
        self.agent_selection = self.order.reset()

    def observe(self, agent):
        money = [max(self.money[a], 0) for a in self.possible_agents]
        return np.array([*money, self.value, self.lot], np.float32)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0
        self._clear_rewards()
        self.bids[agent] = min(int(action), self.money[agent])
        if self.order.is_last():
            self._settle()
        self._accumulate_rewards()
        if self.lot >= self.lots:
            richest = max(self.agents, key=self.owned.get)
            self.rewards[richest] += 10
        if all(self.terminations[a] or self.truncations[a] for a in self.agents):
            self.agent_selection = self.agents[0]
        else:
            self.agent_selection = self.order.next()
            self._deads_step_first()

    def _settle(self):
        live = [a for a in self.agents if not self.terminations[a]]
        top = max(self.bids.get(a, 0) for a in live)
        winners = [a for a in live if self.bids.get(a, 0) == top]
        winner = winners[int(self.rng.integers(len(winners)))]
        self.money[winner] -= top
        self.owned[winner] += 1
        self.rewards[winner] += self.value - top
        self.bids = {}
        self.lot += 1
        self.value = int(self.rng.integers(1, 5))
        for a in live:
            if self.money[a] <= 0:
                self.terminations[a] = True
        if self.lot >= self.lots:
            for a in self.agents:
                self.truncations[a] = not self.terminations[a]
        self.order.reinit([a for a in self.agents if not self.terminations[a]] or self.agents)


class Tiles(AECEnv):
    """Players lay tiles on a row; a bomb clears the place beside it."""

    metadata = {"name": "tiles_v1", "render_modes": ["human", "ansi"], "is_parallelizable": False}

    def __init__(self, width=9, render_mode=None):
        super().__init__()
        self.width = width
        self.render_mode = render_mode
        self.possible_agents = ["red", "blue"]
        self.agents = []
        self._obs = {
            a: spaces.Dict(
                {
                    "observation": spaces.Box(0, 2, (width,), np.int8),
                    "action_mask": spaces.Box(0, 1, (width,), np.int8),
                }
            )
            for a in self.possible_agents
        }
        self._act = {a: spaces.Discrete(width) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        self.agents = self.possible_agents[:]
        self.board = np.zeros(self.width, np.int8)
        self.turns = 0
        self._refresh()
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        self._sel = AgentSelector(self.agents)
        self.agent_selection = self._sel.next()

    def _refresh(self):
        self.legal = (self.board == 0).astype(np.int8)

    def observe(self, agent):
        return {"observation": self.board.copy(), "action_mask": self.legal.copy()}

    def step(self, action):
        if self.terminations[self.agent_selection] or self.truncations[self.agent_selection]:
            return self._was_dead_step(action)
        me = self.agent_selection
        assert self.board[action] == 0, "there is a tile"
        self._cumulative_rewards[me] = 0
        self._clear_rewards()
        self.board[action] = 1 + self.possible_agents.index(me)
        self._refresh()
        self.turns += 1
        if random.random() < 0.2:  # a gust lays a tile of nobody's
            free = np.flatnonzero(self.board == 0)
            if len(free):
                self.board[random.choice(free.tolist())] = 1
        if not (self.board == 0).any() or self.turns > 20:
            red = int((self.board == 1).sum()) - int((self.board == 2).sum())
            self.rewards = {"red": int(np.sign(red)), "blue": -int(np.sign(red))}
            self.terminations = dict.fromkeys(self.agents, True)
        self.agent_selection = self._sel.next()
        self._accumulate_rewards()
        return None

    def render(self):
        text = "".join(".RB"[x] for x in self.board)
        if self.render_mode == "ansi":
            return text
        print(text)
        return None


class Courier(AECEnv):
    """Couriers steer towards a door that is drawn anew; continuous actions."""

    metadata = {"name": "courier_v0", "render_modes": []}

    def __init__(self, n=2, limit=15):
        super().__init__()
        self.limit = limit
        self.possible_agents = [f"courier_{i}" for i in range(n)]
        self.agents = []
        self._o = {a: spaces.Box(-20, 20, (4,), np.float32) for a in self.possible_agents}
        self._a = {a: spaces.Box(-1, 1, (2,), np.float32) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._o[agent]

    def action_space(self, agent):
        return self._a[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.xy = {a: self.rng.uniform(-3, 3, 2) for a in self.agents}
        self.door = self.rng.uniform(-3, 3, 2)
        self.count = dict.fromkeys(self.agents, 0)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {} for a in self.agents}
        self.agent_selection = self.agents[0]

    def observe(self, agent):
        return np.array([*self.xy[agent], *self.door], np.float32)

    def step(self, action):
        a = self.agent_selection
        if self.terminations[a] or self.truncations[a]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[a] = 0.0
        self._clear_rewards()
        move = np.asarray(action, dtype=float)
        if time.time_ns() // 1000 % 10 == 0:  # the road is slippery
            move = move * 0.5
        self.xy[a] = np.clip(self.xy[a] + move, -20, 20)
        self.count[a] += 1
        if np.linalg.norm(self.xy[a] - self.door) < 0.7:
            self.rewards[a] = 1.0
            self.terminations[a] = True
        elif self.count[a] >= self.limit:
            self.truncations[a] = True
        self._accumulate_rewards()
        place = self.agents.index(a)
        self.agent_selection = self.agents[(place + 1) % len(self.agents)]
        self._deads_step_first()


class ClipInPlace(BaseWrapper):
    """Holds actions within a tighter bound than the space's."""

    def step(self, action):
        if action is not None:
            np.clip(action, -0.8, 0.8, out=action)
        super().step(action)


def courier():
    """The couriers in their wrappers."""
    return wrappers.OrderEnforcingWrapper(ClipInPlace(Courier()))


# Sound ones.


class Duel(AECEnv):
    """A zero-sum game of tokens whose order is drawn anew each round; the poorest goes."""

    metadata = {"name": "duel_v4", "render_modes": []}

    def __init__(self, players=4):
        super().__init__()
        self.possible_agents = ["north", "east", "south", "west"][:players]
        self.agents = []
        n = players
        self._o = {a: spaces.MultiDiscrete([200] * n + [n]) for a in self.possible_agents}
        self._a = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._o[agent]

    def action_space(self, agent):
        return self._a[agent]

    def reset(self, seed=None, options=None):
        if seed is not None or getattr(self, "rng", None) is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.tokens = dict.fromkeys(self.agents, 20)
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {"round": 0} for a in self.agents}
        self.round = 0
        self.stakes = {}
        self._new_round()

    def _new_round(self):
        self.queue = [self.agents[i] for i in self.rng.permutation(len(self.agents))]
        self.agent_selection = self.queue.pop(0)

    def observe(self, agent):
        counts = [self.tokens[a] for a in self.possible_agents]
        return np.array([*counts, self.possible_agents.index(agent)], dtype=np.int64)

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            if self.agents and not any(
                self.terminations[a] or self.truncations[a] for a in self.agents
            ):
                self._new_round()
            return
        self._cumulative_rewards[agent] = 0
        self._clear_rewards()
        self.stakes[agent] = int(action)
        if self.queue:
            self._accumulate_rewards()
            self.agent_selection = self.queue.pop(0)
            return
        self._settle()
        self._accumulate_rewards()
        if any(self.terminations.values()) or any(self.truncations.values()):
            self._deads_step_first()
        else:
            self._new_round()

    def _settle(self):
        bold = max(self.agents, key=lambda a: (self.stakes[a], -self.agents.index(a)))
        for a in self.agents:
            if a != bold:
                paid = min(1 + self.stakes[a], self.tokens[a])
                self.tokens[a] -= paid
                self.tokens[bold] += paid
                self.rewards[a] -= paid
                self.rewards[bold] += paid
        self.stakes = {}
        self.round += 1
        for a in self.agents:
            self.infos[a] = {"round": self.round}
            self.terminations[a] = self.tokens[a] == 0
        left = [a for a in self.agents if not self.terminations[a]]
        if len(left) == 1:
            self.terminations[left[0]] = True
        elif self.round >= 20:
            for a in left:
                self.truncations[a] = True


class Frost(AECEnv):
    """Walkers on a ring; who steps on ice is frozen and skipped for two rounds."""

    metadata = {"name": "frost_v0", "render_modes": []}

    def __init__(self, cells=10, walkers=3):
        super().__init__()
        self.cells = cells
        self.possible_agents = [f"walker_{i}" for i in range(walkers)]
        self.agents = []
        self.observation_spaces = {
            a: spaces.Dict(
                {
                    "observation": spaces.Box(0, 4, (cells,), np.int8),
                    "action_mask": spaces.MultiBinary(3),
                }
            )
            for a in self.possible_agents
        }
        self.action_spaces = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        print("reset", seed)
        self.rand = random.Random(seed)
        self.agents = self.possible_agents[:]
        self.ice = set(self.rand.sample(range(self.cells), 3))
        dry = [c for c in range(self.cells) if c not in self.ice]
        self.at = dict(zip(self.agents, self.rand.sample(dry, len(self.agents)), strict=True))
        self.frozen = dict.fromkeys(self.agents, 0)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {a: {"action_mask": self._mask(a)} for a in self.agents}
        self.moves = 0
        self.agent_selection = self.agents[0]

    def _free(self, cell):
        return cell % self.cells not in self.at.values()

    def _mask(self, agent):
        here = self.at[agent]
        return np.array([1, self._free(here + 1), self._free(here - 1)], dtype=np.int8)

    def observe(self, agent):
        row = np.zeros(self.cells, np.int8)
        for i in self.ice:
            row[i] = 4
        for k, a in enumerate(self.possible_agents):
            row[self.at[a]] = 1 + k
        return {"observation": row, "action_mask": self._mask(agent)}

    def step(self, action):
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        if action == 1 and self._free(self.at[agent] + 1):
            self.at[agent] = (self.at[agent] + 1) % self.cells
            self.rewards[agent] = 1.0
        elif action == 2 and self._free(self.at[agent] - 1):
            self.at[agent] = (self.at[agent] - 1) % self.cells
            self.rewards[agent] = 0.25
        if self.at[agent] in self.ice and action != 0:
            self.frozen[agent] = 2
            self.rewards[agent] -= 1.0
            if self.rand.random() < 0.5:
                self.ice.discard(self.at[agent])
        self.moves += 1
        if self.moves >= 36:
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()
        for a in self.agents:
            self.infos[a] = {"action_mask": self._mask(a)}
        self._choose(agent)

    def _choose(self, agent):
        place = self.agents.index(agent)
        while True:
            place = (place + 1) % len(self.agents)
            name = self.agents[place]
            if self.frozen[name] == 0 or self.truncations[name]:
                self.agent_selection = name
                return
            self.frozen[name] -= 1
