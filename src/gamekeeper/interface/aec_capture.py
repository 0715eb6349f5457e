"""The capture of an AEC environment: a turn is one agent's turn.

Rows stand only for who acted, was paid, or whose flags or place in the roster changed: 2,048 agents
don't cost 2,048 rows a turn. What a step pays stands at its own turn; what it changes in flags
and roster stands at the next turn's start, as it does in a Parallel environment.

Roster and flags are compared whole at each turn, but by functions in C: nothing here walks over all
agents in Python. Where the books are ours, they say whom a step touched: nothing is compared.
"""

from collections.abc import Mapping, Sequence
from itertools import filterfalse
from time import perf_counter_ns
from typing import Any, Final

from gamekeeper.episodes.buffer import LargePlace
from gamekeeper.episodes.exception_text import traceback_text
from gamekeeper.interface.aec_accounts import (
    Flags,
    books_of,
    entry_of,
    paid_others,
    pays_others,
    reward_in,
)
from gamekeeper.interface.capture import AgentId, Capture
from gamekeeper.interface.packing import (
    BOOLS,
    EXACT,
    REALS,
    WHOLES,
    flag_of,
    nonconforming,
    reward_of,
    type_name_of,
)

_NEVER: Final = object()
_NOTHING_DONE: Final = (None, None, None, None, None, None)


class AECCapture(Capture):
    """One live AEC environment whose calls are recorded."""

    api = "aec"

    def __init__(self, env: Any, **settings: Any) -> None:
        super().__init__(env, **settings)
        self._books = env
        self._roster: list[AgentId] = []
        self._live: set[AgentId] = set()
        self._terminated, self._truncated = Flags("terminated"), Flags("truncated")
        self._news: list[AgentId] = []  # agents with a row at the start of the turn that comes
        self._is_sure = True  # no step broke off since roster and flags were compared
        self._observer: Any = _NEVER  # agent whose observation was looked at in this turn
        self._observation: Any = None
        self._observation_fields: tuple[str, ...] | None = None
        self._stood: tuple[Any, ...] | None = None  # what was given, while the step is made

    @property
    def to_move(self) -> list[AgentId]:
        """The agent whose turn it is; empty once the roster is."""
        return [self.env.agent_selection] if self.env.agents else []

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Resets the environment; every reset starts an episode."""
        self._reset_env(seed, options)
        if self.sink is None:
            return
        self._books = books_of(self.env)
        self._first_look()
        self._observer = _NEVER
        self._terminated.clear()
        self._truncated.clear()
        self._roster = list(self._books.agents)
        self._live = set(self._roster)
        self._news = list(self._roster)
        self._note_flags()

    def last(self, observe: bool = True) -> Any:
        """Returns the environment's own `last()`, and notes it as given to the agent in turn."""
        try:
            out = self.env.last() if observe is True else self.env.last(observe)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # as in reset
            self.fail_at_last(traceback_text(error))
            raise
        if observe and self.sink is not None and self._open:
            self._note_observation(self._books.agent_selection, out[0])
        return out

    def observe(self, agent: AgentId) -> Any:
        """Returns the environment's own `observe`; noted where the agent in turn calls it."""
        try:
            out = self.env.observe(agent)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # as in reset
            self.fail_at_last(traceback_text(error))
            raise
        if self.sink is not None and self._open and agent == self._books.agent_selection:
            self._note_observation(agent, out)
        return out

    def _note_observation(self, agent: AgentId, observation: Any) -> None:
        """Notes the latest look of this turn; an earlier one is forgotten."""
        if self._half is not None:
            self._fix()
        if self._observation.__class__ is LargePlace and self._observer is not _NEVER:
            # Forgotten first: an interrupt in between may lose a place, and never frees one twice.
            self._observer = _NEVER
            self.sink.rings.release(self._observation)  # type: ignore[union-attr]  # it put it there
        _, pack, _ = self._packers.get(agent) or self._packers_of(agent)
        payload = pack(observation)
        self._observation_fields = (
            None if payload is not None else (nonconforming("obs", observation),)
        )
        self._observation, self._observer, self._stood = payload, agent, None

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        if self.sink is None or not self._open:
            self.env.step(action)
            return
        if self._half is not None:
            self._fix()
        agent = self._books.agent_selection
        index, _, pack = self._packers.get(agent) or self._packers_of(agent)
        given = self._given(agent, index)
        payload = entry = None
        if action is not None:
            payload = pack(action)
            if payload is None:
                payload, entry = self._nonconforming_action(agent, action)
        self._stood = given  # an interrupt within the step leaves books that are half changed
        start = self._started_ns = perf_counter_ns()
        try:
            self.env.step(action)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            wall_ns = perf_counter_ns() - start
            done = 0, payload, None, None, type_name_of(type(error)), entry
            self._observer, self._is_sure, self._stood = _NEVER, False, None
            self._put(agent, given, done, [], wall_ns)
            self.fail(traceback_text(error), in_step=True)
            raise
        wall_ns = perf_counter_ns() - start
        self._failure = None
        # The environment has stepped: what an interrupt keeps from being booked from here on,
        # `_fix` books before anything else is recorded.
        self._half = self.turn, agent, given, payload, entry, wall_ns
        self._observer, self._stood = _NEVER, None
        self._pay(agent, given, payload, entry, wall_ns)
        self._note(agent)
        self._half = None

    def _book(self, turn: int, *env_step: Any) -> None:
        self._observer, self._is_sure, self._stood = _NEVER, False, None
        if self.turn == turn:  # no mark was set: `cut_back` took the rows off, if there were any
            self._pay(*env_step)
        self._note(env_step[0])

    # -- rows

    def _given(self, agent: AgentId, index: int) -> tuple[Any, ...]:
        """The row of the agent in turn: what it was given."""
        books = self._books
        try:
            cumulative_reward, info = books._cumulative_rewards[agent], books.infos[agent]
            terminated, truncated = books.terminations[agent], books.truncations[agent]
        except (KeyError, TypeError):  # one of them says nothing of the agent
            cumulative_reward = entry_of(books._cumulative_rewards, agent)
            terminated = entry_of(books.terminations, agent)
            truncated = entry_of(books.truncations, agent)
            info = entry_of(books.infos, agent)
        payload, fields, text, mask = None, None, None, None
        if self._observer is not _NEVER and self._observer == agent:
            payload, fields = self._observation, self._observation_fields
        kind = cumulative_reward.__class__
        if (
            kind not in REALS
            or terminated.__class__ not in BOOLS
            or truncated.__class__ not in BOOLS
            or (info.__class__ is not dict)
            or (kind in WHOLES and not -EXACT <= cumulative_reward <= EXACT)
        ):
            entries = list(fields or ())
            if reward_of(cumulative_reward) is None:
                entries.append(nonconforming("cumulative_reward", cumulative_reward))
                cumulative_reward = None
            terminated = flag_of(terminated, "terminated", entries)
            truncated = flag_of(truncated, "truncated", entries)
            text, mask = self._info(info, entries)
            fields = tuple(entries) or None
        elif info:
            text, mask = self._info_text(info)
        live = agent in self._live
        return index, payload, mask, cumulative_reward, terminated, truncated, text, live, fields

    def _pay(
        self, agent: AgentId, given: tuple[Any, ...], payload: Any, entry: Any, wall_ns: int
    ) -> None:
        """After the step: the reward of who acted, rows for others, the turn on the buffer."""
        rewards = self._books.rewards
        reward = rewards.get(agent)
        if reward.__class__ is not float:
            reward, entry = reward_in(rewards, agent, entry)
        terms = None if self._paid_terms is None else self._paid_terms(agent)
        done = 0, payload, reward, terms, None, entry
        self._put(agent, given, done, self._paid_others(agent, rewards, reward), wall_ns)

    def _put(
        self,
        agent: AgentId,
        given: tuple[Any, ...],
        done: tuple[Any, ...],
        paid: list[AgentId],
        wall_ns: int,
    ) -> None:
        """The turn of `agent` onto the buffer: its row, and rows of who changed or was paid."""
        news = [other for other in self._news if other != agent] if self._news else []
        if news or paid:
            others, theirs = self._other_rows(news, paid)
            self._commit(
                [*given, *others], [*done, *theirs], 1 + len(others) // len(given), wall_ns
            )
        else:
            self._commit(given, done, 1, wall_ns)
        self._news = []

    def _paid_others(
        self, agent: AgentId, rewards: Mapping[AgentId, Any], reward: Any
    ) -> list[AgentId]:
        """Agents beside `agent` that the step rewarded; `reward` is that of `agent`."""
        return paid_others(rewards, agent) if pays_others(rewards, reward) else []

    def _other_rows(
        self, news: list[AgentId], paid: list[AgentId]
    ) -> tuple[Sequence[Any], Sequence[Any]]:
        """Rows of those who didn't act: new flags or place in the roster, what they were paid."""
        given: list[Any] = []
        done: list[Any] = []
        if not news and not paid:  # nor may there be any books, where the first reset raised
            return given, done
        rewards = self._books.rewards
        receives = set(paid)
        for other in dict.fromkeys([*news, *paid]):
            index, _, _ = self._packers.get(other) or self._packers_of(other)
            entries: list[str] = []
            flags = self._terminated.of(other, entries), self._truncated.of(other, entries)
            live = other in self._live
            given.extend((index, None, None, None, *flags, None, live, tuple(entries) or None))
            reward, entry = reward_in(rewards, other, None) if other in receives else (None, None)
            done.extend((None, None, reward, self._terms_of(other), None, entry))
        return given, done

    def _terms_of(self, agent: AgentId) -> Any:
        return None if self._paid_terms is None else self._paid_terms(agent)

    # -- what a step changed

    def _note(self, actor: AgentId) -> None:
        """The next turn begins: state, frame, and whose flags or place in the roster changed."""
        self._stepped()
        agents = self._books.agents
        self._note_changes(actor, agents)
        if not agents:
            self._end()

    def _note_changes(self, actor: AgentId, agents: list[AgentId]) -> None:
        if agents != self._roster:
            self._note_roster(actor, agents)
        self._note_flags()

    def _note_roster(self, actor: AgentId, agents: list[AgentId]) -> None:
        """Notes agents that joined or left; the actor's leaving by its own None turn is no news."""
        now, then = set(agents), self._live
        for agent in filterfalse(now.__contains__, self._roster):
            # `|` and not `or`: both have to drop the agent
            is_flagged = self._terminated.drop(agent) | self._truncated.drop(agent)
            if agent != actor or not is_flagged:
                self._news.append(agent)
        self._news.extend(filterfalse(then.__contains__, agents))
        self._roster, self._live = list(agents), now

    def _note_flags(self) -> None:
        """Notes agents whose flags have changed since the start of the last turn."""
        books, news = self._books, self._news
        if self._terminated.differ_from(books.terminations):
            news.extend(self._terminated.take(books.terminations))
        if self._truncated.differ_from(books.truncations):
            news.extend(self._truncated.take(books.truncations))

    def _end(self) -> None:
        agents = getattr(self._books, "agents", [])
        given: Sequence[Any] = ()
        done: Sequence[Any] = ()
        news = self._news
        if agents and self._observer is not _NEVER:
            agent = self._observer
            index, _, _ = self._packers.get(agent) or self._packers_of(agent)
            given = self._stood or self._given(agent, index)  # an interrupted step changes books
            done = _NOTHING_DONE
            news = [other for other in news if other != agent]
        others, theirs = self._other_rows(news, [])
        if not self._is_closed:
            rows = len(done) // len(_NOTHING_DONE) + len(theirs) // len(_NOTHING_DONE)
            self._commit([*given, *others], [*done, *theirs], rows, None)
        self._news, self._observer, self._stood = [], _NEVER, None
        over = all(self._terminated.has(agent) or self._truncated.has(agent) for agent in agents)
        self._finish("ended" if over else "cut")


class BookkeptCapture(AECCapture):
    """An AEC environment whose books are ours: they say whom a step touched."""

    def _paid_others(
        self, agent: AgentId, rewards: Mapping[AgentId, Any], reward: Any
    ) -> list[AgentId]:
        return [
            other for other in self._books.touched.paid if other != agent and rewards.get(other)
        ]

    def _note_changes(self, actor: AgentId, agents: list[AgentId]) -> None:
        if not self._is_sure:  # a step broke off, and the next one forgot whom that had touched
            self._is_sure, self._roster = True, list(self._live)
            super()._note_changes(actor, agents)
            return
        books, news = self._books, self._news
        touched = books.touched
        for agent in touched.left:
            self._live.discard(agent)
            is_flagged = self._terminated.drop(agent) | self._truncated.drop(agent)
            if agent != actor or not is_flagged:
                news.append(agent)
        for agent in touched.joined:
            self._live.add(agent)
            news.append(agent)
        for agent in touched.ended:
            if agent in books.terminations:
                self._terminated.put(agent, books.terminations[agent])
                self._truncated.put(agent, books.truncations[agent])
                news.append(agent)
