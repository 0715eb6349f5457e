"""The capture of a Parallel environment: a turn is a tick, a row for every live agent."""

from collections import defaultdict
from collections.abc import Mapping
from itertools import repeat
from operator import call
from time import perf_counter_ns
from typing import Any, Final

from gamekeeper.episodes.buffer import GIVEN, LargePlace
from gamekeeper.episodes.exception_text import traceback_text
from gamekeeper.interface.capture import AgentId, Capture, Pack
from gamekeeper.interface.packing import (
    FLOATS,
    MISSING,
    flag_of,
    nonconforming,
    reward_of,
    type_name_of,
)

Move = tuple[int | None, Any, tuple[str, ...] | None]  # order, packed action, odd
NO_MOVE: Final[Move] = (None, None, None)
NOTHING_GIVEN: Final = (None, None, None, None, None, None)  # observation, mask, ..., info
NOTHING_DONE: Final = (None, None, None, None, None, None)
NO_PARTS: Final[tuple[Any, ...]] = ({}, {}, {}, {}, {})
BOOL: Final = frozenset({bool})


class ParallelCapture(Capture):
    """One live Parallel environment whose calls are recorded."""

    api = "parallel"

    def __init__(self, env: Any, **settings: Any) -> None:
        super().__init__(env, **settings)
        self._row_agents: list[AgentId] = []  # the agents of the rows that wait for an action
        # of each of them its index and observation packer, and its action packer
        self._observation_packers: list[tuple[int, Pack]] = []
        self._action_packers: list[Pack] = []
        self._waiting: list[Any] = []  # those rows: what was given
        self._ended = False
        self._observations: Any = {}
        self._infos: Any = {}

    @property
    def to_move(self) -> list[AgentId]:
        """The agents that act next; empty once the episode is over."""
        return [] if self._ended else list(self.env.agents)

    @property
    def observations(self) -> Mapping[AgentId, Any]:
        """Observations of the last reset or step; empty where that gave no dictionary."""
        return self._observations if isinstance(self._observations, Mapping) else {}

    @property
    def infos(self) -> Mapping[AgentId, Any]:
        """The infos of reset or step, likewise."""
        return self._infos if isinstance(self._infos, Mapping) else {}

    def reset(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> Any:
        """Resets the environment, which starts an episode; returns what the environment did."""
        out = self._reset_env(seed, options)
        is_pair = isinstance(out, tuple | list) and len(out) == 2
        self._observations, self._infos = out if is_pair else ({}, {})
        self._ended = False
        if self.sink is not None:
            self._first_look()
            self._give(self._observations, None, None, None, self._infos)
        return out

    def step(self, actions: Mapping[AgentId, Any]) -> Any:
        """One tick. Returns what the environment returned."""
        if self.sink is None or not self._open:
            return self._after(self.env.step(actions))
        if self._half is not None:
            self._fix()
        moves = self._moves(actions)
        start = self._started_ns = perf_counter_ns()
        try:
            out = self.env.step(actions)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._raised(moves, type_name_of(type(error)), perf_counter_ns() - start)
            self.fail(traceback_text(error), in_step=True)
            raise
        wall_ns = perf_counter_ns() - start
        self._failure = None
        parts = _five(out) or NO_PARTS
        self._half = self.turn, moves, parts, wall_ns
        self._observations, self._infos = parts[0], parts[4]
        self._pay(moves, parts[1], wall_ns)
        self._stepped()
        self._give(*parts)
        self._half = None
        return out

    def _book(self, turn: int, *env_step: Any) -> None:
        moves, parts, wall_ns = env_step
        if self.turn == turn:
            # The interrupt may have come between a stranger's row and its name in `_who`.
            del self._waiting[len(self._row_agents) * GIVEN :]
            self._pay(
                [*moves, *[NO_MOVE] * (len(self._row_agents) - len(moves))], parts[1], wall_ns
            )
        self._take_agents(self._row_agents)
        self._stepped()
        self._give(*parts)

    def _after(self, out: Any) -> Any:
        """Notes what a step gave that nobody records."""
        parts = _five(out)
        if parts is not None:
            self._observations, _, terms, truncs, self._infos = parts
            agents = getattr(self.env, "agents", ())
            self._ended = not agents or (self.sink is None and _all_ended(agents, terms, truncs))
        return out

    # -- rows: what was given

    def _give(self, observations: Any, rewards: Any, terms: Any, truncs: Any, infos: Any) -> None:
        """Begins the rows of the next turn with what each agent was given."""
        agents = getattr(self.env, "agents", None) or []
        waiting: list[Any] = []
        self._waiting = waiting
        count = len(agents)
        if rewards is None:  # reset pays nothing and ends nobody
            names = _named(agents, observations, infos)
            rewards = dict.fromkeys(names, 0.0)
            terms = truncs = dict.fromkeys(names, False)
        elif rewards.__class__ is defaultdict:  # as PettingZoo converts; a look would add to it
            rewards = dict(rewards)
        rows = count or len(self._row_agents)  # where all have ended, those who acted see it
        # The usual case costs one pass: plain dictionaries with exactly the agents that have rows.
        if (
            observations.__class__
            is rewards.__class__
            is terms.__class__
            is truncs.__class__
            is infos.__class__
            is dict
        ) and len(observations) == len(rewards) == len(terms) == len(truncs) == len(infos) == rows:
            if count and agents != self._row_agents:
                self._take_agents(list(agents))
            parts = observations, rewards, terms, truncs, infos
            is_usual = count > 0 or list(observations) == self._row_agents
            if is_usual and self._give_usual(waiting.extend, count > 0, *parts):
                self._ended = not count
                if not count:
                    self._end()
                return
            self._take_back(waiting)
        self._give_all(agents, observations, rewards, terms, truncs, infos)

    def _give_usual(
        self,
        extend: Any,
        live: bool,
        observations: Any,
        rewards: Any,
        terms: Any,
        truncs: Any,
        infos: Any,
    ) -> bool:
        """Rows of agents that all live on, or none, as declared; whether it was so."""
        try:
            for agent, (index, pack) in zip(
                self._row_agents, self._observation_packers, strict=True
            ):
                payload = pack(observations[agent])
                reward, info = rewards[agent], infos[agent]
                terminated, truncated = terms[agent], truncs[agent]
                # A live agent's flags are False itself; in the last rows any two booleans will do.
                if (
                    (
                        (terminated is not False or truncated is not False)
                        and (live or {terminated.__class__, truncated.__class__} != BOOL)
                    )
                    or (reward.__class__ is not float and reward.__class__ not in FLOATS)
                    or info.__class__ is not dict
                    or payload is None
                ):
                    if payload.__class__ is LargePlace:
                        self.sink.rings.release(payload)  # type: ignore[union-attr]
                    return False
                text, mask = self._info_text(info) if info else (None, None)
                extend((index, payload, mask, reward, terminated, truncated, text, live, None))
        except KeyError:
            return False
        return True

    def _give_all(
        self, agents: Any, observations: Any, rewards: Any, terms: Any, truncs: Any, infos: Any
    ) -> None:
        """The same with every look that the usual case does without."""
        parts = [
            part if isinstance(part, Mapping) else {}
            for part in (observations, rewards, terms, truncs, infos)
        ]
        who = dict.fromkeys(agents)
        live = len(who)
        for part in parts:
            who.update(dict.fromkeys(part))
        self._take_agents(list(who))
        over = True
        for place, agent in enumerate(who):
            given = [part.get(agent, MISSING) for part in parts]
            ended = self._give_row(agent, place < live, *given)
            over = over and (ended or place >= live)
        self._ended = over
        if not live:
            self._end()

    def _take_agents(self, who: list[AgentId]) -> None:
        """The rows of the turn that comes are those of `who`."""
        packers = [self._packers.get(agent) or self._packers_of(agent) for agent in who]
        self._row_agents = who
        self._observation_packers = [(index, pack) for index, pack, _ in packers]
        self._action_packers = [pack for _, _, pack in packers]

    def _take_back(self, waiting: list[Any]) -> None:
        """Rows of a turn that began otherwise than usual are written again."""
        for payload in waiting[1::GIVEN]:
            if payload.__class__ is LargePlace:
                self.sink.rings.release(payload)  # type: ignore[union-attr]  # who puts aside has rings
        waiting.clear()

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
        """Adds a row, undeclared values in `nonconforming`; True if the agent ended."""
        index, pack, _ = self._packers[agent]
        fields: list[str] = []
        payload = None if observation is MISSING else pack(observation)
        if payload is None:
            fields.append(nonconforming("obs", observation))
        if reward_of(cumulative_reward) is None:
            fields.append(nonconforming("cumulative_reward", cumulative_reward))
            cumulative_reward = None
        terminated = flag_of(terminated, "terminated", fields)
        truncated = flag_of(truncated, "truncated", fields)
        text, mask = self._info(info, fields)
        row = index, payload, mask, cumulative_reward, terminated, truncated, text, live
        self._waiting.extend((*row, tuple(fields) or None))
        return bool(terminated or truncated)

    # -- rows: what was done, what that paid

    def _moves(self, actions: Any) -> list[Move]:
        """Order, packed action and nonconforming part for every row that waits, before the step.

        Who acts without having been given anything gets a row too.
        """
        if actions.__class__ is not dict and not isinstance(actions, Mapping):
            actions = {}
        if list(actions) != self._row_agents:
            return self._moves_out_of_order(actions)
        payloads = list(map(call, self._action_packers, actions.values()))
        if None not in payloads:
            return list(zip(range(len(payloads)), payloads, repeat(None)))  # the third is endless
        moves: list[Move] = []
        for order, (payload, action) in enumerate(zip(payloads, actions.values(), strict=True)):
            entry = None
            if payload is None:
                payload, entry = self._nonconforming_action(self._row_agents[order], action)
            moves.append((order, payload, entry))
        return moves

    def _moves_out_of_order(self, actions: Mapping[AgentId, Any]) -> list[Move]:
        order = {agent: place for place, agent in enumerate(actions)}
        known = set(self._row_agents)
        live = getattr(self.env, "agents", ())
        for agent in actions:
            if agent not in known:
                self._add_row(agent, live=agent in live)
        moves: list[Move] = []
        for agent in self._row_agents:
            if agent not in order:
                moves.append(NO_MOVE)
                continue
            payload, entry = self._packers[agent][2](actions[agent]), None
            if payload is None:
                payload, entry = self._nonconforming_action(agent, actions[agent])
            moves.append((order[agent], payload, entry))
        return moves

    def _add_row(self, agent: AgentId, *, live: bool) -> None:
        """A row of an agent that was given nothing at this turn."""
        index, observe, act = self._packers.get(agent) or self._packers_of(agent)
        self._waiting.extend((index, *NOTHING_GIVEN, live, None))
        # a list of its own: the caller may be walking over the old
        self._row_agents = [*self._row_agents, agent]
        self._observation_packers.append((index, observe))
        self._action_packers.append(act)

    def _pay(self, moves: list[Move], rewards: Any, wall_ns: int) -> None:
        """Completes the rows of this turn with actions and what the step paid."""
        if rewards.__class__ is not dict and not isinstance(rewards, Mapping):
            rewards = {}
        done: list[Any] = []
        # Every agent with a row counts `strangers` down; the rest was paid without having one.
        extend, paid_terms, terms, strangers = done.extend, self._paid_terms, None, len(rewards)
        for agent, (order, payload, entry) in zip(self._row_agents, moves, strict=True):
            reward = rewards.get(agent, MISSING)
            if reward is MISSING:
                reward = None
            else:
                strangers -= 1
                if reward.__class__ is not float and reward_of(reward) is None:
                    entry, reward = (*(entry or ()), nonconforming("reward", reward)), None
            if paid_terms is not None:
                terms = paid_terms(agent)
            extend((order, payload, reward, terms, None, entry))
        if strangers:
            self._pay_strangers(done, rewards)
        self._commit(self._waiting, done, len(self._row_agents), wall_ns)
        self._waiting = []

    def _pay_strangers(self, done: list[Any], rewards: Mapping[AgentId, Any]) -> None:
        """Rows for agents that were paid without having been given anything at this turn."""
        known = set(self._row_agents)
        for agent, reward in rewards.items():
            real = reward_of(reward)
            if agent in known or real == 0.0:
                continue
            self._add_row(agent, live=False)
            terms = None if self._paid_terms is None else self._paid_terms(agent)
            entry = (nonconforming("reward", reward),) if real is None else None
            done.extend((None, None, real, terms, None, entry))

    def _raised(self, moves: list[Move], error: str, wall_ns: int) -> None:
        """The tick raised: its rows say so, and the same decision stands again at the next turn."""
        again = list(self._waiting)
        for at in range(1, len(again), GIVEN):
            if again[at].__class__ is LargePlace:  # the writer frees that place: it gets the bytes
                again[at] = self.sink.rings.copy(again[at])  # type: ignore[union-attr]
        done: list[Any] = []
        for order, payload, entry in moves:
            done.extend((order, payload, None, None, error, entry))
        self._commit(self._waiting, done, len(self._row_agents), wall_ns)
        self._waiting = again

    def _end(self) -> None:
        if len(self._waiting) != len(self._row_agents) * GIVEN:  # an interrupted reset
            self._waiting, self._row_agents = [], []
        over = self._ended and bool(self._row_agents)
        if not self._is_closed:
            self._commit(
                self._waiting, NOTHING_DONE * len(self._row_agents), len(self._row_agents), None
            )
        self._waiting = []
        self._take_agents([])
        self._finish("ended" if over or not getattr(self.env, "agents", ()) else "cut")


def _named(agents: Any, observations: Any, infos: Any) -> Any:
    """Agents that a reset names: live ones, and others with an entry."""
    is_usual = observations.__class__ is infos.__class__ is dict
    if is_usual and list(observations) == agents == list(infos):
        return agents
    named = [part for part in (observations, infos) if isinstance(part, Mapping)]
    return dict.fromkeys([*agents, *(agent for part in named for agent in part)])


def _five(out: Any) -> Any:
    """The five parts that step returned; None where it returned another form."""
    if out.__class__ is tuple or isinstance(out, tuple | list):
        return out if len(out) == 5 else None
    return None


def _all_ended(agents: Any, terms: Any, truncs: Any) -> bool:
    """Tells whether the flags say of every agent that it ended."""
    flags = [part for part in (terms, truncs) if isinstance(part, Mapping)]
    return all(any(part.get(agent) for part in flags) for agent in agents)
