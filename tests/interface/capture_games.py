"""Environments played from scripts that Hypothesis draws, and what they were asked."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from hypothesis import strategies as st
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.rollouts.memory import MemorySink

NAMES = [f"agent_{i}" for i in range(6)]
SPACE = Box(-9, 9, (2,), np.float32)
ACTIONS = Discrete(3)
IDENTITY = {"name": "scripted_v0", "api": "any", "kwargs": {}}


@dataclass(frozen=True)
class Turn:
    """What one step does. Numbers of agents are taken modulo the length of the roster."""

    pays: tuple[tuple[int, Any], ...] = ()
    ends: tuple[tuple[int, Any], ...] = ()  # terminated if the second is True, else truncated
    leaves: tuple[int, ...] = ()  # without a word
    joins: int = 0
    info: Any = None
    then: int | None = None
    raises: bool = False
    strange: tuple[str, Any] | None = None  # a part of what a tick returns, and what stands for it


class ScriptError(Exception):
    """What a scripted environment raises."""


PAY = st.sampled_from([0, 1, -2, 0.0, -0.0, 0.5, 1e9, np.float64(0.25), np.float32(3), np.int64(7)])
STRANGE_PAY = st.sampled_from([None, "1", True, np.array([1.0, 2.0]), float("nan"), 1 << 60])
INFOS = st.sampled_from(
    [None, {"step": 1}, {"mask": np.array([1, 0], np.int8)}, {"action_mask": np.ones(3, np.int8)}]
)
TURNS = st.builds(
    Turn,
    pays=st.lists(st.tuples(st.integers(0, 5), PAY), max_size=3).map(tuple),
    ends=st.just(()) | st.lists(st.tuples(st.integers(0, 5), st.booleans()), max_size=2).map(tuple),
    leaves=st.sampled_from([(), (), (), (0,), (2,)]),
    joins=st.sampled_from([0, 0, 0, 1, 2]),
    info=INFOS,
    then=st.none() | st.integers(0, 5),
    raises=st.sampled_from([False] * 9 + [True]),
)
SCRIPTS = st.lists(TURNS, min_size=1, max_size=12)
NONCONFORMING_PARTS = st.tuples(
    st.sampled_from(["observations", "rewards", "terminations", "truncations", "infos"]),
    st.sampled_from([None, [], {}, "no", [1, 2], 7]),
)


class _Scripted:
    """What both APIs share: names, spaces, a state, and a list of the calls that were made."""

    metadata: ClassVar[dict[str, Any]] = {"name": "scripted_v0", "render_modes": ["ansi"]}
    render_mode = "ansi"

    def __init__(self, script: list[Turn], n: int = 3) -> None:
        self.script, self.n = script, n
        self.possible_agents = NAMES[:4]  # later ones come unannounced
        self.calls: list[str] = []

    def observation_space(self, agent: str) -> Space[Any]:
        return SPACE

    def action_space(self, agent: str) -> Space[Any]:
        return ACTIONS

    def state(self) -> Any:
        self.calls.append("state")
        return np.array([self.turn, len(self.agents)])

    def render(self) -> str:
        self.calls.append("render")
        return f"turn {self.turn}"

    def close(self) -> None:
        self.calls.append("close")

    def look(self, agent: str) -> Any:
        return np.array([self.turn, NAMES.index(agent)], np.float32)

    def start(self, seed: Any, options: Any) -> None:
        self.calls.append(f"reset {seed} {options}")
        self.agents = NAMES[: self.n]
        self.turn, self.born = 0, self.n

    def next(self, action: Any) -> Turn:
        self.calls.append(f"step {to_json(action)}")
        turn = self.script[self.turn % len(self.script)]
        self.turn += 1
        if turn.raises:
            raise ScriptError(f"at {self.turn}")
        return turn

    def newcomers(self, count: int) -> list[str]:
        found = NAMES[self.born : self.born + count]
        self.born += len(found)
        return found


class ScriptedParallel(_Scripted, ParallelEnv):  # type: ignore[type-arg, misc]
    """A Parallel environment played from a script."""

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        self.start(seed, options)
        return {a: self.look(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: Any) -> Any:
        turn = self.next(actions)
        agents = self.agents[:]
        rewards: dict[str, Any] = dict.fromkeys(agents, 0.0)
        terms, truncs = dict.fromkeys(agents, False), dict.fromkeys(agents, False)
        for index, amount in turn.pays:
            rewards[agents[index % len(agents)]] = amount
        for index, terminated in turn.ends:
            (terms if terminated else truncs)[agents[index % len(agents)]] = True
        gone = {agents[i % len(agents)] for i in turn.leaves}
        came = self.newcomers(turn.joins)
        self.agents = [a for a in agents if not (terms[a] or truncs[a] or a in gone)] + came
        shown = [a for a in agents if a not in gone] + came
        parts: dict[str, Any] = {
            "observations": {a: self.look(a) for a in shown},
            "rewards": {a: rewards.get(a, 0.0) for a in shown},
            "terminations": {a: terms.get(a, False) for a in shown},
            "truncations": {a: truncs.get(a, False) for a in shown},
            "infos": {a: {} if turn.info is None else dict(turn.info) for a in shown},
        }
        if turn.strange is not None:
            parts[turn.strange[0]] = turn.strange[1]
        return tuple(parts.values())


class ScriptedAEC(_Scripted, AECEnv):  # type: ignore[type-arg, misc]
    """An AEC environment played from a script, its books as PettingZoo documents them."""

    def reset(self, seed: Any = None, options: Any = None) -> None:
        self.start(seed, options)
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.agent_selection = self.agents[0]
        self._skip_agent_selection = None

    def observe(self, agent: str) -> Any:
        self.calls.append(f"observe {agent}")
        return self.look(agent)

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self.calls.append(f"step {to_json(action)}")
            self._was_dead_step(action)
            return
        turn = self.next(action)
        self._clear_rewards()
        self._cumulative_rewards[agent] = 0
        agents = self.agents[:]
        for index, amount in turn.pays:
            self.rewards[agents[index % len(agents)]] += amount
        for index, terminated in turn.ends:
            flags = self.terminations if terminated else self.truncations
            flags[agents[index % len(agents)]] = True
        for other in self.newcomers(turn.joins):
            self.agents.append(other)
            self.rewards[other] = self._cumulative_rewards[other] = 0
            self.terminations[other] = self.truncations[other] = False
            self.infos[other] = {}
        self._accumulate_rewards()
        for index in turn.leaves:
            if len(self.agents) > 1:
                self._remove(agents[index % len(agents)])
        if turn.info is not None and agent in self.infos:
            self.infos[agent] = dict(turn.info)
        able = [a for a in self.agents if not (self.terminations[a] or self.truncations[a])]
        place = agents.index(agent) + 1 if turn.then is None else turn.then
        self.agent_selection = (able or self.agents)[place % len(able or self.agents)]
        self._deads_step_first()

    def _remove(self, agent: str) -> None:
        if agent in self.agents:
            self.agents.remove(agent)
            for book in (self.rewards, self._cumulative_rewards, self.infos):
                book.pop(agent)
            self.terminations.pop(agent)
            self.truncations.pop(agent)


@dataclass
class Told:
    """What whoever played was told, as canonical text, and what each step paid."""

    lines: list[str] = field(default_factory=list)
    paid: dict[str, list[Any]] = field(default_factory=dict)

    def say(self, *parts: Any) -> None:
        self.lines.append(" ".join(map(to_json, parts)))

    def pay(self, rewards: Any) -> None:
        for agent, reward in rewards.items() if isinstance(rewards, dict) else ():
            self.paid.setdefault(agent, []).append(reward)


def play_parallel(env: Any, ticks: int, *, seed: int = 1) -> Told:
    """Plays `ticks` ticks; a raise is noted and played on from."""
    told = Told()
    told.say(*env.reset(seed=seed))
    for tick in range(ticks):
        agents = list(env.agents)
        if not agents:
            break
        actions = {a: np.int64((tick + i) % 3) for i, a in enumerate(agents)}
        try:
            out = env.step(actions)
        except ScriptError as error:
            told.say(str(error))
            continue
        told.say(out, list(env.agents))
        told.pay(out[1])
    return told


def play_aec(env: Any, turns: int, *, seed: int = 1, observe: bool = True) -> Told:
    """Plays `turns` turns by `last` and `step`; a raise is noted and played on from."""
    told = Told()
    env.reset(seed=seed)
    for turn in range(turns):
        if not env.agents:
            break
        agent = env.agent_selection
        seen = env.last(observe=observe)
        told.say(agent, seen, list(env.agents))
        over = env.terminations[agent] or env.truncations[agent]
        try:
            env.step(None if over else np.int64(turn % 3))
        except ScriptError as error:
            told.say(str(error))
            continue
        if not over:
            told.pay(dict(env.rewards))
        told.say(env.rewards, env.terminations, env.truncations)
    return told


def recorded(env: Any, **settings: Any) -> tuple[Any, MemorySink]:
    """A recorded environment over `env`, and the memory in which its evidence is kept."""
    sink = MemorySink(**{k: settings.pop(k) for k in ("volatile", "terms") if k in settings})
    return recorded_of(capture_of(env, sink=sink, **settings)), sink


def evidence_of(wrapped: Any, sink: MemorySink) -> Evidence:
    """The evidence of what was played so far; the episode in progress is closed."""
    wrapped._capture.end_episode()
    return sink.evidence(IDENTITY)


def without_looks(calls: list[str]) -> list[str]:
    """The calls but for those that the door may make by itself."""
    return [call for call in calls if call not in ("state", "render")]
