"""Captures of level `actions`: usual turns leave their actions and rewards, and nothing else.

A turn is usual where no agent has ended, no value is undeclared and it is no witness. Other turns
are taken down as at every level, but for observations and infos of rows that are no witnesses.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from itertools import repeat
from operator import call, is_
from typing import Any, Final

from gamekeeper.episodes.actions_level import EVERY
from gamekeeper.episodes.buffer import OBSERVED, LargePlace
from gamekeeper.episodes.exception_text import traceback_text
from gamekeeper.interface.aec_accounts import entry_of, reward_in
from gamekeeper.interface.aec_capture import _NEVER, AECCapture, BookkeptCapture
from gamekeeper.interface.capture import NO_STATE, AgentId, Capture
from gamekeeper.interface.packing import BOOLS, EXACT, FLOATS, MISSING, REALS, flag_of, type_name_of
from gamekeeper.interface.parallel_capture import NO_PARTS, Move, ParallelCapture, _five

DICTS: Final = (dict, defaultdict)  # a defaultdict is what PettingZoo's converter pays in
_UNTIMED: Final = 0  # in place of the wall time of a step, which this level doesn't keep


def _is_set(flag: Any) -> bool:
    return flag.__class__ in BOOLS and bool(flag)


def _are_usual(rewards: list[Any]) -> bool:
    """True if a float64 holds each of them exactly."""
    kinds = set(map(type, rewards))
    if kinds <= FLOATS:
        return True
    return kinds <= REALS and min(rewards) >= -EXACT and max(rewards) <= EXACT


class _Witnessed(Capture):
    """Looks at state() only where the turn that comes is a witness."""

    def _crossed(self) -> None:
        state = self._state
        if self.turn % EVERY:
            self._state, self._state_entry = None, NO_STATE
        try:
            super()._crossed()
        finally:
            self._state = state


class ParallelActionsCapture(_Witnessed, ParallelCapture):
    """One live Parallel environment, recorded at level `actions`."""

    def __init__(self, env: Any, **settings: Any) -> None:
        """Takes hold of a PettingZoo ParallelEnv; `settings` as in `Capture`."""
        super().__init__(env, **settings)
        self._is_usual = False  # the rows that wait are usual, and not written out
        self._indexes: list[int] = []

    def step(self, actions: Mapping[AgentId, Any]) -> Any:
        """One tick. Returns what the environment returned."""
        payloads: list[Any] | None = None
        is_usual = self._is_usual and self._half is None and actions.__class__ is dict
        if is_usual and list(actions) == self._who:
            payloads = list(map(call, self._doers, actions.values()))
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
        parts = _five(out) or NO_PARTS
        self._half = self.turn, payloads, parts, _UNTIMED
        self._observations, self._infos = parts[0], parts[4]
        if not self._commit_usual(payloads, parts[1]):
            self._write_out()
            self._pay(_moves_of(payloads), parts[1], _UNTIMED)
        if self._frames or not self.turn % EVERY or not self.turn % 256:
            self._crossed()
        else:
            self._state_entry = NO_STATE
        self._give(*parts)
        self._half = None
        return out

    def _commit_usual(self, payloads: list[Any], rewards: Any) -> bool:
        """Puts a usual turn on the buffer; False where a reward isn't as usual."""
        who = self._who
        if rewards.__class__ not in DICTS or list(rewards) != who:
            return False
        paid = list(rewards.values())
        if not _are_usual(paid):
            return False
        buffer, turn = self._buffer, self.turn
        usual = buffer.usual
        usual.agents.extend(self._indexes)
        usual.actions.extend(payloads)
        usual.rewards.extend(paid)
        self.turn = turn + 1
        buffer.turns.extend((self.episode, turn, -len(paid), _UNTIMED, *self._state_entry))
        return True

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
        if agents != self._who or len(self._indexes) != len(self._who):
            if agents.__class__ is not list:
                return False
            self._take_seats(list(agents))
        who = self._who
        if not list(observations) == list(terms) == list(truncs) == who:
            return False
        return all(map(is_, terms.values(), repeat(False))) and all(
            map(is_, truncs.values(), repeat(False))
        )

    def _take_seats(self, who: list[AgentId]) -> None:
        super()._take_seats(who)
        self._indexes = [index for index, _ in self._givers]

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


class _TurnsByActions(_Witnessed, AECCapture):
    """Part that both captures of an AEC environment share."""

    def step(self, action: Any) -> None:
        """One turn of the agent whose turn it is."""
        if (
            self._seen_payload is not OBSERVED
            or self._seen is _NEVER
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
            or self._seen != agent
            or agent not in self._live
            or entry_of(books.terminations, agent) is not False
            or entry_of(books.truncations, agent) is not False
        ):
            super().step(action)
            return
        try:
            self.env.step(action)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._seen, self._is_sure = _NEVER, False
            done = 0, payload, None, None, type_name_of(type(error)), None
            self._put(agent, _usual_row(index), done, [], _UNTIMED)
            self.fail(traceback_text(error), in_step=True)
            raise
        self._failure, self._seen = None, _NEVER
        self._half = self.turn, agent, _usual_row(index), payload, None, _UNTIMED
        if not self._take_usual(agent, index, payload):
            self._pay_usual(agent, index, payload)
            self._note(agent)
        self._half = None

    def _take_usual(self, agent: AgentId, index: int, payload: Any) -> bool:
        """Books a usual step in one place, where that can be told at no cost; else False."""
        return False

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
        buffer, turn = self._buffer, self.turn
        usual = buffer.usual
        usual.agents.append(index)
        usual.actions.append(payload)
        usual.rewards.append(reward)
        self.turn = turn + 1
        buffer.turns.extend((self.episode, turn, -1, _UNTIMED, *self._state_entry))

    def _crossed(self) -> None:
        if self._frames or not self.turn % EVERY or not self.turn % 256:
            super()._crossed()
        else:
            self._state_entry = NO_STATE

    def _is_witness(self, agent: AgentId) -> bool:
        """True if the row of the agent in turn is kept by its digest."""
        books = self._books
        return not self.turn % EVERY or (
            _is_set(entry_of(books.terminations, agent))
            or _is_set(entry_of(books.truncations, agent))
        )

    def _look(self, agent: AgentId, observation: Any) -> None:
        if self._half is not None:
            self._fix()
        books = self._books
        is_live = (
            entry_of(books.terminations, agent) is False
            and entry_of(books.truncations, agent) is False
        )
        if not self.turn % EVERY or (not is_live and self._is_witness(agent)):
            super()._look(agent, observation)
            return
        if self._seen_payload.__class__ is LargePlace and self._seen is not _NEVER:
            self.sink.rings.release(self._seen_payload)  # type: ignore[union-attr]  # it put it there
        self._seen_nonconforming = self._stood = None
        self._seen_payload, self._seen = OBSERVED, agent

    def _given(self, agent: AgentId, index: int) -> tuple[Any, ...]:
        if self._is_witness(agent):
            return super()._given(agent, index)
        seen = OBSERVED if self._seen is not _NEVER and self._seen == agent else None
        fields: list[str] = []
        flags = [
            flag_of(entry_of(book, agent), name, fields)
            for name, book in (
                ("terminated", self._books.terminations),
                ("truncated", self._books.truncations),
            )
        ]
        live = agent in self._live
        return index, seen, None, None, *flags, None, live, tuple(fields) or None


class AECActionsCapture(_TurnsByActions):
    """One live AEC environment, recorded at level `actions`."""


class BookkeptActionsCapture(_TurnsByActions, BookkeptCapture):
    """The same for an environment whose books are ours."""

    def _take_usual(self, agent: AgentId, index: int, payload: Any) -> bool:
        """Books a step that, as the books say, touched only the agent that acted."""
        books, turn = self._books, self.turn
        touched, coming = books.touched, turn + 1
        reward = books.rewards.get(agent)
        if (
            reward.__class__ is not float
            or touched.ended
            or touched.left
            or touched.joined
            or len(touched.paid) > (agent in touched.paid)
            or not (coming % EVERY and coming % 256 and self._is_sure and books.agents)
            or self._frames
        ):
            return False
        buffer = self._buffer
        usual = buffer.usual
        usual.agents.append(index)
        usual.actions.append(payload)
        usual.rewards.append(reward)
        self.turn = coming
        buffer.turns.extend((self.episode, turn, -1, _UNTIMED, *self._state_entry))
        self._state_entry = NO_STATE
        return True
