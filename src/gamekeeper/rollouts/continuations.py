"""Continuations of a recorded episode: led to one of its turns, then played on by its policies."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gamekeeper.contract import Contract
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.aec_capture import AECCapture
from gamekeeper.interface.capture import AgentId
from gamekeeper.interface.generators import generators, is_same_state, state_of
from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.rollouts import policy_memory
from gamekeeper.rollouts.episode_loop import Actions, EpisodePlan
from gamekeeper.rollouts.intervention import Hooks
from gamekeeper.rollouts.process_randomness import (
    kept_global_generators,
    rekey,
    restore,
    seed_all,
    states,
)
from gamekeeper.rollouts.snapshots import arrays, is_same, snapshot, spaces_in
from gamekeeper.rollouts.tally import TalliedEpisode

MOST_COPIES: Final = 64
"""Turns at which a copy of the environment waits to be copied again."""


@dataclass(frozen=True, slots=True)
class RecordedEpisode:
    """An episode that was recorded, and what it takes to play it again.

    Attributes:
        env: a ParallelEnv or AECEnv; it is reset, and not closed.
        joint_policy: the policies; those that remember something see what they saw in the
            recording.
        policy_seed: seed of the run.
        contract: names noops, masks and volatile infos.
        most_turns: a continuation is cut there.
        has_own_policies: the policies are those of the recording, so that they choose as they did.
    """

    plan: EpisodePlan
    env: Any
    joint_policy: JointPolicy
    policy_seed: int
    contract: Contract
    most_turns: int
    has_own_policies: bool = False

    @property
    def actions(self) -> tuple[Actions, ...]:
        """The recorded actions, turn by turn."""
        return self.plan.actions or ()


class _RecordedActions(Hooks):
    """Plays recorded actions in place of the chosen ones, up to a turn and with others at it."""

    def __init__(self, actions: tuple[Actions, ...], *, is_noting: bool = False) -> None:
        self.actions, self.until = actions, len(actions)
        self.held: Mapping[AgentId, Any] = {}
        self.notes: list[Any] = []
        self.chosen: list[Any] = []
        self.chosen_then: Callable[[], None] | None = None
        self.wants_given = is_noting

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        self.notes.append(snapshot(observation))

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        if self.wants_given:
            self.notes.append(snapshot(actions))
        if turn < self.until:
            self.chosen.append(snapshot(actions))
            return copy.deepcopy(dict(self.actions[turn]))
        if turn > self.until:
            return actions
        if self.chosen_then is not None:
            self.chosen_then()
        return {agent: copy.deepcopy(self.held.get(agent, actions[agent])) for agent in actions}

    def __deepcopy__(self, memo: dict[int, Any]) -> _RecordedActions:
        copied = _RecordedActions(self.actions, is_noting=self.wants_given)
        copied.until, copied.held, copied.notes = self.until, self.held, list(self.notes)
        copied.chosen = list(self.chosen)
        return copied


@dataclass(slots=True)
class _StandingEpisode:
    """An episode that stands at a turn; its deep copy stands there too."""

    episode: TalliedEpisode
    hooks: _RecordedActions
    generators: list[Any] | None = None
    """Those that the environment and its policies hold; None: they weren't looked for yet."""

    def seek(self) -> list[Any]:
        """Looks for the generators, which may take longer than an episode."""
        assert isinstance(self.episode.joint_policy, JointPolicy)
        held = (self.episode.capture.env, self.episode.joint_policy.policies())
        return [*generators(held)][2:]  # the global ones are seeded by themselves

    def draw_anew(self, number: int, held: Mapping[AgentId, Any]) -> None:
        """Gives everything that draws another future; equal numbers give equal ones.

        Policies of agents whose action is held choose once more on the recorded draws, so that they
        remember what they did, and draw anew from then on.
        """
        joint_policy = self.episode.joint_policy
        assert isinstance(joint_policy, JointPolicy)
        if self.generators is None:
            self.generators = self.seek()
        self.hooks.held = held
        if not held:
            seed_all(number)
            rekey(self.generators, number)
            joint_policy.draw_anew(number)
            return
        policies = [joint_policy.chosen_for(agent).policy for agent in held]
        own = {id(each) for each in [*generators(policies)][2:]}
        later = [each for each in self.generators if id(each) in own]
        free = [agent for agent in self.episode.capture.to_move if agent not in held]
        if free:
            seed_all(number)
        joint_policy.draw_anew(number, without=held)
        rekey([each for each in self.generators if id(each) not in own], number)

        def chosen() -> None:
            seed_all(number ^ 1)  # the same number again would repeat what the others drew
            rekey(later, number)
            joint_policy.draw_anew(number, without=free)

        self.hooks.chosen_then = chosen

    def mark(self) -> Any:
        """Marks of its place, equal at every time: agents that act, rewards, observations."""
        capture = self.episode.capture
        seen = {} if isinstance(capture, AECCapture) else capture.observations
        returns = dict(self.episode.count.returns)
        return [list(capture.to_move), returns, [array.copy() for array in arrays(seen)]]


class Continuations:
    """Continuations from the turns of one recorded episode.

    The way to a turn is the recorded one: its actions are played again, and the policies are asked
    beside them, so that they remember what they did. Where copies of the environment and its
    policies are shown to go on as the recording does, a turn is reached once and copied; elsewhere
    it is played again each time.

    Attributes:
        steps: env steps that were taken so far.
        budget: no continuation begins once so many were taken.
        by_copies: copies are made.
        draws: a generator of the environment or of a policy was drawn from in the episode.
    """

    def __init__(
        self,
        base: RecordedEpisode,
        *,
        budget: int,
        copies: bool = True,
        on_step: Callable[[], None] | None = None,
    ) -> None:
        """Plays the episode once, and tries whether copies go on as it does.

        Args:
            copies: False: every continuation is played from the reset.
            on_step: called before every env step, as a sign of life.
        Raises:
            EvidenceError: what is played isn't the same at every time.
        """
        self.base, self.budget, self.steps = base, budget, 0
        self._on_step = on_step
        self._standing: dict[int, _StandingEpisode] = {}
        self._marks: dict[int, Any] = {}
        self.by_copies, self.draws = False, False
        self._shared = policy_memory.shared_state(base.joint_policy.policies())
        self.recorded, self._chosen = self._whole()
        is_kept = self._is_kept()
        self.by_copies = copies and is_kept and self._copies_hold()
        if not is_kept:  # what the policies keep elsewhere must not outlive an episode
            self._check_choices(self._whole()[1], self._chosen)

    @property
    def is_spent(self) -> bool:
        """The budget is spent."""
        return self.steps >= self.budget

    @property
    def turns(self) -> int:
        """Env steps of the recorded episode."""
        return len(self.base.actions)

    def play(
        self, turn: int, numbers: Iterable[int], *, held: Mapping[AgentId, Any] | None = None
    ) -> list[Outcome]:
        """Outcomes of continuations from a turn; fewer than asked for where the budget is spent.

        Args:
            turn: env steps that are played as recorded.
            numbers: one for each continuation, in [0, 2**31); equal ones draw equally.
            held: actions at that turn; agents that it doesn't name choose theirs.
        Raises:
            EvidenceError: there is no such turn, or what is played to it isn't the same each time.
        """
        return [episode.outcome() for episode in self._played(turn, numbers, held or {})]

    def paths(
        self, turn: int, numbers: Iterable[int], *, held: Mapping[AgentId, Any] | None = None
    ) -> Iterator[tuple[Outcome, list[float]]]:
        """Yields continuations with the sum of all returns at their first turn and after each step.

        Raises:
            EvidenceError: as `play`.
        """
        path: list[float] = []
        for episode in self._played(turn, numbers, held or {}, path):
            yield episode.outcome(), list(path)
            path.clear()

    def record(
        self,
        turn: int,
        sink: Any,
        *,
        number: int | None = None,
        held: Mapping[AgentId, Any] | None = None,
    ) -> Outcome:
        """Records one continuation, from its reset on, as the first episode of a sink.

        Args:
            turn, held: as in `play`.
            sink: takes the rows, as a capture's does.
            number: as in `play`; None: everything goes on drawing as it would have.
        Raises:
            EvidenceError: as `play`.
        """
        with kept_global_generators():
            standing = self._begun(sink=sink)
            self._lead(standing, turn)
            if number is not None:
                standing.draw_anew(number, held or {})
            standing.hooks.held = held or {}
            standing.episode.run()
            standing.episode.capture.end_episode()
        return standing.episode.outcome()

    def is_settled(self, turn: int, numbers: Iterable[int]) -> bool:
        """Tells whether continuations from a turn end as the recording did, by the same actions.

        Where they do, no draw of theirs was seen to matter. With a spent budget it is false.
        """
        first = None
        for episode in self._played(turn, numbers, {}):
            first = snapshot(episode.taken) if first is None else first
            if episode.outcome() != self.recorded or not is_same(episode.taken, first):
                return False
        return first is not None

    def _played(
        self,
        turn: int,
        numbers: Iterable[int],
        held: Mapping[AgentId, Any],
        path: list[float] | None = None,
    ) -> Iterator[TalliedEpisode]:
        """Yields continuations that were played to their ends; `path` takes their returns."""
        for number in numbers:
            if self.is_spent:
                return
            with kept_global_generators():
                standing = self._at(turn)
                standing.draw_anew(number, held)
                if path is not None:
                    path += _stepwise(standing.episode)
                if standing.episode.failed is None:
                    standing.episode.run()
            if self.by_copies and not self._is_kept():
                self.by_copies = False
                self._standing.clear()
            yield standing.episode

    def inputs(self, turn: int) -> dict[AgentId, tuple[Any, Any]]:
        """Observation and info of each agent that acts at a turn."""
        with kept_global_generators():
            capture = self._at(turn).episode.capture
            if isinstance(capture, AECCapture):
                observation, _, _, _, info = capture.last()
                return dict.fromkeys(capture.to_move, (observation, info))
            return {a: (capture.observations.get(a), capture.infos.get(a)) for a in capture.to_move}

    def _begun(self, *, is_noting: bool = False, sink: Any = None) -> _StandingEpisode:
        """The episode before its reset; `sink` takes its rows."""
        base = self.base
        hooks = _RecordedActions(base.actions, is_noting=is_noting)
        plan = replace(base.plan, actions=None, most_turns=base.most_turns)

        def count() -> None:
            self.steps += 1
            if self._on_step is not None:
                self._on_step()

        episode = TalliedEpisode(
            plan,
            base.env,
            hooks,
            contract=base.contract,
            joint_policy=_own_policies(base.joint_policy),
            policy_seed=base.policy_seed,
            on_step=count,
            sink=sink,
        )
        return _StandingEpisode(episode, hooks)

    def _at(self, turn: int) -> _StandingEpisode:
        """The episode at a turn, to be played on."""
        if not self.by_copies:
            standing = self._begun()
            self._lead(standing, turn)
            return standing
        kept = self._standing
        if turn not in kept:
            before = max((each for each in kept if each < turn), default=None)
            standing = self._begun() if before is None else _copied(kept[before])
            self._lead(standing, turn)
            if len(kept) >= MOST_COPIES:
                kept.pop(min(each for each in kept if each))
            # all copies are made of one that the base's own environment doesn't move
            kept[turn] = standing if before is not None else _copied(standing)
        return _copied(kept[turn])

    def _lead(self, standing: _StandingEpisode, turn: int) -> None:
        standing.hooks.until = turn
        standing.episode.run(turn)
        mark = standing.mark()
        known = self._marks.setdefault(turn, mark)
        failed = standing.episode.failed
        self._check_choices(standing.hooks.chosen, self._chosen[:turn])
        if failed is not None or standing.episode.turns < turn or not is_same(mark, known):
            raise EvidenceError(
                "an episode doesn't play twice in the same way",
                where=f"episode {self.base.plan.stream}, turn {turn}",
                actual="another base" if failed is None else failed.said,
                fix="gamekeeper replay RUN looks for the cause",
            )

    def _whole(self) -> tuple[Outcome, list[Any]]:
        """Outcome of the episode as it was recorded, and what its policies chose beside it.

        Raises:
            EvidenceError: they are the recorded ones, remember something, and chose otherwise.
        """
        base, before = self.base, None
        with kept_global_generators():
            standing = self._begun()
            episode = standing.episode
            assert isinstance(episode.joint_policy, JointPolicy)
            policies = episode.joint_policy.policies()
            before = policy_memory.own_state(policies)
            episode.run(0)
            held = standing.seek()
            then = states(), [state_of(each) for each in held]
            episode.run(self.turns)
            now = states(), [state_of(each) for each in held]
            self.draws = episode.joint_policy.has_drawn or not is_same_state(then, now)
            is_same_memory = before == policy_memory.own_state(policies) and self._is_kept()
        if base.has_own_policies and not is_same_memory:
            self._check_choices(standing.hooks.chosen, base.actions)
        return episode.outcome(), standing.hooks.chosen

    def _is_kept(self) -> bool:
        """Tells whether what policies keep outside themselves is shown to be as it was."""
        now = policy_memory.shared_state(self.base.joint_policy.policies())
        return now is not None and now == self._shared

    def _check_choices(self, chosen: Sequence[Any], expected: Sequence[Any]) -> None:
        """Checks that policies chose again what they chose before, so that they remember the same.

        Raises:
            EvidenceError: they didn't.
        """
        for turn, (one, other) in enumerate(zip(chosen, expected, strict=False)):
            agents = [agent for agent in one if not _agree(one[agent], other.get(agent))]
            if agents:
                raise EvidenceError(
                    "a policy doesn't choose again what it chose, so what it remembers at a turn "
                    "isn't known",
                    where=f"episode {self.base.plan.stream}, turn {turn}, {agents[0]}",
                    expected=str(other.get(agents[0]))[:200],
                    actual=str(one[agents[0]])[:200],
                    fix="give the policy a `reset(seed)` that forgets the last episode, or keep "
                    "what it remembers in an object of its own",
                )

    def _copies_hold(self) -> bool:
        """Tells whether copies made half-way go on as the recording, and leave the original so."""
        with kept_global_generators():
            try:
                ends = list(self._ends_of_copies())
            except Exception:  # whatever refuses to be copied is played again
                return False
        return all(outcome == self.recorded and is_same(a, b) for outcome, a, b in ends)

    def _ends_of_copies(self) -> Iterator[tuple[Outcome, Any, Any]]:
        """Yields the outcome and the notes of two copies and their original, beside the first's.

        Notes are what agents observed and what policies chose.
        """
        original, first = self._begun(is_noting=True), None
        original.episode.run(self.turns // 2)
        then = states()
        for each in (_copied(original), _copied(original), original):
            restore(then)
            each.episode.run(self.turns)
            first = snapshot(each.hooks.notes) if first is None else first
            yield each.episode.outcome(), each.hooks.notes, first


def _own_policies(joint_policy: JointPolicy) -> JointPolicy:
    """Policies as they were at first; the joint policy itself where it can't be copied."""
    try:
        return copy.deepcopy(joint_policy)
    except Exception:  # foreign code refuses in many ways
        return joint_policy


def _agree(one: Any, other: Any) -> bool:
    """Tells whether two actions are equal, as far as computing them again gives the same."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_agree(one[k], other[k]) for k in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_agree, one, other))
    values = np.asarray(one), np.asarray(other)
    if all(each.dtype.kind in "biuf" for each in values):
        return values[0].shape == values[1].shape and np.allclose(*values, equal_nan=True)
    return is_same(one, snapshot(other))


def _stepwise(episode: TalliedEpisode) -> Iterator[float]:
    """Plays an episode on step by step, and yields the sum of all returns before and after each."""
    before = -1
    while episode.failed is None and episode.turns > before:
        yield sum(episode.count.returns.values())
        before = episode.turns
        episode.run(before + 1)


def _copied(standing: _StandingEpisode) -> _StandingEpisode:
    """A copy that goes on by itself; spaces are shared, as copying them takes longest."""
    if standing.generators is None:
        standing.generators = standing.seek()
    shared = spaces_in(standing.episode.capture.env)
    return copy.deepcopy(standing, {id(each): each for each in shared})
