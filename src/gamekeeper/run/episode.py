"""One episode, played by policies or by actions on paper, as it is or with one thing changed."""

from __future__ import annotations

import copy
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from gamekeeper.core.contract import Contract
from gamekeeper.core.trace import Trace
from gamekeeper.errors import ActionError, GamekeeperError, OrderError, PolicyError
from gamekeeper.game.capture.oddity import type_name_of
from gamekeeper.game.door import AgentId
from gamekeeper.game.faces import game_of
from gamekeeper.game.parallel import ParallelGame
from gamekeeper.run.change import Change, Hooks
from gamekeeper.run.memory import MemorySink
from gamekeeper.run.play import Cast

Actions = Mapping[AgentId, Any]
"""What agents did at one turn; in an AEC environment the one in turn, None where it was dead."""

_IDLE: Final = Hooks()
_SAYS_SOMETHING: Final = (PolicyError, ActionError, OrderError)
"""Errors of ours that say something of the environment: of its masks, or of its own rules."""


@dataclass(frozen=True, slots=True)
class Play:
    """What is to be played.

    Attributes:
        seed: of the reset; None: reset without one.
        stream: number of the episode for the policies' random streams.
        actions: turn by turn; None: policies choose.
        most_turns: the play is cut there.
        options: of the reset.
        looks_last: where an AEC play is cut, the agent in turn is still given what it would be.
    """

    seed: int | None = 0
    stream: int = 0
    actions: tuple[Actions, ...] | None = None
    most_turns: int = 1000
    options: Mapping[str, Any] | None = None
    looks_last: bool = True


@dataclass(frozen=True, slots=True)
class Failed:
    """A call that raised in a play.

    Attributes:
        call: `reset`, `last`, `step`, `look`, or `policy`, which couldn't choose (its mask).
        turn: how many crossings came before.
        kind: the exception's type.
        text: what it said.
        traceback: as text.
    """

    call: str
    turn: int
    kind: str
    text: str
    traceback: str


@dataclass(frozen=True, slots=True)
class Played:
    """How a play went.

    Attributes:
        play: with the actions that were taken, so that it can be played again.
        trace: its rows.
        failed: the call that raised, if one did.
        is_over: the episode ended by itself.
    """

    play: Play
    trace: Trace
    failed: Failed | None
    is_over: bool


class Watch(Protocol):
    """Looks on after the reset (turn 0) and after every crossing."""

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """`out` is what reset or step returned; None in an AEC environment."""


def perform(
    play: Play,
    env: Any,
    *,
    cast: Cast | None = None,
    cast_seed: int = 0,
    change: Change | None = None,
    contract: Contract | None = None,
    terms: tuple[str, ...] | None = None,
    identity: Mapping[str, Any] | None = None,
    label: str = "",
    number: int = 0,
    state: bool = True,
    watch: Watch | None = None,
    on_step: Callable[[], None] | None = None,
) -> Played:
    """Plays one episode in `env` and returns what it came to, whatever the environment does.

    Args:
        play: what to play; without actions `cast` chooses.
        env: a ParallelEnv or AECEnv; it is reset, and not closed.
        cast_seed: seeds the policies, together with `play.stream`.
        change: the one thing done differently.
        contract: names the reward terms and the volatile infos.
        terms: reward terms in place of the contract's.
        identity: of the environment, for the fingerprint.
        label: the probe's name, for the trace's places.
        number: of the play in its probe.
        state: also keep `state()`.
        on_step: called before every step; what it raises ends the play and comes out here.
    Raises:
        GamekeeperError: Gamekeeper itself can't go on.
    """
    declared = contract or Contract()
    named = tuple(declared.rewards) if terms is None else terms
    sink = MemorySink(terms=named, volatile=declared.volatile_infos())
    game = game_of(env, sink=sink, state=state)
    game.episode = number - 1
    hooks = _IDLE if change is None else change.start(np.random.default_rng([7, play.stream]))
    course = Course(play, game, cast, hooks, watch, on_step or _nothing, declared)
    if cast is not None and play.actions is None:
        cast.begin(cast_seed, play.stream)
    try:
        failed = course.run()
    finally:
        hooks.after(env)
    game.end_episode()
    evidence = sink.evidence(identity or {}, contract=declared)
    trace = next(evidence.traces)
    trace = replace(
        trace,
        header={**trace.header, "probe": label},
        change=None if change is None else change.to_json(),
        _cache={},
    )
    trace.keep_turns()
    done = replace(play, actions=tuple(course.taken), most_turns=max(len(course.taken), 1))
    return Played(done, trace, failed, failed is None and trace.header.get("end") == "ended")


class Course:
    """The loop over both APIs, with a change's hooks and a watch between its steps."""

    def __init__(
        self,
        play: Play,
        game: Any,
        cast: Cast | None,
        hooks: Hooks,
        watch: Watch | None,
        on_step: Callable[[], None],
        contract: Contract | None = None,
    ) -> None:
        self.taken: list[Actions] = []
        self._play, self._game, self._cast = play, game, cast
        self._hooks, self._watch, self._on_step = hooks, watch, on_step
        self._is_parallel = isinstance(game, ParallelGame)
        self._contract, self._is_told = contract or Contract(), hooks.wants_given
        self._call = "reset"

    def run(self) -> Failed | None:
        """Plays; returns the call that raised, if one did."""
        try:
            self._hooks.declared(self._contract)
            self._hooks.before_reset(self._game.env)
            out = self._game.reset(self._play.seed, self._play.options)
            self._look(0, out)
            turns = self._play.most_turns
            if self._play.actions is not None:
                turns = min(turns, len(self._play.actions))
            for turn in range(turns):
                if not self._game.to_move:
                    break
                if self._is_off_paper(turn):
                    break
                self._on_step()
                self._turn(turn)
            self._last_look()
        except (KeyboardInterrupt, Stopped):
            raise
        except BaseException as error:  # whatever foreign code raises is evidence
            if isinstance(error, GamekeeperError) and not isinstance(error, _SAYS_SOMETHING):
                raise
            text = "".join(traceback.format_exception(error, limit=-12))
            kind = type_name_of(type(error))
            return Failed(self._call, self._game.turn, kind, str(error)[:500], text)
        return None

    def _turn(self, turn: int) -> None:
        if self._is_parallel:
            actions = self._hooks.acts(turn, self._chosen_by_all(turn))
            self.taken.append(_copied(actions))
            self._call = "step"
            out = self._game.step(actions)
        else:
            out = None
            agent, action = self._chosen_in_turn(turn)
            action = self._hooks.acts(turn, {agent: action}).get(agent)
            self.taken.append(_copied({agent: action}))
            self._call = "step"
            self._game.step(action)
        self._look(turn + 1, out)

    def _is_off_paper(self, turn: int) -> bool:
        """Whether the paper has None, as for a dead agent, where now a live one is in turn."""
        if self._is_parallel or self._play.actions is None:
            return False
        if next(iter(self._play.actions[turn].values()), None) is not None:
            return False
        self._call = "last"
        _, _, terminated, truncated, _ = self._game.last()
        return not (terminated or truncated)

    def _last_look(self) -> None:
        """What the agent in turn is given where the play is cut: as in a Parallel environment."""
        if self._play.looks_last and not self._is_parallel and self._game.to_move:
            self._call = "last"
            self._game.last()

    def _look(self, turn: int, out: Any) -> None:
        self._call = "look"
        self._hooks.between(turn, self._game.env)
        if self._watch is not None:
            self._watch(turn, self._game.env, out)

    def _chosen_by_all(self, turn: int) -> dict[AgentId, Any]:
        game, movers = self._game, self._game.to_move
        seen, infos, sees = game.observations, game.infos, self._hooks.sees
        if self._is_told:
            for agent in movers:
                self._hooks.given(turn, agent, seen.get(agent), infos.get(agent))
        if self._play.actions is not None:
            paper = self._play.actions[turn]
            return {agent: _own(paper[agent]) for agent in paper}
        return {a: self._chosen(a, sees(turn, a, seen.get(a)), infos.get(a)) for a in movers}

    def _chosen_in_turn(self, turn: int) -> tuple[AgentId, Any]:
        self._call = "last"
        observation, _, terminated, truncated, info = self._game.last()
        agent = self._game.to_move[0]
        if self._is_told and not (terminated or truncated):
            self._hooks.given(turn, agent, observation, info)
        if self._play.actions is not None:
            paper = self._play.actions[turn]
            return agent, _own(next(iter(paper.values()), None))
        if terminated or truncated:
            return agent, None
        return agent, self._chosen(agent, self._hooks.sees(turn, agent, observation), info)

    def _chosen(self, agent: AgentId, observation: Any, info: Any) -> Any:
        assert self._cast is not None, "a play without actions needs a cast"
        self._call = "policy"
        return self._cast.act(agent, observation, info)


class Stopped(Exception):  # noqa: N818  # no error: whoever counts the steps says that it is enough
    """The one who was asked before every step wants no more."""


def actions_of(played: Sequence[Actions]) -> tuple[Actions, ...]:
    """The actions as they can be handed over once more, whatever became of the arrays."""
    return tuple(_copied(each) for each in played)


def _copied(actions: Actions) -> dict[AgentId, Any]:
    return {agent: _own(action) for agent, action in actions.items()}


def _own(action: Any) -> Any:
    """A copy of an action that can be written to; what can't be written is itself."""
    return action if isinstance(action, int | float | str | np.generic) else copy.deepcopy(action)


def _nothing() -> None:
    """Nobody counts."""
