"""The door to a Parallel environment: a turn is a tick, a row for every live agent."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from time import perf_counter_ns
from typing import Any

from gamekeeper.core.tape import GIVEN, Place
from gamekeeper.game.door import (
    BOOLS,
    GIVEN_NOTHING,
    MISSING,
    REALS,
    AgentId,
    Game,
    info_of,
    odd,
    reward_of,
    type_name_of,
)


class ParallelGame(Game):
    """One live Parallel environment behind the door."""

    api = "parallel"

    def __init__(self, env: Any, **settings: Any) -> None:
        """Takes hold of a PettingZoo ParallelEnv; `settings` as in `Game`."""
        super().__init__(env, **settings)
        self._who: list[AgentId] = []  # the agents of the rows that wait for an action
        self._ended = False
        self.observations: Mapping[AgentId, Any] = {}
        self.infos: Mapping[AgentId, Any] = {}

    @property
    def to_move(self) -> list[AgentId]:
        """The agents that act next; empty once the episode is over."""
        return [] if self._ended else list(self.env.agents)

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> Any:
        """Resets the environment; every reset starts an episode. Returns what the environment returned."""
        given = {"seed": seed, "options": options}
        given = {name: value for name, value in given.items() if value is not None}
        if self.sink is None:
            return self._note(self.env.reset(**given))
        self.end_episode()
        self._begin(seed, options)
        try:
            out = self.env.reset(**given)
        except Exception:
            self.fail(traceback.format_exc())
            self.end_episode()
            raise
        observations, infos = self._note(out) if _is_pair(out) else ({}, {})
        self._first_look()
        self._give(observations, None, None, None, infos)
        return out

    def _note(self, out: Any) -> Any:
        self.observations, self.infos = out
        self._ended = False
        return out

    def step(self, actions: Mapping[AgentId, Any]) -> Any:
        """One tick. Returns what the environment returned."""
        if self.sink is None or not self._open:
            return self._after(self.env.step(actions))
        moves = self._moves(actions)
        start = perf_counter_ns()
        try:
            out = self.env.step(actions)
        except Exception as error:
            self._raised(moves, type_name_of(type(error)), perf_counter_ns() - start)
            self.fail(traceback.format_exc())
            raise
        wall_ns = perf_counter_ns() - start
        self._failure = None
        parts = out if out.__class__ is tuple and len(out) == 5 else ({},) * 5
        self._pay(moves, parts[1])
        self._commit(len(self._who), wall_ns)
        self._crossed()
        self._give(*parts)
        return self._after(out)

    def _after(self, out: Any) -> Any:
        if out.__class__ is tuple and len(out) == 5:
            self.observations, _, terminations, truncations, self.infos = out
            if not self.env.agents:
                self._ended = True
            elif self.sink is None:
                self._ended = all(
                    terminations.get(agent) or truncations.get(agent) for agent in self.env.agents
                )
        return out

    # -- rows: what was given

    def _give(self, observations: Any, rewards: Any, terms: Any, truncs: Any, infos: Any) -> None:
        """Begins the rows of the next turn with what each agent was given."""
        agents = getattr(self.env, "agents", [])
        first = rewards is None
        who = self._who_was_given(agents, (observations, infos) if first else (observations, rewards, terms, truncs, infos))
        live = len(agents)
        desk, extend = self._desk, self._tape.given.extend
        over = True
        reward: Any = 0.0
        terminated: Any = False
        truncated: Any = False
        for place, agent in enumerate(who):
            index, pack, _ = desk.get(agent) or self._sit(agent)
            try:
                payload = pack(observations[agent])
                info = infos[agent]
                if not first:
                    reward, terminated, truncated = rewards[agent], terms[agent], truncs[agent]
            except (KeyError, TypeError, IndexError):
                payload = None
            if (
                payload is None
                or reward.__class__ not in REALS
                or terminated.__class__ not in BOOLS
                or truncated.__class__ not in BOOLS
                or (info.__class__ is not dict)
                or (reward.__class__ is not float and reward_of(reward) is None)
            ):
                ended = self._give_odd(agent, place < live, observations, rewards, terms, truncs, infos)
            elif info:
                text, mask = info_of(info, [])
                extend((index, payload, mask, reward, terminated, truncated, text, place < live, None))
                ended = terminated or truncated
            else:
                extend((index, payload, None, reward, terminated, truncated, None, place < live, None))
                ended = terminated or truncated
            over = over and (ended or place >= live)
        self._who, self._ended = who, over
        if not live:
            self.end_episode()

    def _who_was_given(self, agents: list[AgentId], parts: tuple[Any, ...]) -> list[AgentId]:
        """The live agents, then those that are in one of the dictionaries only."""
        count = len(agents)
        if all(part.__class__ is dict and len(part) == count for part in parts):
            first = parts[0]
            if all(agent in first for agent in agents):
                keys = first.keys()
                if all(part.keys() == keys for part in parts[1:]):
                    return list(agents)
        who = dict.fromkeys(agents)
        for part in parts:
            if isinstance(part, Mapping):
                who.update(dict.fromkeys(part))
        return list(who)

    def _give_odd(
        self, agent: AgentId, live: bool, observations: Any, rewards: Any, terms: Any, truncs: Any, infos: Any
    ) -> bool:
        """A row of which something isn't as declared: that goes to `odd`, its column stays null."""
        index, pack, _ = self._desk[agent]
        first = rewards is None
        fields: list[str] = []
        observation = _get(observations, agent)
        payload = None if observation is MISSING else pack(observation)
        if payload is None:
            fields.append(odd("obs", observation))
        received = 0.0 if first else _get(rewards, agent)
        terminated, truncated = (False, False) if first else (_get(terms, agent), _get(truncs, agent))
        if reward_of(received) is None:
            fields.append(odd("received", received))
            received = None
        if terminated.__class__ not in BOOLS:
            fields.append(odd("terminated", terminated))
            terminated = None
        if truncated.__class__ not in BOOLS:
            fields.append(odd("truncated", truncated))
            truncated = None
        text, mask = info_of(_get(infos, agent), fields)
        entry = (index, payload, mask, received, terminated, truncated, text, live, tuple(fields) or None)
        self._tape.given.extend(entry)
        return bool(terminated or truncated)

    # -- rows: what was done, what that paid

    def _moves(self, actions: Any) -> list[tuple[int | None, Any, tuple[str, ...] | None]]:
        """Order, packed action and odd part for every row that waits, before the environment sees them.

        Who acts without having been given anything gets a row too.
        """
        who, desk = self._who, self._desk
        if not isinstance(actions, Mapping):
            who, actions = list(who), {}
        if list(actions) != who:
            return self._moves_out_of_order(actions)
        moves = []
        for order, agent in enumerate(who):
            action = actions[agent]
            payload = desk[agent][2](action)
            entry = None if payload is not None else (odd("action", action),)
            moves.append((order, payload, entry))
        return moves

    def _moves_out_of_order(
        self, actions: Mapping[AgentId, Any]
    ) -> list[tuple[int | None, Any, tuple[str, ...] | None]]:
        order = {agent: place for place, agent in enumerate(actions)}
        for agent in actions:
            if agent not in self._who:
                self._add_row(agent)
        moves: list[tuple[int | None, Any, tuple[str, ...] | None]] = []
        for agent in self._who:
            if agent not in order:
                moves.append((None, None, None))
                continue
            payload = self._desk[agent][2](actions[agent])
            entry = None if payload is not None else (odd("action", actions[agent]),)
            moves.append((order[agent], payload, entry))
        return moves

    def _add_row(self, agent: AgentId) -> None:
        index, _, _ = self._desk.get(agent) or self._sit(agent)
        live = agent in getattr(self.env, "agents", ())
        self._tape.given.extend((index, *GIVEN_NOTHING, live, None))
        self._who.append(agent)

    def _pay(self, moves: list[Any], rewards: Any) -> None:
        """Completes the rows of this turn with actions and what the crossing paid."""
        if rewards.__class__ is not dict:
            rewards = rewards if isinstance(rewards, Mapping) else {}
        if len(rewards) > len(moves):
            self._pay_strangers(moves, rewards)
        extend = self._tape.done.extend
        paid_terms = self._paid_terms
        for agent, (order, payload, entry) in zip(self._who, moves, strict=True):
            reward = rewards.get(agent)
            if reward.__class__ is not float and reward is not None and reward_of(reward) is None:
                entry = (*(entry or ()), odd("reward", reward))
                reward = None
            terms = None if paid_terms is None else paid_terms(agent)
            extend((order, payload, reward, terms, None, entry))

    def _pay_strangers(self, moves: list[Any], rewards: Mapping[AgentId, Any]) -> None:
        """Rows for agents that were paid without having been given anything at this turn."""
        for agent, reward in rewards.items():
            if agent not in self._who and reward_of(reward) != 0.0:
                self._add_row(agent)
                moves.append((None, None, None))

    def _raised(self, moves: list[Any], error: str, wall_ns: int) -> None:
        """The tick raised: its rows say so, and the same decision stands again at the next turn."""
        count = len(self._who)
        given = self._tape.given
        again = given[len(given) - count * GIVEN :]
        for order, payload, entry in moves:
            self._tape.done.extend((order, payload, None, None, error, entry))
        self._commit(count, wall_ns)
        self.turn += 1
        again[1::GIVEN] = [None if item.__class__ is Place else item for item in again[1::GIVEN]]
        given.extend(again)

    def end_episode(self) -> None:
        """Closes the books of an episode in progress; the last given values become closing rows."""
        if self.sink is None or not self._open:
            return
        for _ in self._who:
            self._tape.done.extend((None, None, None, None, None, None))
        self._commit(len(self._who), None)
        over = self._ended and bool(self._who)
        self._who = []
        self._finish("ended" if over or not getattr(self.env, "agents", ()) else "cut")


def _get(part: Any, agent: AgentId) -> Any:
    return part.get(agent, MISSING) if isinstance(part, Mapping) else MISSING


def _is_pair(out: Any) -> bool:
    return isinstance(out, tuple) and len(out) == 2
