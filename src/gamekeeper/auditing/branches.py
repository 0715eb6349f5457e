"""Branches of an episode: led to a step, one move replaced, played on by the script.

Values are compared by digests, without a capture, so that thousands of branches can be afforded.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any, Final

import numpy as np

from gamekeeper.auditing.outcomes import value_bytes
from gamekeeper.auditing.probe_session import ProbeSession
from gamekeeper.episodes.episode import MASK
from gamekeeper.rollouts.episode_loop import EpisodePlan
from gamekeeper.rollouts.process_randomness import HELD, restore, seed_all, states

SHORT: Final = 64
"""Bytes that are no longer than what stands for them."""


@dataclass(frozen=True, slots=True)
class DecisionInput:
    """Digests of what an agent decides with, and its mask as it is."""

    observation: bytes
    mask_digest: bytes
    mask: Any


@dataclass(frozen=True, slots=True)
class BranchStep:
    """One env step by digests.

    Attributes:
        given: by agent that acts; none in the step of an agent that had ended.
        actions: as they were taken; None: it wasn't taken, as others have to act.
        ended: by agent `termination` or `truncation`, of all flags that were raised so far.
        roster: `agents` after it.
    """

    given: Mapping[Any, DecisionInput]
    actions: Mapping[Any, Any] | None = None
    rewards: Mapping[Any, float] = field(default_factory=dict)
    ended: Mapping[Any, str] = field(default_factory=dict)
    roster: tuple[Any, ...] = ()


@dataclass(slots=True)
class Board:
    """An environment in mid-episode, with what its agents are given.

    Attributes:
        session: counts its steps.
        env: stepped in place.
        given: by agent that decides now.
        ended: flags that were raised.
        shared: objects that copies share.
        globals: states of the generators of the process, where the board waits to be taken up.
        seed: of the reset.
        taken: actions since the reset.
    """

    session: ProbeSession
    env: Any
    given: dict[Any, DecisionInput] = field(default_factory=dict)
    ended: dict[Any, str] = field(default_factory=dict)
    shared: Sequence[Any] = ()
    globals: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    taken: tuple[Mapping[Any, Any], ...] = ()

    def reset(self, seed: int | None) -> None:
        """Starts the episode, with the generators of the process at a place of that seed's."""
        seed_all(HELD + (seed or 0))
        self.session.meter.count()
        out = self.env.reset(seed=seed)
        self.ended, self.seed, self.taken = {}, seed, ()
        if self.session.api == "parallel":
            self._hand_out(out[0], out[1])
        else:
            self._ask()

    def waiting(self, *, with_globals: bool) -> Board:
        """A copy to be taken up from, maybe with the generators of the process as they stand."""
        board = self._copied()
        board.globals = states() if with_globals else {}
        return board

    def taken_up(self) -> Board:
        """A copy to go on with; the generators of the process stand as they stood here."""
        if self.globals:
            restore(self.globals)
        return self._copied()

    def _copied(self) -> Board:
        """The same place in an environment of its own; spaces are shared, as copies cost most."""
        env = copy.deepcopy(self.env, {id(each): each for each in self.shared})
        return replace(self, env=env, given=dict(self.given), ended=dict(self.ended), globals={})

    @property
    def is_over(self) -> bool:
        """Tells whether no agent is there any more."""
        return not self.env.agents

    def step(self, actions: Mapping[Any, Any]) -> BranchStep:
        """Takes a step with these actions; that of an ended agent in turn with None."""
        self.session.meter.count()
        self.taken = (*self.taken, {agent: copy.deepcopy(actions[agent]) for agent in self.given})
        try:
            return self._stepped(actions)
        except Exception:
            play = EpisodePlan(self.seed, 0, self.taken, len(self.taken))
            self.session.raised[:] = self.session.raised or [play]
            raise

    def _stepped(self, actions: Mapping[Any, Any]) -> BranchStep:
        given = dict(self.given)
        acts = {agent: copy.deepcopy(actions[agent]) for agent in given}
        if self.session.api == "parallel":
            out = self.env.step(acts)
            rewards = {agent: float(paid) for agent, paid in out[1].items()}
            self._note_flags(out[2], out[3])
            self._hand_out(out[0], out[4])
        else:
            self.env.step(next(iter(acts.values()), None))
            rewards = {agent: float(paid) for agent, paid in self.env.rewards.items()}
            self._note_flags(self.env.terminations, self.env.truncations)
            self._ask()
        roster = tuple(self.env.agents)
        return BranchStep(given, dict(actions), rewards, dict(self.ended), roster)

    def _hand_out(self, observations: Any, infos: Any) -> None:
        self.given = {
            agent: _given(observations.get(agent), infos.get(agent)) for agent in self.env.agents
        }

    def _ask(self) -> None:
        self.given = {}
        agent = self.env.agent_selection if self.env.agents else None
        if agent is not None and agent not in self.ended:
            observation, _, _, _, info = self.env.last()
            self.given = {agent: _given(observation, info)}

    def _note_flags(self, terminated: Mapping[Any, Any], truncated: Mapping[Any, Any]) -> None:
        for agent in (*terminated, *truncated):
            if terminated.get(agent):
                self.ended.setdefault(agent, "termination")
            elif truncated.get(agent):
                self.ended.setdefault(agent, "truncation")


@dataclass(frozen=True, slots=True)
class EpisodeSteps:
    """An episode that was played, to be played again up to any of its steps.

    Attributes:
        first: agents after it.
        rounds: number of each step's round.
    """

    seed: int | None
    first: tuple[Any, ...]
    steps: Sequence[BranchStep]
    rounds: Sequence[int]


def branch(
    board: Board,
    script: EpisodeSteps,
    start: int,
    change: Mapping[Any, Any],
    ahead: int,
    fitting: Callable[[Any, Any, Any], Any],
) -> Iterator[tuple[int, BranchStep]]:
    """Yields the steps from `start` on with actions replaced in the first, the others scripted.

    A scripted action that a mask forbids here gives way to a legal one. Steps of agents that have
    ended are taken where they are due here, whatever the script says. The branch ends `ahead`
    rounds after the start's, and where other agents have to act than by the script; then the last
    step is one that wasn't taken.

    Args:
        board: it stands before `start`, and is moved on.
        change: actions in place of scripted ones, in the first step.
        fitting: of an agent, its mask and an action: that action where it is legal, else another.
    """
    last = script.rounds[start] + ahead
    for place in range(start, len(script.steps)):
        written = script.steps[place]
        if script.rounds[place] > last or board.is_over or written.actions is None:
            return
        if not written.given and board.given:
            continue
        if written.given:
            _take_ended_out(board)
        if written.given.keys() != board.given.keys():
            yield place, BranchStep(dict(board.given), None, {}, dict(board.ended))
            return
        actions = {**written.actions, **(change if place == start else {})}
        yield (
            place,
            board.step({a: fitting(a, each.mask, actions[a]) for a, each in board.given.items()}),
        )


def _take_ended_out(board: Board) -> None:
    """Takes the None steps of ended agents, up to a live one's turn."""
    for _ in range(len(board.ended)):
        if board.given or board.is_over:
            return
        board.step({})


def value_digest(value: Any) -> bytes:
    """Digest of a value; equal values of one space have equal ones."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        piece = value.tobytes()
        return piece if len(piece) <= SHORT else blake2b(piece, digest_size=8).digest()
    found = blake2b(digest_size=8)
    for piece in value_bytes(value):
        found.update(piece)
    return found.digest()


def _given(observation: Any, info: Any) -> DecisionInput:
    mask = next(
        (each[MASK] for each in (observation, info) if isinstance(each, Mapping) and MASK in each),
        None,
    )
    if isinstance(observation, Mapping) and MASK in observation:
        observation = {key: value for key, value in observation.items() if key != MASK}
    if mask is None:
        return DecisionInput(value_digest(observation), b"", None)
    return DecisionInput(value_digest(observation), value_digest(mask), copy.deepcopy(mask))
