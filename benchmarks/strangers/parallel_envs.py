"""Small Parallel environments, written as a stranger writes them: own books, own wrappers.

Nothing here uses gamekeeper. What is planted in the faulty ones stands in audit.py.
"""

from __future__ import annotations

import functools
import itertools
import json
from collections import deque

import numpy as np
import scipy.ndimage  # heavy, for one convolution
from gymnasium import spaces
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

# Faulty ones.


class Harbour(ParallelEnv):
    """Boats look for free berths; a berth takes one boat a tick."""

    metadata = {"name": "harbour_v1", "render_modes": [], "is_parallelizable": True}

    def __init__(self, n_boats=4, n_berths=3, max_cycles=25):
        self.possible_agents = ["tug", "barge", "ferry", "trawler", "yacht", "liner"][:n_boats]
        self.agents = []
        self.n_berths = n_berths
        self.max_cycles = max_cycles
        self._obs_space = spaces.Dict(
            {
                "chart": spaces.Box(0, 255, (n_berths, 6, 3), dtype=np.uint8),
                "swell": spaces.Box(-8.0, 8.0, (2,), dtype=np.float32),
                "moored": spaces.Discrete(2),
            }
        )
        self._spaces = dict.fromkeys(self.possible_agents, self._obs_space)
        self._act = {a: spaces.Discrete(n_berths + 1) for a in self.possible_agents}
        self.state_space = spaces.Box(-10, 10, (n_berths + 2,), dtype=np.float32)

    def observation_space(self, agent):
        return self._spaces[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        if seed is not None or not hasattr(self, "np_random"):
            self.np_random = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.t = 0
        self.berths = [None] * self.n_berths
        self.swell = self.np_random.uniform(-1, 1, 2).astype(np.float32)
        return self._get_obs(), {a: {} for a in self.agents}

    def step(self, actions):
        rewards = dict.fromkeys(self.agents, 0.0)
        wanting = {a for a in self.agents if actions[a] > 0 and a not in self.berths}
        for boat in wanting:
            berth = int(actions[boat]) - 1
            if self.berths[berth] is None:
                self.berths[berth] = boat
                rewards[boat] += 1.0
            else:
                rewards[boat] -= 0.1
        for i, boat in enumerate(self.berths):
            if boat is not None and self.np_random.random() < 0.3:
                self.berths[i] = None
        self.swell = np.clip(self.swell + self.np_random.normal(0, 0.1, 2), -8, 8)
        self.swell = self.swell.astype(np.float32)
        self.t += 1
        over = self.t >= self.max_cycles
        terminations = dict.fromkeys(self.agents, False)
        truncations = dict.fromkeys(self.agents, over)
        obs = self._get_obs()
        infos = {a: {"t": self.t} for a in self.agents}
        if over:
            self.agents = []
        return obs, rewards, terminations, truncations, infos

    def state(self):
        taken = [0.0 if b is None else 1.0 + self.possible_agents.index(b) for b in self.berths]
        noise = self.np_random.normal(0, 0.01, 2)
        return np.clip(np.array([*taken, *(self.swell + noise)]), -10, 10).astype(np.float32)

    def _get_obs(self):
        chart = np.zeros((self.n_berths, 6, 3), dtype=np.uint8)
        for i, boat in enumerate(self.berths):
            if boat is not None:
                chart[i, self.possible_agents.index(boat)] = (255, 128, 0)
        return {
            a: {
                "chart": chart.copy(),
                "swell": self.swell.copy(),
                "moored": np.int64(a in self.berths),
            }
            for a in self.agents
        }


class Canvas(ParallelEnv):
    """Painters of one canvas; who paints a free pixel is paid."""

    metadata = {"name": "canvas", "render_modes": ["rgb_array"], "render_fps": 5}

    def __init__(self, size=8, painters=3, render_mode=None):
        self.size = size
        self.possible_agents = [f"painter_{i}" for i in range(painters)]
        self.agents = []
        self.render_mode = render_mode
        self.obs_space = spaces.Box(0, 255, (size, size, 3), np.uint8)
        self.act_space = {a: spaces.Discrete(5) for a in self.possible_agents}

    @functools.cache  # noqa: B019
    def observation_space(self, agent):
        return spaces.Box(0, 255, (self.size, self.size, 3), np.uint8)

    def action_space(self, agent):
        return self.act_space[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.RandomState(seed)
        self.agents = list(self.possible_agents)
        self.canvas = np.zeros((self.size, self.size, 3), np.uint8)
        self.where = {a: self.rng.randint(0, self.size, 2) for a in self.agents}
        self.steps = 0
        self._draw()
        return self._all(), self._infos()

    def _infos(self):
        return {a: {"painted": int((self.canvas[:, :, 0] > 0).sum())} for a in self.agents}

    def _draw(self):
        for k, a in enumerate(self.agents):
            r, c = self.where[a]
            if not self.canvas[r, c].any():
                self.canvas[r, c] = (60 + 60 * k, 255 - 60 * k, 10)

    def _all(self):
        return dict.fromkeys(self.agents, self.canvas)

    def step(self, actions):
        moves = [(0, 0), (0, 1), (1, 0), (0, -1), (-1, 0)]
        before = int((self.canvas[:, :, 0] > 0).sum())
        for a in self.agents:
            self.where[a] = np.clip(self.where[a] + moves[actions[a]], 0, self.size - 1)
        self._draw()
        after = int((self.canvas[:, :, 0] > 0).sum())
        self.steps += 1
        done = self.steps >= 30
        out = (
            self._all(),
            {a: float(after - before) for a in self.agents},
            dict.fromkeys(self.agents, after == self.size**2),
            dict.fromkeys(self.agents, done),
            self._infos(),
        )
        if done or after == self.size**2:
            self.agents = []
        return out

    def render(self):
        if self.render_mode == "rgb_array":
            return np.repeat(np.repeat(self.canvas, 8, 0), 8, 1)
        return None


class Relay(ParallelEnv):
    """Runners pass a baton along a track; a handover and each metre are paid."""

    metadata = {"name": "relay_v0", "render_modes": []}

    def __init__(self, lap=6):
        self.possible_agents = ["ada", "bo", "cy"]
        self.agents = []
        self.lap = lap
        box = spaces.Box(0, 1, (4,), dtype=np.float64)
        self.observation_spaces = dict.fromkeys(self.possible_agents, box)
        self.action_spaces = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self.observation_spaces[agent]

    def action_space(self, agent):
        return self.action_spaces[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.holder = int(self.rng.integers(3))
        self.pos = 0
        self.t = 0
        self.handed = None
        return self.observe_all(), {a: {} for a in self.agents}

    def observe_all(self):
        out = {}
        for i, a in enumerate(self.possible_agents):
            if a in self.agents:
                out[a] = np.array(
                    [i == self.holder, self.pos / self.lap, self.t / 40, (self.holder - i) % 3 / 2],
                    dtype=np.float64,
                )
        return out

    def step(self, actions):
        rewards = dict.fromkeys(self.agents, 0.0)
        if self.handed is not None:  # the bonus for handing over
            rewards[self.possible_agents[self.handed]] += 5.0
            self.handed = None
        name = self.possible_agents[self.holder]
        if actions[name] == 1:
            self.pos += 1
            rewards[name] += 0.5
        elif actions[name] == 2 and self.pos > 0:
            nxt = (self.holder + 1) % 3
            if actions[self.possible_agents[nxt]] == 2:
                self.handed = self.holder
                self.holder = nxt
        self.t += 1
        finished = self.pos >= self.lap
        late = self.t >= 40
        terminated = dict.fromkeys(self.agents, finished)
        truncated = dict.fromkeys(self.agents, late and not finished)
        obs = self.observe_all()
        infos = {a: {} for a in self.agents}
        if finished or late:
            self.agents = []
        return obs, rewards, terminated, truncated, infos


class Depot(ParallelEnv):
    """Carts fill up at shelves and unload at the door."""

    metadata = {"name": "depot_v2", "render_modes": []}
    shelves = np.full(4, 30)

    def __init__(self, num_carts=2, capacity=5):
        self.possible_agents = [f"cart{i}" for i in range(num_carts)]
        self.agents = self.possible_agents[:]
        self.capacity = capacity
        self._obs = {
            a: spaces.MultiDiscrete([capacity + 1, 5, 31, 31, 31, 31]) for a in self.possible_agents
        }
        self._act = {a: spaces.MultiDiscrete([5, 3]) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs[agent]

    def action_space(self, agent):
        return self._act[agent]

    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.shelves[:] = self.rng.integers(10, 31, 4)
        self.load = dict.fromkeys(self.agents, 0)
        self.at = dict.fromkeys(self.agents, 0)
        self.clock = 0
        return self.obs(), {a: {} for a in self.agents}

    def obs(self):
        return {
            a: np.array([self.load[a], self.at[a], *self.shelves], dtype=np.int64)
            for a in self.agents
        }

    def step(self, actions):
        rew = dict.fromkeys(self.agents, 0.0)
        for a in self.agents:
            place, what = (int(x) for x in actions[a])
            if what == 0:
                self.at[a] = place
            elif what == 1 and self.at[a] > 0:
                shelf = self.at[a] - 1
                amount = min(2, int(self.shelves[shelf]))
                if self.load[a] < self.capacity:
                    self.shelves[shelf] -= amount
                    self.load[a] += amount
            elif what == 2 and self.at[a] == 0:
                rew[a] += float(self.load[a])
                self.load[a] = 0
        self.clock += 1
        end = self.clock >= 60
        ret = (
            self.obs(),
            rew,
            dict.fromkeys(self.agents, False),
            dict.fromkeys(self.agents, end),
            {a: {} for a in self.agents},
        )
        self.agents = [] if end else self.agents
        return ret


# Sound ones.


class Station(ParallelEnv):
    """Trains come and go: agents join late, leave early, and never come back."""

    metadata = {"name": "station_v0", "render_modes": []}

    def __init__(self, trains=7, tracks=3):
        self.trains = trains
        self.tracks = tracks
        self.possible_agents = [f"train-{i}" for i in range(trains)]
        self.agents = []
        self._o = {
            a: spaces.Tuple((spaces.Box(0, 100, (3,), np.float32), spaces.MultiBinary(tracks)))
            for a in self.possible_agents
        }
        self._a = {a: spaces.Discrete(3, start=-1) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._o[agent]

    def action_space(self, agent):
        return self._a[agent]

    def reset(self, seed=None, options=None):
        self._rng = np.random.default_rng(seed)
        starts = np.sort(self._rng.integers(0, 12, self.trains))
        starts -= starts.min()
        self.arrivals = deque(zip(starts.tolist(), self.possible_agents, strict=True))
        self.time = 0
        self.dist = {}
        self.speed = {}
        self.agents = []
        self._arrive()
        return self._observe(self.agents), {a: {"dist": self.dist[a]} for a in self.agents}

    def _arrive(self):
        while self.arrivals and self.arrivals[0][0] <= self.time:
            _, name = self.arrivals.popleft()
            self.agents.append(name)
            self.dist[name] = float(np.float32(self._rng.uniform(5, 12)))
            self.speed[name] = 1.0

    def _observe(self, names):
        used = np.zeros(self.tracks, np.int8)
        for k, a in enumerate(self.agents):
            used[k % self.tracks] = self.dist[a] < 3
        return {
            a: (np.array([max(self.dist[a], 0), self.speed[a], self.time], np.float32), used.copy())
            for a in names
        }

    def step(self, actions):
        self.time += 1
        acting = list(self.agents)
        rewards, term, trunc = {}, {}, {}
        for a in acting:
            self.speed[a] = float(np.clip(self.speed[a] + 0.5 * int(actions[a]), 0, 3))
            self.dist[a] -= self.speed[a]
            term[a] = self.dist[a] <= 0
            trunc[a] = not term[a] and self.time >= 40
            rewards[a] = 10 - self.time if term[a] else -1
        self.agents = [a for a in acting if not (term[a] or trunc[a])]
        if self.time < 40:
            self._arrive()
        new = [a for a in self.agents if a not in acting]
        told = acting + new
        obs = self._observe(told)
        for a in new:
            rewards[a], term[a], trunc[a] = 0, False, False
        if not self.agents and self.arrivals and self.time < 40:
            # nobody is here: the clock runs on to the next arrival
            self.time = max(self.time, self.arrivals[0][0])
            self._arrive()
            for a in self.agents:
                rewards[a], term[a], trunc[a] = 0, False, False
            obs.update(self._observe(self.agents))
        infos = {a: {"dist": self.dist[a]} for a in obs}
        return obs, rewards, term, trunc, infos


class Tournament(ParallelEnv):
    """Rock, paper, scissors of a field whose size is an option of reset; the rest sits out."""

    metadata = {"name": "tournament_v3", "render_modes": ["ansi"]}

    def __init__(self, field=5, rounds=12, render_mode=None):
        self.render_mode = render_mode
        self.rounds = rounds
        self.possible_agents = [f"p{i}" for i in range(field)]
        self.agents = []
        n = 4
        self._obs_space = {a: spaces.MultiDiscrete([n] * field) for a in self.possible_agents}
        self._act_space = {a: spaces.Discrete(3) for a in self.possible_agents}

    def observation_space(self, agent):
        return self._obs_space[agent]

    def action_space(self, agent):
        return self._act_space[agent]

    def reset(self, seed=None, options=None):
        if seed is not None:
            self._seeds = np.random.SeedSequence(seed)
        elif not hasattr(self, "_seeds"):
            self._seeds = np.random.SeedSequence()
        self.rng = np.random.Generator(np.random.Philox(self._seeds.spawn(1)[0]))
        players = int((options or {}).get("players", len(self.possible_agents)))
        self.agents = self.possible_agents[:players]
        self.score = dict.fromkeys(self.agents, 0)
        self.last = dict.fromkeys(self.possible_agents, 3)
        self.bye = int(self.rng.integers(len(self.agents)))
        self.n = 0
        print("-" * 40, f"a tournament of {players}", "-" * 40, sep="\n")
        return self._o(), self._i()

    def _o(self):
        row = list(self.last.values())
        return {a: np.asarray(row, dtype=np.int64) for a in self.agents}

    def _i(self):
        return {a: {"score": self.score[a], "bye": a == self.agents[self.bye]} for a in self.agents}

    def step(self, actions):
        rest = self.agents[self.bye]
        for a in self.agents:
            self.last[a] = int(actions[a])
        pay = dict.fromkeys(self.agents, 0)
        playing = [a for a in self.agents if a != rest]
        for a, b in itertools.combinations(playing, 2):
            won = (0, 1, -1)[(self.last[a] - self.last[b]) % 3]
            pay[a] += won
            pay[b] -= won
        for a in self.agents:
            self.score[a] += pay[a]
        self.n += 1
        self.bye = int(self.rng.integers(len(self.agents)))
        over = self.n == self.rounds
        obs, infos = self._o(), self._i()
        term = dict.fromkeys(self.agents, over)
        trunc = dict.fromkeys(self.agents, False)
        if over:
            self.agents = []
        return obs, pay, term, trunc, infos

    def render(self):
        return json.dumps({"last": self.last, "score": self.score})


class Ripples(ParallelEnv):
    """A pond without chance; stones make waves, which are seen as a read-only picture."""

    metadata = {"name": "ripples", "render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, size=12, render_mode=None):
        self.render_mode = render_mode
        self.size = size
        self.possible_agents = ["left", "right"]
        self.agents = []
        self.spaces = {
            "left": spaces.Box(0, 255, (size, size, 1), np.uint8),
            "right": spaces.Box(0, 255, (size, size, 1), np.uint8),
        }
        self.acts = {a: spaces.Box(-1.0, 1.0, (2,), np.float32) for a in self.possible_agents}
        self.kernel = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4

    def observation_space(self, agent):
        return self.spaces[agent]

    def action_space(self, agent):
        return self.acts[agent]

    def reset(self, seed=None, options=None):
        self.agents = ["left", "right"]
        self.h = np.zeros((self.size, self.size))
        self.v = np.zeros_like(self.h)
        self.t = 0
        return self._see(), {a: {} for a in self.agents}

    def _see(self):
        picture = (127 + 127 * np.tanh(self.h)).astype(np.uint8)[:, :, None]
        mirrored = picture[:, ::-1].copy()
        picture.setflags(write=False)
        mirrored.setflags(write=False)
        return {"left": picture, "right": mirrored}

    def step(self, actions):
        for a in self.agents:
            r, c = ((np.asarray(actions[a]) + 1) / 2 * (self.size - 1)).round().astype(int)
            c = self.size - 1 - c if a == "right" else c
            self.h[np.clip(r, 0, self.size - 1), np.clip(c, 0, self.size - 1)] -= 1
        self.v += scipy.ndimage.convolve(self.h, self.kernel, mode="wrap") - self.h
        self.h = 0.95 * (self.h + self.v)
        self.t += 1
        half = self.size // 2
        balance = float(self.h[:, :half].sum() - self.h[:, half:].sum())
        rewards = {"left": balance, "right": -balance}
        over = self.t >= 20
        out = (
            self._see(),
            rewards,
            {"left": False, "right": False},
            {"left": over, "right": over},
            {"left": {}, "right": {}},
        )
        self.agents = [] if over else self.agents
        return out

    def render(self):
        if self.render_mode is None:
            return None
        grey = (127 + 127 * np.tanh(self.h)).astype(np.uint8)
        return np.stack([grey] * 3, -1)


class Scaled(BaseParallelWrapper):
    """Scales observations to [0, 1] and adds the agent's number."""

    def observation_space(self, agent):
        if agent not in self.__dict__.setdefault("_mine", {}):
            size = self.env.observation_space(agent).shape[0]
            self._mine[agent] = spaces.Box(0.0, 1.0, (size + 1,), np.float32)
        return self._mine[agent]

    def _scale(self, obs):
        out = {}
        for agent, values in obs.items():
            index = self.possible_agents.index(agent) / len(self.possible_agents)
            out[agent] = np.append(values / 10.0, index).astype(np.float32)
        return out

    def reset(self, seed=None, options=None):
        obs, infos = self.env.reset(seed=seed, options=options)
        return self._scale(obs), infos

    def step(self, actions):
        obs, rewards, terms, truncs, infos = self.env.step(actions)
        return self._scale(obs), rewards, terms, truncs, infos


class Pasture(ParallelEnv):
    """Sheep graze on a common; the hungry die, and the grass grows by chance."""

    metadata = {"name": "pasture", "render_modes": []}

    def __init__(self):
        self.possible_agents = [f"sheep_{n}" for n in range(5)]
        self.agents = []
        self.obs_spaces = {a: spaces.Box(0, 10, (3,), np.float64) for a in self.possible_agents}
        self.act_spaces = {a: spaces.Discrete(2) for a in self.possible_agents}
        self.state_space = spaces.Box(0, 10, (6,), np.float32)

    def observation_space(self, agent):
        return self.obs_spaces[agent]

    def action_space(self, agent):
        return self.act_spaces[agent]

    def reset(self, seed=None, options=None):
        self.random = np.random.default_rng(seed)
        self.agents = self.possible_agents.copy()
        self.food = dict.fromkeys(self.agents, 3.0)
        self.grass = 5.0
        self.day = 0
        return self._obs(self.agents), {a: {} for a in self.agents}

    def _obs(self, names):
        return {a: np.array([self.food[a], self.grass, len(self.agents)]) for a in names}

    def step(self, actions):
        eaters = sum(actions[a] for a in self.agents)
        share = min(1.5, self.grass / eaters) if eaters else 0.0
        now = self.agents
        for a in now:
            self.food[a] = min(10.0, max(0.0, self.food[a] - 1 + share * actions[a]))
        self.grass = max(0.0, self.grass - share * eaters)
        for _ in range(len(now)):
            self.grass = min(10.0, self.grass + self.random.exponential(0.5))
        self.day += 1
        dead = {a: self.food[a] <= 0 for a in now}
        late = {a: self.day >= 50 and not dead[a] for a in now}
        self.agents = [a for a in now if not dead[a] and not late[a]]
        pay = {a: -5 if dead[a] else 1 for a in now}
        return self._obs(now), pay, dead, late, {a: {"day": self.day} for a in now}

    def state(self):
        row = [self.food[a] if a in self.agents else 0.0 for a in self.possible_agents]
        return np.array([*row, self.grass], np.float32)


def scaled_pasture():
    """The pasture in its wrapper."""
    return Scaled(Pasture())
