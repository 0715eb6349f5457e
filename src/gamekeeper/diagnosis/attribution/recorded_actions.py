"""One episode watched closely: what was given, done and paid at each turn, by agent.

A track plays from a script where it has one: every agent does what it did at its own k-th decision,
and one of them may do otherwise. Where such an action isn't legal now, or the script has no more of
them, the agent does its declared noop if that is legal, else the first legal action.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isclose
from typing import Any, Literal, TypeAlias

import numpy as np
from gymnasium.spaces import Discrete
from numpy.random import Generator

from gamekeeper.contract import Contract
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import plain_numbers
from gamekeeper.interface.action_mask import legal_flags, reader
from gamekeeper.interface.capture import AgentId
from gamekeeper.interface.policies import first_legal, noop, random
from gamekeeper.interface.policy import AgentSlot
from gamekeeper.rollouts.episode_loop import ActionChooser, own_action


@dataclass(slots=True)
class InfoTerms:
    """Declared terms read from infos, step by step: fields of their names, also one level deeper.

    They count only where they sum to every reward that is paid: a field may have a term's name and
    hold something else, as a running total.

    Attributes:
        found: those that stood in some info.
        is_unequal: some reward wasn't their sum.
    """

    declared: frozenset[str]
    found: set[str] = field(default_factory=set)
    is_unequal: bool = False

    @property
    def hold(self) -> bool:
        """Some were found, and every reward was their sum: those that weren't found were 0."""
        return bool(self.found) and not self.is_unequal

    def take(self, infos: Any, rewards: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """Terms of one step, by agent.

        Args:
            infos: what agents were given after the step.
        """
        given = infos if isinstance(infos, Mapping) else {}
        terms = {agent_name(agent): self._terms(info) for agent, info in given.items()}
        for agent, reward in rewards.items():
            mine = terms.setdefault(agent, {})
            self.found.update(mine)
            if not isclose(sum(mine.values()), reward, rel_tol=1e-5, abs_tol=1e-6):
                self.is_unequal = True
        return terms

    def _terms(self, info: Any) -> dict[str, float]:
        nested = [each for each in info.values() if isinstance(each, Mapping)] if info else []
        found: dict[str, float] = {}
        for part in (*nested, info):
            numbers = plain_numbers(part)
            found.update({name: numbers[name] for name in self.declared & numbers.keys()})
        return found


Instead: TypeAlias = Literal["noop", "other"]
"""Action in place of an agent's own: none, or another legal one, drawn."""


@dataclass(frozen=True, slots=True)
class EpisodeActions:
    """Actions of an episode.

    Attributes:
        turns: ticks, or turns of an AEC environment.
        actions: by agent, its decisions in their order.
        number: of the episode in its run.
        run: whether it stands in the recorded run, or was played since.
    """

    seed: int | None
    options: Any
    turns: int
    actions: Mapping[str, Sequence[Any]]
    number: int
    run: Literal["recorded", "fresh"] = "recorded"


@dataclass(frozen=True, slots=True)
class Swap:
    """One agent does otherwise.

    Attributes:
        turn: at which; None: whenever it decides.
    """

    agent: str
    turn: int | None
    instead: Instead


@dataclass(slots=True)
class ActionTrack:
    """Policies of an episode and a watch over it in one; its fields hold what it has seen.

    Attributes:
        sees: also keeps what was given.
        counts: keeps nothing but what was paid.
        actions: by agent, its decisions in their order.
        moves: who decided at which turn, in order: (turn, agent, was it the noop).
        given: a fingerprint of what an agent was given to decide on, by turn and agent.
        rewards: what each step paid, by agent.
        terms: the same by reward term; empty where the environment doesn't tell terms.
        info_terms: declared terms in infos, where the environment tells terms nowhere else.
        ended: the agents that had ended, after each step.
        left_script: decisions that had to follow the rule for illegal or missing actions.
    """

    env: Any
    contract: Contract
    joint_policy: ActionChooser | None = None
    script: EpisodeActions | None = None
    swap: Swap | None = None
    rng: Generator | None = None
    sees: bool = False
    counts: bool = False
    actions: dict[str, list[Any]] = field(default_factory=dict)
    moves: list[tuple[int, str, bool]] = field(default_factory=list)
    given: dict[tuple[int, str], Any] = field(default_factory=dict)
    rewards: list[dict[str, float]] = field(default_factory=list)
    terms: list[dict[str, dict[str, float]]] = field(default_factory=list)
    info_terms: InfoTerms | None = None
    ended: list[frozenset[str]] = field(default_factory=list)
    left_script: int = 0
    turn: int = 0
    _choosers: dict[str, Chooser] = field(default_factory=dict)
    _gone: frozenset[str] = frozenset()

    # -- the joint policy

    def begin(self, run_seed: int, episode: int) -> None:
        """Seeds the policies."""
        if self.joint_policy is not None:
            self.joint_policy.begin(run_seed, episode)

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """Action of an agent: the recorded one, its policy's, or another."""
        if self.counts and self.joint_policy is not None:
            return self.joint_policy.act(agent, observation, info)
        name = agent_name(agent)
        mine = self.actions.setdefault(name, [])
        if self.sees:
            self.given[self.turn, name] = fingerprint(observation)
        chooser = self._choosers.get(name)
        if chooser is None:
            chooser = self._choosers[name] = Chooser(agent, self.env, self.contract)
        action = self._own_action(chooser, agent, observation, info, len(mine))
        swap = self.swap
        if swap is not None and swap.agent == name and swap.turn in (None, self.turn):
            if swap.instead == "noop":
                action = chooser.nothing(observation, info)
            else:
                assert self.rng is not None, "another action has to be drawn"
                action = chooser.other(action, observation, info, self.rng)
        mine.append(own_action(action))
        self.moves.append((self.turn, name, chooser.is_noop(action)))
        return action

    def _own_action(self, chooser: Chooser, agent: Any, seen: Any, info: Any, count: int) -> Any:
        if self.script is None:
            assert self.joint_policy is not None, "a track needs a joint policy or a script"
            return self.joint_policy.act(agent, seen, info)
        written = self.script.actions.get(agent_name(agent), ())
        if count < len(written) and chooser.is_legal(written[count], seen, info):
            return own_action(written[count])  # whoever overwrites it spoils no later track
        self.left_script += 1
        return chooser.nothing(seen, info)

    # -- the watch

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """Keeps what a step came to."""
        self.turn = turn
        if turn == 0:
            return
        rewards, over, infos = (
            (env.rewards, (env.terminations, env.truncations), env.infos)
            if out is None
            else (out[1], (out[2], out[3]), out[4])
        )
        self.rewards.append({agent_name(a): float(value) for a, value in rewards.items()})
        self._gone |= {agent_name(a) for flags in over for a, flag in flags.items() if flag}
        self.ended.append(self._gone)
        paid = getattr(env, "terms", None)
        if isinstance(paid, dict):
            self.terms.append({agent_name(a): dict(terms) for a, terms in paid.items()})
        elif len(self.contract.rewards) > 1 and not self.counts:
            self.info_terms = self.info_terms or InfoTerms(frozenset(self.contract.rewards))
            self.terms.append(self.info_terms.take(infos, self.rewards[-1]))

    @property
    def has_terms(self) -> bool:
        """Tells whether it is known what each step paid by reward term."""
        is_known = self.info_terms is None or self.info_terms.hold
        return is_known and len(self.terms) == len(self.rewards)

    def team_return(self) -> float:
        """The sum of all rewards."""
        return float(sum(sum(paid.values()) for paid in self.rewards))


class Chooser:
    """Legal actions of an agent, and its action where the wanted one is illegal."""

    def __init__(self, agent: AgentId, env: Any, contract: Contract) -> None:
        """Looks up the agent's action space, mask and noop."""
        self._space = env.action_space(agent)
        self._mask = contract.mask_of(agent)
        self._read = reader(self._mask)
        self._noop = contract.noop_of(agent)
        self._slot = AgentSlot(agent, self._space, contract.role_of(agent), self._noop, self._mask)
        self._still: Any = None
        if self._noop is not None:
            self._still = noop.start_for(self._slot)(np.random.default_rng(0))
        self._first: Any = None

    def is_legal(self, action: Any, seen: Any, info: Any) -> bool:
        """Tells whether the mask allows an action; without a mask all are allowed."""
        space = self._space
        mask = self._read(seen, info) if isinstance(space, Discrete) else None
        if mask is None:
            return True
        flags, place = legal_flags(mask, int(space.n)), int(action) - int(space.start)
        return bool(0 <= place < len(flags) and (flags[place] or not flags.any()))

    def nothing(self, seen: Any, info: Any) -> Any:
        """The noop where it is declared and legal, else the first legal action."""
        if self._still is not None:
            action = self._still(seen, info)
            if self.is_legal(action, seen, info):
                return action
        if self._first is None:
            self._first = first_legal.start_for(self._slot)(np.random.default_rng(0))
        return self._first(seen, info)

    def other(self, action: Any, seen: Any, info: Any, rng: Generator) -> Any:
        """Another legal action; the same where there is no other."""
        space = self._space
        if isinstance(space, Discrete):
            mask = self._read(seen, info)
            if mask is None:
                return _another(space, action, rng)
            flags = legal_flags(mask, int(space.n))
            places = [p for p in flags.nonzero()[0].tolist() if p + int(space.start) != int(action)]
            if not places:
                return action
            return space.dtype.type(int(space.start) + places[int(rng.integers(len(places)))])
        draw = random.start_for(self._slot)(rng)
        for _ in range(8):
            drawn = draw(seen, info)
            if fingerprint(drawn) != fingerprint(action):
                return drawn
        return action

    def is_noop(self, action: Any) -> bool:
        """Tells whether an action is the declared noop."""
        if self._noop is None:
            return False
        if isinstance(self._noop, int):
            return bool(np.ndim(action) == 0 and action == self._noop)
        return bool(fingerprint(action) == fingerprint(self._still(None, None)))


def _another(space: Discrete, action: Any, rng: Generator) -> Any:
    """Another number of a space, which may have too many of them to be listed."""
    size, first = int(space.n), int(space.start)
    own_place = int(action) - first
    is_inside = 0 <= own_place < size
    if size == is_inside:
        return action
    place = int(rng.integers(size - is_inside))
    return space.dtype.type(first + place + (is_inside and place >= own_place))


def fingerprint(value: Any) -> Any:
    """Hashable value, equal for equal values; arrays by their bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return tuple((str(key), fingerprint(value[key])) for key in value)
    if isinstance(value, list | tuple):
        return tuple(fingerprint(each) for each in value)
    if isinstance(value, np.generic):
        return value.dtype.str, value.tobytes()
    return repr(value)
