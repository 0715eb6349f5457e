"""Captures of level `actions`: usual turns leave their actions and rewards, and nothing else.

A turn is usual where no agent has ended, no value is undeclared and it is no witness. Other turns
are taken down as at every level, but for observations and infos of rows that are no witnesses.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import repeat
from operator import call, is_
from typing import Any, Final

from gamekeeper.episodes.actions_level import EVERY
from gamekeeper.episodes.buffer import OBSERVED, LargePlace
from gamekeeper.episodes.exception_text import traceback_text
from gamekeeper.interface.aec_accounts import entry_of, reward_in
from gamekeeper.interface.aec_capture import _NEVER, AECCapture, BookkeptCapture
from gamekeeper.interface.capture import CHECK_TURNS, NO_STATE, AgentId, Capture
from gamekeeper.interface.packing import BOOLS, EXACT, FLOATS, MISSING, REALS, flag_of, type_name_of
from gamekeeper.interface.parallel_capture import NO_PARTS, Move, ParallelCapture, _five

DICTS: Final = (dict, defaultdict)  # a defaultdict is what PettingZoo's converter pays in
_UNTIMED: Final = 0  # in place of the wall time of a step, which this level doesn't keep
_UNTIMED_TURN: Final = (_UNTIMED, None, None)


def _is_set(flag: Any) -> bool:
    return flag.__class__ in BOOLS and bool(flag)


def _are_usual(rewards: list[Any]) -> bool:
    """True if a float64 holds each of them exactly."""
    kinds = set(map(type, rewards))
    if kinds <= FLOATS:
        return True
    return kinds <= REALS and min(rewards) >= -EXACT and max(rewards) <= EXACT


class _Witnessed(Capture):
    """Part that both forms share: most turns aren't looked at beyond what was done and paid.

    `_quiet_below` is the turn at which state, frames or the sink are to be looked at next; the
    turns below it are *quiet*, once a capture has seen that nothing else is to be noted either.
    """

    _quiet_below = 0

    def _begin(self, seed: int | None, options: Mapping[str, Any] | None) -> None:
        self._quiet_below = 0
        super()._begin(seed, options)

    def _stepped(self) -> None:
        """After a step: looks at state() only where the turn that comes is a witness."""
        turn, state = self.turn, self._state
        stops = turn - turn % EVERY + EVERY, turn - turn % CHECK_TURNS + CHECK_TURNS
        self._quiet_below = 0 if self._frames else min(stops)
        if turn % EVERY:
            self._state, self._state_entry = None, NO_STATE
        try:
            if self._frames or not turn % EVERY or not turn % CHECK_TURNS:
                super()._stepped()
        finally:
            self._state = state

    def _commit_usual(
        self, indexes: Sequence[int], payloads: Sequence[Any], paid: Sequence[Any]
    ) -> None:
        """Puts a usual turn on the buffer, its mark last."""
        buffer, turn = self._buffer, self.turn
        usual = buffer.usual
        usual.agents.extend(indexes)
        usual.actions.extend(payloads)
        usual.rewards.extend(paid)
        self.turn = turn + 1
        buffer.turns.extend((self.episode, turn, -len(paid), *_UNTIMED_TURN, *self._state_entry))
        self._state_entry = NO_STATE


class ParallelActionsCapture(_Witnessed, ParallelCapture):
    """One live Parallel environment, recorded at level `actions`."""

    def __init__(self, env: Any, **settings: Any) -> None:
        super().__init__(env, **settings)
        self._is_usual = False  # the rows that wait are usual, and not written out
        self._indexes: list[int] = []

    def step(self, actions: Mapping[AgentId, Any]) -> Any:
        """One tick. Returns what the environment returned."""
        payloads: list[Any] | None = None
        is_usual = self._is_usual and self._half is None and actions.__class__ is dict
        if is_usual and list(actions) == self._row_agents:
            payloads = list(map(call, self._action_packers, actions.values()))
        if payloads is None or None in payloads:
            self._write_out()
            return super().step(actions)
        try:
            out = self.env.step(actions)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._write_out()
            self._raised(_moves_of(payloads), type_name_of(type(error)), _UNTIMED)
            self.fail(traceback_text(error), in_step=True)
            raise
        self._failure = None
        parts = out if out.__class__ is tuple and len(out) == 5 else _five(out) or NO_PARTS
        self._half = self.turn, payloads, parts, _UNTIMED
        observations, rewards, terms, truncs, infos = parts
        self._observations, self._infos = observations, infos
        # One walk over the agents looks at all that there is to look at, and in place, as this is
        # what most ticks cost. Of the rows that wait, those of the last tick, none is written anew.
        who, paid = self._row_agents, list[Any]()
        if (
            self.turn + 1 < self._quiet_below
            and getattr(self.env, "agents", None) == who
            and observations.__class__ is terms.__class__ is truncs.__class__ is dict
            and rewards.__class__ in DICTS
            and len(observations) == len(rewards) == len(terms) == len(truncs) == len(who)
        ):
            reward_of = rewards.get  # to look into a defaultdict would add to it
            try:
                for agent in who:
                    reward = reward_of(agent)
                    if (
                        terms[agent] is not False
                        or truncs[agent] is not False
                        or (reward.__class__ is not float and reward.__class__ not in FLOATS)
                        or agent not in observations
                    ):
                        break
                    paid.append(reward)
            except KeyError:
                pass
        if len(paid) == len(who):
            self._commit_usual(self._indexes, payloads, paid)
        else:
            self._pass_over(payloads, parts)
        self._half = None
        return out

    def _pass_over(self, payloads: list[Any], parts: tuple[Any, ...]) -> None:
        """Books a tick whose actions were usual, and begins the rows of whatever follows."""
        rewards = parts[1]
        paid = list(rewards.values()) if rewards.__class__ in DICTS else []
        if paid and list(rewards) == self._row_agents and _are_usual(paid):
            self._commit_usual(self._indexes, payloads, paid)
        else:
            self._write_out()
            self._pay(_moves_of(payloads), rewards, _UNTIMED)
        self._stepped()
        self._give(*parts)

    def _book(self, turn: int, *env_step: Any) -> None:
        moves, *rest = env_step
        if self._is_usual:
            self._write_out()
            moves = _moves_of(moves)
        super()._book(turn, moves, *rest)

    def _give(self, observations: Any, rewards: Any, terms: Any, truncs: Any, infos: Any) -> None:
        agents = getattr(self.env, "agents", None)
        self._is_usual = False
        if rewards is None or not agents or not self.turn % EVERY:
            super()._give(observations, rewards, terms, truncs, infos)
        elif self._gives_usual(agents, observations, rewards, terms, truncs):
            self._waiting, self._ended, self._is_usual = [], False, True
        else:
            self._waiting = []
            self._give_all(agents, observations, rewards, terms, truncs, infos)

    def _gives_usual(
        self, agents: Any, observations: Any, rewards: Any, terms: Any, truncs: Any
    ) -> bool:
        """True if exactly the live agents are named everywhere, and none of them has ended."""
        kinds = observations.__class__, terms.__class__, truncs.__class__
        if kinds != (dict, dict, dict) or rewards.__class__ not in DICTS:
            return False
        if agents != self._row_agents or len(self._indexes) != len(self._row_agents):
            if agents.__class__ is not list:
                return False
            self._take_agents(list(agents))
        who = self._row_agents
        if not list(observations) == list(terms) == list(truncs) == who:
            return False
        return all(map(is_, terms.values(), repeat(False))) and all(
            map(is_, truncs.values(), repeat(False))
        )

    def _take_agents(self, who: list[AgentId]) -> None:
        super()._take_agents(who)
        self._indexes = [index for index, _ in self._observation_packers]

    def _add_row(self, agent: AgentId, *, live: bool) -> None:
        super()._add_row(agent, live=live)
        self._indexes = []

    def _write_out(self) -> None:
        """The usual rows that wait become rows like others."""
        if self._is_usual:
            self._is_usual = False
            self._waiting = []
            for index in self._indexes:
                self._waiting.extend(_usual_row(index))

    def _give_row(
        self,
        agent: AgentId,
        live: bool,
        observation: Any,
        cumulative_reward: Any,
        terminated: Any,
        truncated: Any,
        info: Any,
    ) -> bool:
        if not self.turn % EVERY or _is_set(terminated) or _is_set(truncated):
            given = observation, cumulative_reward, terminated, truncated, info
            return super()._give_row(agent, live, *given)
        index, fields = self._packers[agent][0], list[str]()
        flags = flag_of(terminated, "terminated", fields), flag_of(truncated, "truncated", fields)
        seen = None if observation is MISSING else OBSERVED
        self._waiting.extend((index, seen, None, None, *flags, None, live, tuple(fields) or None))
        return False

    def _end(self) -> None:
        self._write_out()
        super()._end()


def _moves_of(payloads: list[Any]) -> list[Move]:
    return list(zip(range(len(payloads)), payloads, repeat(None)))


def _usual_row(index: int) -> tuple[Any, ...]:
    """The row of a live agent at a usual turn, as far as it was given something."""
    return index, OBSERVED, None, None, False, False, None, True, None


class AECActionsCapture(_Witnessed, AECCapture):
    """One live AEC environment, recorded at level `actions`."""

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        if (
            self._observation is not OBSERVED
            or self._observer is _NEVER
            or action is None
            or self._news
            or self._half is not None
            or not self._open
        ):
            super().step(action)
            return
        books = self._books
        agent = books.agent_selection
        index, _, pack = self._packers.get(agent) or self._packers_of(agent)
        payload = pack(action)
        if (
            payload is None
            or self._observer != agent
            or agent not in self._live
            or entry_of(books.terminations, agent) is not False
            or entry_of(books.truncations, agent) is not False
        ):
            super().step(action)
            return
        self._step_usual(agent, index, payload, action)
        self._pay_usual(agent, index, payload)
        self._note(agent)
        self._half = None

    def _pay_usual(self, agent: AgentId, index: int, payload: Any) -> None:
        """After a usual step: its turn onto the buffer."""
        rewards = self._books.rewards
        reward = rewards.get(agent)
        paid = self._paid_others(agent, rewards, reward)
        if paid or (reward.__class__ is not float and not _are_usual([reward])):
            entry = None
            if reward.__class__ is not float:
                reward, entry = reward_in(rewards, agent, None)
            done = 0, payload, reward, self._terms_of(agent), None, entry
            self._put(agent, _usual_row(index), done, paid, _UNTIMED)
            return
        self._commit_usual((index,), (payload,), (reward,))

    def _step_usual(self, agent: AgentId, index: int, payload: Any, action: Any) -> None:
        """Steps the environment; its turn is booked by `_book` where nobody else comes to it."""
        try:
            self.env.step(action)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._quiet_below, self._observer, self._is_sure = 0, _NEVER, False
            done = 0, payload, None, None, type_name_of(type(error)), None
            self._put(agent, _usual_row(index), done, [], _UNTIMED)
            self.fail(traceback_text(error), in_step=True)
            raise
        self._failure, self._observer = None, _NEVER
        self._half = self.turn, agent, None, payload, None, _UNTIMED

    def _book(self, turn: int, *env_step: Any) -> None:
        agent, given, *rest = env_step
        if given is None:  # the step was a usual one
            given = _usual_row(self._packers[agent][0])
        super()._book(turn, agent, given, *rest)

    def _is_witness(self, agent: AgentId) -> bool:
        """True if the row of the agent in turn is kept by its digest."""
        books = self._books
        return not self.turn % EVERY or (
            _is_set(entry_of(books.terminations, agent))
            or _is_set(entry_of(books.truncations, agent))
        )

    def _note_observation(self, agent: AgentId, observation: Any) -> None:
        if self._half is not None:
            self._fix()
        books = self._books
        is_live = (
            entry_of(books.terminations, agent) is False
            and entry_of(books.truncations, agent) is False
        )
        if not self.turn % EVERY or (not is_live and self._is_witness(agent)):
            super()._note_observation(agent, observation)
            return
        if self._observation.__class__ is LargePlace and self._observer is not _NEVER:
            self.sink.rings.release(self._observation)  # type: ignore[union-attr]  # it put it there
        self._observation_fields = self._stood = None
        self._observation, self._observer = OBSERVED, agent

    def _given(self, agent: AgentId, index: int) -> tuple[Any, ...]:
        if self._is_witness(agent):
            return super()._given(agent, index)
        seen = OBSERVED if self._observer is not _NEVER and self._observer == agent else None
        books, fields = self._books, list[str]()
        terminated = flag_of(entry_of(books.terminations, agent), "terminated", fields)
        truncated = flag_of(entry_of(books.truncations, agent), "truncated", fields)
        live = agent in self._live
        return index, seen, None, None, terminated, truncated, None, live, tuple(fields) or None


class BookkeptActionsCapture(AECActionsCapture, BookkeptCapture):
    """The same for an environment whose books are ours: they say whom a step touched.

    While `turn < _quiet_below` nothing waits to be noted, and `_seen` is the agent in turn once it
    has looked and hasn't ended. Then nothing is asked before a step, and after it only whom the
    step touched.
    """

    def _note_observation(self, agent: AgentId, observation: Any) -> None:
        books = self._books
        if (
            self.turn < self._quiet_below
            and self._half is None
            and books.terminations.get(agent) is False
            and books.truncations.get(agent) is False
        ):
            self._observer = agent
        else:
            self._quiet_below = 0
            super()._note_observation(agent, observation)

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        agent, books = self._observer, self._books
        packers = self._packers.get(agent)  # None where nobody has looked: `_NEVER` has none
        if packers is None or self.turn >= self._quiet_below or agent != books.agent_selection:
            self._step_any(action)
            return
        index, _, pack = packers
        payload = pack(action)
        if payload is None:
            self._step_any(action)
            return
        self._step_usual(agent, index, payload, action)
        touched, coming = books.touched, self.turn + 1
        reward, paid = books.rewards.get(agent), touched.paid
        if (
            coming >= self._quiet_below
            or reward.__class__ is not float
            or touched.ended
            or touched.left
            or touched.joined
            or (paid and (len(paid) > 1 or agent not in paid))
        ):
            self._pay_usual(agent, index, payload)
            self._note(agent)
            self._settle()
        else:
            self._commit_usual((index,), (payload,), (reward,))
        self._half = None

    def _step_any(self, action: Any) -> None:
        self._quiet_below = 0
        super().step(action)
        self._settle()

    def _settle(self) -> None:
        """Leaves `_quiet_below` as it was set after the step where the turn that comes is quiet."""
        if self._open and self._is_sure and not self._news and self.turn % EVERY:
            self._observation, self._observation_fields, self._stood = OBSERVED, None, None
        else:
            self._quiet_below = 0

    def _book(self, turn: int, *env_step: Any) -> None:
        self._quiet_below = 0
        super()._book(turn, *env_step)
        self._quiet_below = 0
