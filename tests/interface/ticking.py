"""Games played from a script, all at once and in rounds of turns, and what they give."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from hypothesis import strategies as st
from pettingzoo import AECEnv, ParallelEnv

NAMES = [f"agent_{i}" for i in range(10)]
ACTIONS = Discrete(4)
SIGHT = Box(-np.inf, np.inf, (3,), np.float64)
Given = tuple[Any, ...]  # observation, reward, terminated, truncated, info
Rows = list[list[tuple[str, Given, Any]]]  # by tick: who, what it was given, what it did


@dataclass(frozen=True)
class Round:
    """What one round does. Numbers of agents are taken modulo the length of the roster."""

    pays: tuple[tuple[int, float], ...]
    ends: tuple[tuple[int, bool], ...]
    joins: int
    turned: int  # by how many places the order is rotated; odd: reversed too


ROUNDS = st.builds(
    Round,
    st.lists(st.tuples(st.integers(0, 9), st.floats(-1e3, 1e3)), max_size=4).map(tuple),
    st.just(()) | st.lists(st.tuples(st.integers(0, 9), st.booleans()), max_size=3).map(tuple),
    st.sampled_from([0, 0, 0, 1, 2]),
    st.integers(0, 5),
)
SCRIPTS = st.lists(ROUNDS, min_size=1, max_size=8)


class Script:
    """The rules: everybody's hash of all that was done so far, and what the script says."""

    possible_agents = NAMES
    render_mode = None

    def __init__(self, n: int, script: list[Round]) -> None:
        super().__init__()
        self.n, self.script = n, script

    def observation_space(self, agent: str) -> Box:
        return SIGHT

    def action_space(self, agent: str) -> Discrete:
        return ACTIONS

    def state(self) -> Any:
        return np.array([self.past, self.time])

    def _begin(self, seed: int | None) -> None:
        self.time, self.past, self.born = 0, float(seed or 0), self.n

    def _see(self, agent: str) -> Any:
        return np.array([NAMES.index(agent), self.time, self.past])

    def _info(self, agent: str) -> dict[str, Any]:
        return {"time": self.time, "mask": [self.past % 2, agent]}

    def _play(self, actions: dict[str, int]) -> None:
        for agent, action in actions.items():
            self.past = (self.past * 7 + NAMES.index(agent) * 4 + action) % 1009

    def _order(self, agents: list[str]) -> list[str]:
        """The order of a round hangs on the script, and on what was done before."""
        turned = (self.script[self.time].turned if self.time < len(self.script) else 0) + int(
            self.past
        )
        at = turned % len(agents) if agents else 0
        order = agents[at:] + agents[:at]
        return order[::-1] if turned % 2 else order


class Ticks(Script, ParallelEnv):  # type: ignore[type-arg, misc]  # no type parameters at run time
    """All at once; the roster itself is in another order after each tick."""

    metadata = {"name": "ticks_v0", "render_modes": []}  # noqa: RUF012  # PettingZoo's way
    in_order = True  # actions come in the order of the roster

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self._begin(seed)
        self.agents = self._order(NAMES[: self.n])
        return {a: self._see(a) for a in self.agents}, {a: self._info(a) for a in self.agents}

    def step(self, actions: dict[str, int]) -> Any:
        assert not self.in_order or list(actions) == self.agents
        play = self.script[self.time]
        self._play(actions)
        self.time += 1
        everybody = self.agents + NAMES[self.born : self.born + play.joins]
        self.born += play.joins
        rewards = dict.fromkeys(everybody, 0.0)
        terminations, truncations = dict.fromkeys(everybody, False), dict.fromkeys(everybody, False)
        for index, amount in play.pays:
            rewards[everybody[index % len(everybody)]] += amount
        for index, terminated in play.ends:
            (terminations if terminated else truncations)[everybody[index % len(everybody)]] = True
        if self.time == len(self.script):
            truncations = dict.fromkeys(everybody, True)
        observations = {agent: self._see(agent) for agent in everybody}
        infos = {agent: self._info(agent) for agent in everybody}
        live = [a for a in everybody if not (terminations[a] or truncations[a])]
        self.agents = self._order(live)
        return observations, rewards, terminations, truncations, infos


class Turns(Script, AECEnv):  # type: ignore[type-arg, misc]  # no type parameters at run time
    """In rounds of turns, each in an order of its own, by PettingZoo's own helpers.

    `hasty`: what a round pays and ends comes with its first turn, so that agents die in mid-round.
    """

    metadata = {"name": "turns_v0", "is_parallelizable": True}  # noqa: RUF012  # PettingZoo's way

    def __init__(self, n: int, script: list[Round], *, hasty: bool = False) -> None:
        super().__init__(n, script)
        self.hasty = hasty

    def observe(self, agent: str) -> Any:
        return self._see(agent)

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self._begin(seed)
        self.agents = NAMES[: self.n]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: self._info(agent) for agent in self.agents}
        self.waiting = self._order(self.agents)
        self.done: dict[str, int] = {}
        self.agent_selection = self.waiting[0]

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._clear_rewards()
        self._cumulative_rewards[agent] = 0.0
        is_first = not self.done
        self.done[agent] = action
        self.waiting.remove(agent)
        if is_first and self.hasty:
            self._resolve()
        self.waiting = [a for a in self.waiting if not self._ended(a)]
        if not self.waiting:
            self._end_round()
        if self.waiting:
            self.agent_selection = self.waiting[0]
        self._accumulate_rewards()
        self._deads_step_first()

    def _ended(self, agent: str) -> bool:
        return self.terminations[agent] or self.truncations[agent]

    def _resolve(self) -> None:
        play = self.script[self.time]
        for index, amount in play.pays:
            self.rewards[self.agents[index % len(self.agents)]] += amount
        for index, terminated in play.ends:
            flags = self.terminations if terminated else self.truncations
            flags[self.agents[index % len(self.agents)]] = True

    def _end_round(self) -> None:
        play = self.script[self.time]
        if not self.hasty:
            self._resolve()
        self._play(dict(sorted(self.done.items())))
        self.time += 1
        for agent in NAMES[self.born : self.born + play.joins]:
            self.agents.append(agent)
            self.rewards[agent] = self._cumulative_rewards[agent] = 0.0
            self.terminations[agent] = self.truncations[agent] = False
        self.born += play.joins
        if self.time == len(self.script):
            self.truncations = dict.fromkeys(self.agents, True)
        self.infos = {agent: self._info(agent) for agent in self.agents}
        self.done = {}
        self.waiting = self._order([a for a in self.agents if not self._ended(a)])


def choice(agent: str, given: Given) -> int:
    """What an agent does: it hangs on all that it was given, but for who else is there."""
    observation, reward, *_ = given
    return int(observation[2] + NAMES.index(agent) + abs(reward)) % 4


def parallel_rows(env: Any, seed: int, choose: Callable[[str, Given], int] = choice) -> Rows:
    """By tick, what everybody was given and did, the last words of those who ended at their end."""
    observations, infos = env.reset(seed=seed)
    given = {a: (observations[a], 0.0, False, False, infos[a]) for a in env.agents}
    rows: Rows = []
    while env.agents:
        actions = {agent: choose(agent, given[agent]) for agent in env.agents}
        rows.append([(agent, given[agent], actions[agent]) for agent in env.agents])
        parts = env.step(actions)
        assert len({frozenset(part) for part in parts}) == 1, "five dictionaries of the same agents"
        given = {agent: tuple(part[agent] for part in parts) for agent in parts[0]}
        rows[-1] += [(a, given[a], None) for a in sorted(given) if a not in env.agents]
    return rows


def aec_rows(env: Any, seed: int, choose: Callable[[str, Given], int] = choice) -> Rows:
    """The same of an AEC environment: a tick is what the rules count as one."""
    env.reset(seed=seed)
    rows: Rows = []
    dying: list[tuple[str, Given, Any]] = []
    for agent in env.agent_iter():
        given = env.last()
        if given[2] or given[3]:
            dying.append((agent, given, None))
            env.step(None)
            continue
        if env.unwrapped.time == len(rows):
            if dying:
                rows[-1] += sorted(dying, key=lambda row: row[0])
            rows.append([])
            dying = []
        action = choose(agent, given)
        rows[-1].append((agent, given, action))
        env.step(action)
    rows[-1] += sorted(dying, key=lambda row: row[0])
    return rows


def plain(rows: Rows) -> str:
    """Rows as text, equal where every bit of every number is."""
    return "\n".join(
        f"{tick} {agent} {given[0].tobytes().hex()} {float(given[1]).hex()} "
        f"{given[2:]!r} {action!r}"
        for tick, round_ in enumerate(rows)
        for agent, given, action in round_
    )
