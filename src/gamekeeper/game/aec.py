"""The door to an AEC environment: a turn is one agent's turn.

Rows stand only for who acted, was paid, or whose flags or place in the roster changed: 2,048 agents
don't cost 2,048 rows a turn. What a crossing pays stands at its own turn; what it changes in flags
and roster stands at the next turn's start, as it does in a Parallel environment.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from time import perf_counter_ns
from typing import Any, Final

from pettingzoo.utils import wrappers

from gamekeeper.core.tape import Place
from gamekeeper.game.door import (
    BOOLS,
    EXACT,
    MISSING,
    REALS,
    AgentId,
    Game,
    odd,
    reward_of,
    type_name_of,
)

# wrappers of PettingZoo that keep no books of their own: these are read where they are kept, because
# an attribute costs 0.65 us for each wrapper that it falls through
TRANSPARENT: Final = (
    wrappers.BaseWrapper,
    wrappers.OrderEnforcingWrapper,
    wrappers.AssertOutOfBoundsWrapper,
    wrappers.ClipOutOfBoundsWrapper,
    wrappers.TerminateIllegalWrapper,
    wrappers.CaptureStdoutWrapper,
)
_NEVER: Final = object()


class AECGame(Game):
    """One live AEC environment behind the door."""

    api = "aec"

    def __init__(self, env: Any, **settings: Any) -> None:
        """Takes hold of a PettingZoo AECEnv; `settings` as in `Game`."""
        super().__init__(env, **settings)
        self._books = env
        self._roster: list[AgentId] = []
        self._live: set[AgentId] = set()
        self._flags: dict[
            AgentId, tuple[Any, Any]
        ] = {}  # terminated, truncated; absent: both False
        self._set = 0  # how many flags aren't False
        self._news: list[AgentId] = []  # agents with a row at the start of the turn that comes
        self._seen: Any = _NEVER  # whose observation was looked at in this turn
        self._seen_payload: Any = None
        self._seen_odd: tuple[str, ...] | None = None

    @property
    def to_move(self) -> list[AgentId]:
        """The agent whose turn it is; empty once the roster is."""
        return [self.env.agent_selection] if self.env.agents else []

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Resets the environment; every reset starts an episode."""
        given = {"seed": seed, "options": options}
        given = {name: value for name, value in given.items() if value is not None}
        if self.sink is None:
            self.env.reset(**given)
            return
        self.end_episode()
        self._begin(seed, options)
        try:
            self.env.reset(**given)
        except Exception:
            self.fail(traceback.format_exc())
            self.end_episode()
            raise
        self._books = _books(self.env)
        self._first_look()
        self._seen = _NEVER
        self._flags, self._set = {}, 0
        self._roster = list(self._books.agents)
        self._live = set(self._roster)
        self._news = list(self._roster)
        self._note_flags()

    def last(self, observe: bool = True) -> Any:
        """What the environment's own `last` returns, noted as what the agent in turn was given."""
        out = self.env.last(observe)
        if observe and self.sink is not None and self._open:
            self._look(self._books.agent_selection, out[0])
        return out

    def observe(self, agent: AgentId) -> Any:
        """What the environment's own `observe` returns; noted where the agent in turn looks."""
        out = self.env.observe(agent)
        if self.sink is not None and self._open and agent == self._books.agent_selection:
            self._look(agent, out)
        return out

    def _look(self, agent: AgentId, observation: Any) -> None:
        if self._seen_payload.__class__ is Place and self._seen is not _NEVER:
            self.sink.rings.release(self._seen_payload)  # type: ignore[union-attr]  # who puts aside has rings
        _, pack, _ = self._desk.get(agent) or self._sit(agent)
        payload = pack(observation)
        self._seen, self._seen_payload = agent, payload
        self._seen_odd = None if payload is not None else (odd("obs", observation),)

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        if self.sink is None or not self._open:
            self.env.step(action)
            return
        books = self._books
        agent = books.agent_selection
        desk = self._desk.get(agent) or self._sit(agent)
        self._give(agent, desk[0])
        payload = entry = None
        if action is not None:
            payload = desk[2](action)
            if payload is None:
                entry = (odd("action", action),)
        start = perf_counter_ns()
        try:
            self.env.step(action)
        except Exception as error:
            self._tape.done.extend((0, payload, None, None, type_name_of(type(error)), entry))
            self._commit(1, perf_counter_ns() - start)
            self.turn += 1
            self._seen = _NEVER
            self.fail(traceback.format_exc())
            raise
        wall_ns = perf_counter_ns() - start
        self._failure = None
        self._seen = _NEVER
        self._settle(agent, payload, entry, wall_ns)

    # -- rows

    def _give(self, agent: AgentId, index: int) -> None:
        """The row of the agent in turn: what it was given."""
        books = self._books
        received, terminated, truncated, info = (
            _of(books._cumulative_rewards, agent),
            _of(books.terminations, agent),
            _of(books.truncations, agent),
            _of(books.infos, agent),
        )
        payload, fields, text, mask = None, None, None, None
        if self._seen is not _NEVER and self._seen == agent:
            payload, fields = self._seen_payload, self._seen_odd
        if (
            received.__class__ not in REALS
            or terminated.__class__ not in BOOLS
            or truncated.__class__ not in BOOLS
            or (info.__class__ is not dict)
            or (received.__class__ is int and not -EXACT <= received <= EXACT)
        ):
            entries = list(fields or ())
            if reward_of(received) is None:
                entries.append(odd("received", received))
                received = None
            terminated = _flag_of(terminated, "terminated", entries)
            truncated = _flag_of(truncated, "truncated", entries)
            text, mask = self._info(info, entries)
            fields = tuple(entries) or None
        elif info:
            text, mask = self._info_text(info)
        live = agent in self._live
        self._tape.given.extend(
            (index, payload, mask, received, terminated, truncated, text, live, fields)
        )

    def _settle(self, agent: AgentId, payload: Any, entry: Any, wall_ns: int) -> None:
        """After the crossing: the reward of who acted, rows for others, the marks of the turn."""
        books = self._books
        rewards = books.rewards
        reward = rewards.get(agent)
        if reward is not None and reward.__class__ is not float and reward_of(reward) is None:
            entry, reward = (*(entry or ()), odd("reward", reward)), None
        self._tape.done.extend((0, payload, reward, self._terms_of(agent), None, entry))
        news = [other for other in self._news if other != agent] if self._news else []
        paid = _paid_others(rewards, agent) if _pays_others(rewards, reward) else []
        rows = 1 + self._other_rows(news, paid) if news or paid else 1
        self._news = []
        self._commit(rows, wall_ns)
        self._crossed()
        self._note_roster(agent, books.agents)
        self._note_flags()
        if not books.agents:
            self.end_episode()

    def _other_rows(self, news: list[AgentId], paid: list[AgentId]) -> int:
        """Rows of those who didn't act: new flags or place in the roster, what they were paid."""
        given, done = self._tape.given.extend, self._tape.done.extend
        rewards = self._books.rewards
        receives = set(paid)
        others = dict.fromkeys([*news, *paid])
        for other in others:
            index, _, _ = self._desk.get(other) or self._sit(other)
            entries: list[str] = []
            flags = self._flags.get(other, (False, False))
            terminated, truncated = (
                _flag_of(flag, field, entries)
                for flag, field in zip(flags, ("terminated", "truncated"), strict=True)
            )
            live = other in self._live
            given(
                (index, None, None, None, terminated, truncated, None, live, tuple(entries) or None)
            )
            reward = rewards.get(other) if other in receives else None
            entry = None
            if reward is not None and reward_of(reward) is None:
                entry, reward = (odd("reward", reward),), None
            done((None, None, reward, self._terms_of(other), None, entry))
        return len(others)

    def _terms_of(self, agent: AgentId) -> Any:
        return None if self._paid_terms is None else self._paid_terms(agent)

    # -- what a crossing changed

    def _note_roster(self, actor: AgentId, agents: list[AgentId]) -> None:
        """Who joined or left; the actor's leaving by its own None turn is no news."""
        before = self._roster
        if agents == before:
            return
        now, then = set(agents), self._live
        for agent in [agent for agent in before if agent not in now]:
            flags = self._flags.pop(agent, (False, False))
            self._set -= _set_flags(flags)
            if agent != actor or not any(flags):
                self._news.append(agent)
        self._news.extend(agent for agent in agents if agent not in then)
        self._roster, self._live = list(agents), now

    def _note_flags(self) -> None:
        """Whose flags aren't what they were at the start of the last turn."""
        terminations, truncations = self._books.terminations, self._books.truncations
        unset = list(terminations.values()).count(False) + list(truncations.values()).count(False)
        if unset + self._set == len(terminations) + len(truncations):
            return
        flags, news = self._flags, dict.fromkeys(self._news)
        for agent, terminated in terminations.items():
            pair = (terminated, truncations.get(agent, False))
            known = flags.get(agent, (False, False))
            if pair != known:
                news[agent] = None
                flags[agent] = pair
                self._set += _set_flags(pair) - _set_flags(known)
        self._news = list(news)

    def end_episode(self) -> None:
        """Closes the books of an episode in progress; what is news yet becomes closing rows."""
        if self.sink is None or not self._open:
            return
        agents = getattr(self._books, "agents", [])
        rows = 0
        if agents and self._seen is not _NEVER:
            agent = self._seen
            self._give(agent, (self._desk.get(agent) or self._sit(agent))[0])
            rows = 1
            self._tape.done.extend((None, None, None, None, None, None))
            self._news = [other for other in self._news if other != agent]
        rows += self._other_rows(self._news, [])
        self._news, self._seen = [], _NEVER
        self._commit(rows, None)
        over = all(any(self._flags.get(agent, ())) for agent in agents)
        self._finish("ended" if over else "cut")


def _books(env: Any) -> Any:
    """Where the books of `env` are kept: the first environment that isn't a transparent wrapper."""
    while type(env) in TRANSPARENT:
        env = env.env
    return env


def _of(book: Any, agent: AgentId) -> Any:
    try:
        return book[agent]
    except (KeyError, TypeError):
        return MISSING


def _pays_others(rewards: Mapping[AgentId, Any], reward: Any) -> bool:
    """Whether `rewards` may pay anybody but the agent whose own reward is `reward`.

    Counting one of the zeros that are in it finds the others by identity, at 1 ns each, where `any`
    asks every number for its truth.
    """
    values = list(rewards.values())
    zero = values[0] if values and values[0].__class__ in REALS and not values[0] else 0
    try:
        return len(values) - values.count(zero) != (1 if reward else 0)
    except ValueError:  # a reward that is an array has no truth
        return True


def _paid_others(rewards: Mapping[AgentId, Any], agent: AgentId) -> list[AgentId]:
    """Those that `rewards` pays, but for `agent`; what is no number counts as pay, to be seen."""
    return [
        other
        for other, reward in rewards.items()
        if other != agent and (reward.__class__ not in REALS or reward)
    ]


def _flag_of(flag: Any, field: str, entries: list[str]) -> Any:
    """`flag` if it is a bool; else None, and the value as it was goes to `entries`."""
    if flag.__class__ in BOOLS:
        return flag
    entries.append(odd(field, flag))
    return None


def _set_flags(flags: tuple[Any, Any]) -> int:
    """How many of the two flags don't equal False."""
    return 2 - flags.count(False)
