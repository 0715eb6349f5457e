"""The loop over an episode, the same for both APIs, for rollouts, reruns and replays."""

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.exception_text import message, traceback_text
from gamekeeper.errors import ActionError, GamekeeperError, OrderError, PolicyError
from gamekeeper.interface.aec_capture import AECCapture
from gamekeeper.interface.capture import AgentId
from gamekeeper.interface.openings import Opening
from gamekeeper.interface.packing import type_name_of
from gamekeeper.interface.parallel_capture import ParallelCapture
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.rollouts.intervention import Hooks, Intervention
from gamekeeper.rollouts.memory import MemorySink

# -- Plays episodes: the one loop over a capture, the same for both APIs


class ActionChooser(Protocol):
    """The policies of all agents, as `gamekeeper.interface.policy.assign` makes them."""

    def begin(self, run_seed: int, episode: int) -> None:
        """Seeds every policy for an episode."""

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """Returns the action of `agent`."""


def play(
    capture: ParallelCapture | AECCapture,
    joint_policy: ActionChooser,
    episodes: Iterable[int],
    *,
    seed: int,
    options: Mapping[str, Any] | None = None,
    most_turns: int,
    after_turn: Callable[[], None] | None = None,
    after_episode: Callable[[int], None] | None = None,
) -> None:
    """Plays the episodes numbered in `episodes`, each from its own seed.

    Args:
        capture: an open capture; whatever it records, it records.
        episodes: numbers of episodes in the run; episode k is reset with `episode_seed(seed, k)`.
        most_turns: an episode that is longer is cut.
        after_turn: called after every turn, for progress and signs of life.
        after_episode: called after every episode with how many have been played.
    """
    for done, episode in enumerate(episodes, start=1):
        joint_policy.begin(seed, episode)
        capture.reset(episode_seed(seed, episode), options)
        for _ in range(most_turns):
            if not step_chosen(capture, joint_policy):
                break
            if after_turn is not None:
                after_turn()
        capture.end_episode()
        if after_episode is not None:
            after_episode(done)


def step_chosen(capture: ParallelCapture | AECCapture, joint_policy: ActionChooser) -> bool:
    """Plays one turn as the policies choose; False, and nothing done, once the episode is over."""
    movers = capture.to_move
    if not movers:
        return False
    if isinstance(capture, ParallelCapture):
        seen, infos, act = capture.observations, capture.infos, joint_policy.act
        capture.step({agent: act(agent, seen.get(agent), infos.get(agent)) for agent in movers})
    else:
        observation, _, terminated, truncated, info = capture.last()
        agent = movers[0]
        capture.step(
            None if terminated or truncated else joint_policy.act(agent, observation, info)
        )
    return True


# -- One episode, played by policies or by a script, as it is or with one thing changed

Actions = Mapping[AgentId, Any]
"""Actions of agents at one turn; in AEC that of the agent in turn, None where it has ended."""

_IDLE: Final = Hooks()
_SAYS_SOMETHING: Final = (PolicyError, ActionError, OrderError)
"""Errors of ours that say something of the environment: of its masks, or of its own rules."""


@dataclass(frozen=True, slots=True)
class EpisodePlan:
    """Plan of one episode: seed, options, actions or policies, and its bounds.

    Attributes:
        stream: number of the episode for the policies' random streams.
        actions: turn by turn; None: policies choose.
        most_turns: the episode is cut there.
        asks_last: where an AEC episode is cut, the agent in turn is still given what it would be.
        opening: states of generators and attributes, as a run has them; None: seed and options are
            all.
        stand_ins: actions of live agents that a scripted tick leaves out, as in an episode that was
            shortened; those of ended agents are dropped then. None: a tick is played as it is.
        by_place: actions of a tick are those of the agents in turn by their places, where they name
            none of these.
    """

    seed: int | None = 0
    stream: int = 0
    actions: tuple[Actions, ...] | None = None
    most_turns: int = 1000
    options: Mapping[str, Any] | None = None
    asks_last: bool = True
    opening: str | None = None
    stand_ins: Actions | None = None
    by_place: bool = False


@dataclass(frozen=True, slots=True)
class FailedCall:
    """A call that raised in an episode.

    Attributes:
        call: `reset`, `last`, `step`, `look`, or `policy`, which couldn't choose (its mask).
        turn: how many steps came before.
        kind: the exception's type.
        text: of the exception.
        traceback: as text.
    """

    call: str
    turn: int
    kind: str
    text: str
    traceback: str

    @property
    def said(self) -> str:
        """Kind and text in one line."""
        return f"{self.kind}: {self.text}".removesuffix(": ")


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """Result of one episode.

    Attributes:
        play: with the actions that were taken, so that it can be played again.
        episode: its rows.
        failed: the call that raised, if one did.
        is_over: the episode ended by itself.
    """

    play: EpisodePlan
    episode: Episode
    failed: FailedCall | None
    is_over: bool


class StepHook(Protocol):
    """Looks on after the reset (turn 0) and after every step."""

    def __call__(self, turn: int, env: Any, out: Any) -> None:
        """`out` is what reset or step returned; None in an AEC environment."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceOptions:
    """Settings of the evidence of one episode.

    Attributes:
        terms: reward terms in place of the contract's.
        label: the probe's name, for the episode's places.
        number: of the episode in its probe.
        state: also keep `state()`.
    """

    terms: tuple[str, ...] | None = None
    label: str = ""
    number: int = 0
    state: bool = True


EVERYTHING: Final = EvidenceOptions()


def perform(
    play: EpisodePlan,
    env: Any,
    *,
    joint_policy: ActionChooser | None = None,
    policy_seed: int = 0,
    change: Intervention | None = None,
    contract: Contract | None = None,
    keep: EvidenceOptions = EVERYTHING,
    watch: StepHook | None = None,
    on_step: Callable[[], None] | None = None,
) -> EpisodeResult:
    """Plays one episode in `env` and returns what it came to, whatever the environment does.

    Args:
        play: what to play; without actions `joint_policy` chooses.
        env: a ParallelEnv or AECEnv; it is reset, and not closed.
        policy_seed: seeds the policies, together with `play.stream`.
        change: the one thing done differently.
        contract: names the reward terms and the volatile infos.
        keep: what of it becomes evidence, and under which names.
        on_step: called before every step; an `EpisodeHaltError` of its own cuts the episode there.
    Raises:
        GamekeeperError: Gamekeeper itself can't go on.
    """
    declared = contract or Contract()
    named = tuple(declared.rewards) if keep.terms is None else keep.terms
    sink = MemorySink(terms=named, volatile=declared.volatile_infos())
    capture = capture_of(env, sink=sink, state=keep.state)
    capture.episode = keep.number - 1
    hooks = _IDLE if change is None else change.start(np.random.default_rng([7, play.stream]))
    loop = EpisodeLoop(play, capture, joint_policy, hooks, watch, on_step or nothing, declared)
    if joint_policy is not None and play.actions is None:
        joint_policy.begin(policy_seed, play.stream)
    failed = None
    try:
        failed = loop.run()
    except EpisodeHaltError:
        pass  # what was played till then is an episode that is cut
    finally:
        hooks.after(env)
    capture.end_episode()
    episode = sink.episode()
    episode = replace(
        episode,
        header={**episode.header, "probe": keep.label},
        change=None if change is None else change.to_json(),
    )
    episode.keep_turns()
    taken = tuple(loop.taken)
    done = replace(play, actions=taken, most_turns=max(len(taken), 1), stand_ins=None)
    return EpisodeResult(
        done, episode, failed, failed is None and episode.header.get("end") == "ended"
    )


class EpisodeHaltError(BaseException):
    """Ends an episode from a callback: it comes out of the loop, as no call of the environment."""


class EpisodeLoop:
    """The loop over both APIs, with a change's hooks and a watch between its steps."""

    def __init__(
        self,
        play: EpisodePlan,
        capture: Any,
        joint_policy: ActionChooser | None,
        hooks: Hooks,
        watch: StepHook | None,
        on_step: Callable[[], None],
        contract: Contract | None = None,
    ) -> None:
        self.taken: list[Actions] = []
        self._play, self._capture, self._joint_policy = play, capture, joint_policy
        self._opening = Opening.from_text(play.opening)
        self._hooks, self._watch, self._on_step = hooks, watch, on_step
        self._is_parallel = isinstance(capture, ParallelCapture)
        self._contract, self._notes_given = contract or Contract(), hooks.wants_given
        self._call, self._is_begun = "reset", False

    def run(self, until: int | None = None) -> FailedCall | None:
        """Plays, from where it stopped last; returns the call that raised, if one did.

        Args:
            until: stops after so many turns of the episode, to be run on; None: plays it whole.
        """
        try:
            if not self._is_begun:
                self._begin()
            turns = self._play.most_turns
            if self._play.actions is not None:
                turns = min(turns, len(self._play.actions))
            for turn in range(len(self.taken), turns if until is None else min(until, turns)):
                if not self._capture.to_move:
                    break
                self._on_step()
                if not self._turn(turn):
                    break
            if until is None:
                self._ask_last()
        except (KeyboardInterrupt, EpisodeHaltError):
            raise
        except BaseException as error:  # whatever foreign code raises is evidence
            if isinstance(error, GamekeeperError) and not isinstance(error, _SAYS_SOMETHING):
                raise
            text = traceback_text(error, limit=-12)
            kind = type_name_of(type(error))
            return FailedCall(self._call, self._failed_turn(), kind, message(error)[:500], text)
        return None

    def _failed_turn(self) -> int:
        """Turn of the call that raised; a capture that records nothing doesn't count them."""
        if self._capture.sink is not None:
            return int(self._capture.turn)
        return len(self.taken) - (self._call == "step")

    def _begin(self) -> None:
        self._hooks.declared(self._contract)
        self._hooks.before_reset(self._capture.env)
        self._opening.begin(self._capture.env, was_reset=self._capture.was_reset)
        out = self._capture.reset(self._play.seed, self._play.options)
        self._watch_step(0, out)
        self._is_begun = True

    def _turn(self, turn: int) -> bool:
        """Plays a turn; False where the plan ends an agent that is alive here."""
        if self._opening.later:
            self._opening.set_at(turn, self._capture.env)
        if self._is_parallel:
            actions = self._hooks.acts(turn, self._chosen_by_all(turn))
            self.taken.append(_copied(actions))
            self._call = "step"
            out = self._capture.step(actions)
        else:
            out = None
            chosen = self._chosen_in_turn(turn)
            if chosen is None:
                return False
            agent, action = chosen
            action = self._hooks.acts(turn, {agent: action}).get(agent)
            self.taken.append(_copied({agent: action}))
            self._call = "step"
            self._capture.step(action)
        self._watch_step(turn + 1, out)
        return True

    def _ask_last(self) -> None:
        """Asks for the last observation of the agent in turn where the episode is cut."""
        if self._play.asks_last and not self._is_parallel and self._capture.to_move:
            self._call = "last"
            self._capture.last()

    def _watch_step(self, turn: int, out: Any) -> None:
        self._call = "look"
        self._hooks.between(turn, self._capture.env)
        if self._watch is not None:
            self._watch(turn, self._capture.env, out)

    def _chosen_by_all(self, turn: int) -> dict[AgentId, Any]:
        capture, movers = self._capture, self._capture.to_move
        seen, infos, sees = capture.observations, capture.infos, self._hooks.sees
        if self._notes_given:
            for agent in movers:
                self._hooks.given(turn, agent, seen.get(agent), infos.get(agent))
        if self._play.actions is not None:
            script, stand_ins = self._play.actions[turn], self._play.stand_ins
            if stand_ins is not None and script.keys() != set(movers):
                known = {**stand_ins, **script}
                script = {agent: known[agent] for agent in movers if agent in known}
            is_foreign = self._play.by_place and script.keys().isdisjoint(movers)
            if is_foreign and len(script) == len(movers):
                script = dict(zip(movers, script.values(), strict=True))
            return {agent: own_action(script[agent]) for agent in script}
        return {a: self._chosen(a, sees(turn, a, seen.get(a)), infos.get(a)) for a in movers}

    def _chosen_in_turn(self, turn: int) -> tuple[AgentId, Any] | None:
        """The agent in turn and its action; None where it is alive and the plan has none."""
        self._call = "last"
        observation, _, terminated, truncated, info = self._capture.last()
        agent, has_ended = self._capture.to_move[0], terminated or truncated
        script = None if self._play.actions is None else self._play.actions[turn]
        action = next(iter((script or {}).values()), None)
        if script is not None and action is None and not has_ended:
            return None
        if self._notes_given and not has_ended:
            self._hooks.given(turn, agent, observation, info)
        if script is not None:
            return agent, own_action(action)
        if has_ended:
            return agent, None
        return agent, self._chosen(agent, self._hooks.sees(turn, agent, observation), info)

    def _chosen(self, agent: AgentId, observation: Any, info: Any) -> Any:
        assert self._joint_policy is not None, "an episode without actions needs a joint policy"
        self._call = "policy"
        return self._joint_policy.act(agent, observation, info)


def actions_of(played: Sequence[Actions]) -> tuple[Actions, ...]:
    """The actions as they can be handed over once more, whatever became of the arrays."""
    return tuple(_copied(each) for each in played)


def _copied(actions: Actions) -> dict[AgentId, Any]:
    return {agent: own_action(action) for agent, action in actions.items()}


def own_action(action: Any) -> Any:
    """A copy of an action that can be written to; what can't be written is itself."""
    return action if isinstance(action, int | float | str | np.generic) else copy.deepcopy(action)


def nothing() -> None:
    """Ignores a step."""
