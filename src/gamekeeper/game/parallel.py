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
    AgentId,
    Game,
    Pack,
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
        self._givers: list[tuple[int, Pack]] = []  # seat and observation packer of each of them
        self._doers: list[Pack] = []  # action packer of each of them
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
        if out.__class__ is tuple and len(out) == 5:
            parts = out
            self.observations, self.infos = out[0], out[4]
        else:
            parts = ({},) * 5
        self._pay(moves, parts[1])
        self._commit(len(self._who), wall_ns)
        self._crossed()
        self._give(*parts)
        return out

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
        if rewards is None:
            self._give_all(agents, observations, dict.fromkeys(agents, 0.0), None, None, infos)
            return
        count = len(agents)
        if agents != self._who:
            self._take_seats(list(agents))
        if (
            not len(observations)
            == len(rewards)
            == len(terms)
            == len(truncs)
            == len(infos)
            == count
        ):
            self._give_all(agents, observations, rewards, terms, truncs, infos)
            return
        given = self._tape.given
        before = len(given)
        extend, text, mask = given.extend, None, None
        try:
            for agent, (index, pack) in zip(self._who, self._givers, strict=True):
                payload = pack(observations[agent])
                reward, info = rewards[agent], infos[agent]
                if (
                    terms[agent] is not False
                    or truncs[agent] is not False
                    or reward.__class__ is not float
                    or info.__class__ is not dict
                    or payload is None
                ):
                    break
                if info:
                    text, mask = self._info_text(info)
                else:
                    text = mask = None
                extend((index, payload, mask, reward, False, False, text, True, None))
            else:
                self._ended = not count
                if not count:
                    self.end_episode()
                return
        except KeyError:
            pass
        self._take_back(before)
        self._give_all(agents, observations, rewards, terms, truncs, infos)

    def _give_all(
        self,
        agents: list[AgentId],
        observations: Any,
        rewards: Any,
        terms: Any,
        truncs: Any,
        infos: Any,
    ) -> None:
        """The same with every look that the usual case does without."""
        who = dict.fromkeys(agents)
        for part in (observations, rewards, terms, truncs, infos):
            if isinstance(part, Mapping):
                who.update(dict.fromkeys(part))
        live = len(agents)
        self._take_seats(list(who))
        over = True
        for place, agent in enumerate(who):
            ended = self._give_row(agent, place < live, observations, rewards, terms, truncs, infos)
            over = over and (ended or place >= live)
        self._ended = over
        if not live:
            self.end_episode()

    def _take_seats(self, who: list[AgentId]) -> None:
        """The rows of the turn that comes are those of `who`."""
        desks = [self._desk.get(agent) or self._sit(agent) for agent in who]
        self._who = who
        self._givers = [(index, pack) for index, pack, _ in desks]
        self._doers = [pack for _, _, pack in desks]

    def _take_back(self, length: int) -> None:
        """Rows of a turn that began otherwise than usual are written again."""
        given = self._tape.given
        for payload in given[length + 1 :: GIVEN]:
            if payload.__class__ is Place:
                self.sink.rings.release(payload)  # type: ignore[union-attr]  # who puts aside has rings
        del given[length:]

    def _give_row(
        self,
        agent: AgentId,
        live: bool,
        observations: Any,
        rewards: Any,
        terms: Any,
        truncs: Any,
        infos: Any,
    ) -> bool:
        """One row; what isn't as declared goes to `odd`, its column stays null. Whether the agent ended."""
        index, pack, _ = self._desk[agent]
        first = terms is None
        fields: list[str] = []
        observation = _get(observations, agent)
        payload = None if observation is MISSING else pack(observation)
        if payload is None:
            fields.append(odd("obs", observation))
        received = _get(rewards, agent)
        terminated, truncated = (
            (False, False) if first else (_get(terms, agent), _get(truncs, agent))
        )
        if reward_of(received) is None:
            fields.append(odd("received", received))
            received = None
        if terminated.__class__ not in BOOLS:
            fields.append(odd("terminated", terminated))
            terminated = None
        if truncated.__class__ not in BOOLS:
            fields.append(odd("truncated", truncated))
            truncated = None
        text, mask = self._info(_get(infos, agent), fields)
        entry = (
            index,
            payload,
            mask,
            received,
            terminated,
            truncated,
            text,
            live,
            tuple(fields) or None,
        )
        self._tape.given.extend(entry)
        return bool(terminated or truncated)

    # -- rows: what was done, what that paid

    def _moves(self, actions: Any) -> list[tuple[int | None, Any, tuple[str, ...] | None]]:
        """Order, packed action and odd part for every row that waits, before the environment sees them.

        Who acts without having been given anything gets a row too.
        """
        if not isinstance(actions, Mapping):
            actions = {}
        if list(actions) != self._who:
            return self._moves_out_of_order(actions)
        moves: list[Any] = []
        for order, (pack, action) in enumerate(zip(self._doers, actions.values(), strict=True)):
            payload = pack(action)
            moves.append(
                (order, payload, None if payload is not None else (odd("action", action),))
            )
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
        self._take_seats([*self._who, agent])

    def _pay(self, moves: list[Any], rewards: Any) -> None:
        """Completes the rows of this turn with actions and what the crossing paid."""
        if rewards.__class__ is not dict:
            rewards = rewards if isinstance(rewards, Mapping) else {}
        if len(rewards) > len(moves):
            self._pay_strangers(moves, rewards)
        extend, paid_terms, terms = self._tape.done.extend, self._paid_terms, None
        for agent, (order, payload, entry) in zip(self._who, moves, strict=True):
            reward = rewards.get(agent)
            if reward.__class__ is not float and reward is not None and reward_of(reward) is None:
                entry, reward = (*(entry or ()), odd("reward", reward)), None
            if paid_terms is not None:
                terms = paid_terms(agent)
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
        self._take_seats([])
        self._finish("ended" if over or not getattr(self.env, "agents", ()) else "cut")


def _get(part: Any, agent: AgentId) -> Any:
    return part.get(agent, MISSING) if isinstance(part, Mapping) else MISSING


def _is_pair(out: Any) -> bool:
    return isinstance(out, tuple) and len(out) == 2
