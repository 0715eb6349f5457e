"""A probe's place of work: instances of the environment, plays in them, and a count of steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Final, TypeAlias

from gamekeeper.auditing.agent_places import actions_by_place
from gamekeeper.auditing.class_state import ClassState
from gamekeeper.auditing.holds import Hold
from gamekeeper.auditing.readings import AS_IT_IS, through
from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.probe_evidence import Fact, Kind, ProbeCounterfactual
from gamekeeper.contract import Contract
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.episodes.divergence import Divergence, compare
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.exception_text import message, traceback_text
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.where import Where
from gamekeeper.interface.contract_draft import spaces_of
from gamekeeper.interface.opening import Opened, open_env
from gamekeeper.interface.packing import type_name_of
from gamekeeper.interface.policy import Chosen, resolve
from gamekeeper.rollouts.episode_loop import (
    ActionChooser,
    EpisodeHaltError,
    EpisodePlan,
    EpisodeResult,
    EvidenceOptions,
    FailedCall,
    StepHook,
    perform,
)
from gamekeeper.rollouts.intervention import Intervention
from gamekeeper.rollouts.process_randomness import held
from gamekeeper.rollouts.warm_worker import WarmWorker
from gamekeeper.runs.recording import joint_policy_of

Saw: TypeAlias = Fact[Any] | ProbeCounterfactual | Episode

Steering: TypeAlias = Callable[[ActionChooser, Any], ActionChooser]
"""From the random policies and the environment to the policies that play."""

LEAST_TURNS: Final = 20
"""An episode shorter than this shows too little."""
RESET_STEPS: Final = 1
"""Cost of a reset in the budget, in steps."""


class TimeUpError(EpisodeHaltError):
    """The time of an audit is over; environments that catch every Exception don't catch it."""


@dataclass(slots=True)
class Meter:
    """Counts steps of the environment.

    Attributes:
        beat: called at each count, as a sign of life.
        until_s: time of the monotonic clock at which the probes end; None: no such time.
        has_played: a step of an episode returned.
        has_begun: a reset gave an observation.
        has_seen: a step of one of them gave an observation or a reward.
    """

    steps: int = 0
    beat: Callable[[], None] | None = None
    until_s: float | None = None
    has_played: bool = False
    has_begun: bool = False
    has_seen: bool = False

    def count(self, steps: int = 1) -> None:
        """Counts so many more.

        Raises:
            TimeUpError: the time is over.
        """
        self.steps += steps
        if self.beat is not None:
            self.beat()
        if self.until_s is not None and time.monotonic() > self.until_s:
            raise TimeUpError


@dataclass(frozen=True, slots=True)
class Called:
    """Result of a call into the environment: a value, or its exception."""

    value: Any = None
    failed: FailedCall | None = None

    @property
    def said(self) -> str | None:
        """The exception in words; None where there was none."""
        return None if self.failed is None else self.failed.said


@dataclass(slots=True)
class ProbeSession:
    """One probe's session.

    Attributes:
        api: `aec` or `parallel`.
        contract: declared; an empty one where nothing is.
        agents: what is known of each possible agent before the first reset.
        seed: play k is reset with `seed + k`; one above the audit's, as 0 is easily taken for no
            seed: that is for a probe of its own to see, and no other probe's noise.
        ration: environment steps that the probe may take in all.
        base: the first episode of the look, with its actions, once it was played.
        holds_entropy: plays differ by themselves, by generators that nobody seeded: the system's
            entropy is held still, so that other faults can be seen.
        class_state: plays differ since instances share it; put back before each episode and
            instance.
        workers: processes that play elsewhere, by their hash seed; all probes share them.
        unlike: the first episode that another probe saw differ in an instance that had played it;
            all probes share it.
        raised: the first episode of legal actions that another probe than rollouts saw raise; all
            probes share it.
        by_place: agents are no values, so that scripted actions find them by their place alone.
        readings: of an environment that has another form than the API's.
    """

    probe: str
    opened: Opened
    spec: object
    kwargs: Mapping[str, Any]
    api: str
    contract: Contract
    agents: Mapping[str, AgentSpec]
    seed: int
    ration: int
    meter: Meter = field(default_factory=Meter)
    number: int = 0
    base: EpisodePlan | None = None
    holds_entropy: bool = False
    class_state: ClassState | None = None
    workers: dict[int, WarmWorker] = field(default_factory=dict)
    unlike: list[EpisodePlan] = field(default_factory=list)
    raised: list[EpisodePlan] = field(default_factory=list)
    by_place: bool = False
    readings: tuple[Hold, ...] = ()
    _made: list[Any] = field(default_factory=list)

    @property
    def can_make(self) -> bool:
        """Tells whether more than the one instance that was handed over can be had."""
        return self.opened.make is not None

    def env(self) -> Any:
        """A fresh instance where one can be had, else the only one."""
        return self.make() if self.can_make else self.opened.env

    def make(self, **kwargs: Any) -> Any:
        """A fresh instance, closed after the look; `kwargs` on top of the user's own.

        Raises:
            SpecError: it can't be built (with these arguments), or only an object is there.
        """
        if self.class_state is not None:
            self.class_state.restore()
        if self.opened.make is None:
            built = open_env(self.spec, **{**self.kwargs, **kwargs}).env
        else:
            built = self.opened.make(**kwargs)
        env = through(lambda: built, self.readings_for(self.probe))()
        env = actions_by_place(lambda: env)() if self.by_place else env
        self._made.append(env)
        return env

    def readings_for(self, probe: str) -> tuple[Hold, ...]:
        """Readings of a probe's; none where it looks at the form itself."""
        return () if probe in AS_IT_IS else self.readings

    def close(self) -> None:
        """Closes the instances of the look."""
        made, self._made = self._made, []
        for env in made:
            self.call("close", env.close)

    def plays(self, count: int, *, runs: int = 1, most_turns: int = 1000) -> Iterator[EpisodePlan]:
        """`count` plays from seeds in a row, each played `runs` times within the ration."""
        turns = max(self.ration // max(count * runs, 1), LEAST_TURNS)
        return self.plays_of([min(turns, most_turns)] * count)

    def plays_of(self, lengths: Iterable[int]) -> Iterator[EpisodePlan]:
        """Plays from seeds in a row, of these lengths in turns."""
        for k, turns in enumerate(lengths):
            yield EpisodePlan(seed=self.seed + k, stream=k, most_turns=turns)

    def long_plays(
        self, count: int, *, runs: int = 1, most_turns: int = 1000
    ) -> Iterator[EpisodePlan]:
        """Up to `count` plays of which the first may take the whole ration, `runs` times over.

        So what only happens late in an episode is seen too. Later ones are for what those before
        left, where they ended early.
        """
        begun = self.meter.steps
        for k in range(count):
            left = self.ration - (self.meter.steps - begun)
            turns = max(left // runs, LEAST_TURNS)
            yield EpisodePlan(seed=self.seed + k, stream=k, most_turns=min(turns, most_turns))

    def play(
        self,
        play: EpisodePlan,
        env: Any = None,
        *,
        change: Intervention | None = None,
        watch: StepHook | None = None,
        state: bool = True,
        hold: bool = True,
        steer: Steering | None = None,
    ) -> EpisodeResult:
        """Plays in `env` (a fresh instance if None), with random legal actions or scripted ones.

        The generators of the whole process start from one seed unless `hold` is False, so that who
        draws from them makes no difference between an episode, its unchanged rerun and its
        counterfactual.

        `steer` makes of the random policies those that choose in their place.

        The first episode of a look is its `base`: its actions are what a reader plays again. It may
        be cut by the end of the time, another one isn't given back then.

        Raises:
            TimeUpError: the time is over.
        """
        if self.class_state is not None:
            self.class_state.restore()
        env = self.env() if env is None else env
        self.meter.count(RESET_STEPS)
        joint_policy: ActionChooser | None = None
        if play.actions is None:
            joint_policy = joint_policy_of(_random(), env, self.contract)
            joint_policy = joint_policy if steer is None else steer(joint_policy, env)
        with held() if hold else nullcontext():
            played = perform(
                replace(play, by_place=self.by_place),
                env,
                joint_policy=joint_policy,
                policy_seed=self.seed,
                change=change,
                contract=self.contract,
                keep=EvidenceOptions(label=self.probe, number=self.number, state=state),
                watch=watch,
                on_step=self.meter.count,
            )
        first, *_ = played.episode.turns or (None,)
        self.meter.has_begun = self.meter.has_begun or bool(
            first is not None and first.observations
        )
        self.meter.has_played = self.meter.has_played or len(played.episode.turns) > 1
        self.meter.has_seen = self.meter.has_seen or any(
            turn.rewards or (place and turn.observations)
            for place, turn in enumerate(played.episode.turns)
        )
        if self.base is None:
            self.base = played.play
        else:
            self.meter.count(0)  # what the time has cut is no rerun
        return played

    def after(self, before: EpisodePlan, play: EpisodePlan, times: int = 1) -> EpisodeResult:
        """Plays in an instance in which another episode was played before, so many times."""
        with held():
            env = self.env()
        for _ in range(times):
            self.play(before, env)
        return self.play(play, env)

    def counterfactual(
        self,
        base: EpisodeResult,
        unchanged_rerun: EpisodeResult,
        change: Intervention,
        env: Any = None,
        **options: Any,
    ) -> ProbeCounterfactual:
        """The base's actions played again with one change, beside its unchanged rerun."""
        changed = self.play(base.play, env, change=change, **options)
        return self.beside(base.episode, unchanged_rerun.episode, changed.episode, change.to_json())

    def beside(
        self, base: Episode, unchanged_rerun: Episode, changed: Episode, change: Mapping[str, Any]
    ) -> ProbeCounterfactual:
        """Episodes of an episode: as it was, once more with nothing changed, and with a change."""
        volatile = tuple(self.contract.volatile_infos())
        return ProbeCounterfactual(base, unchanged_rerun, changed, change, volatile)

    def divergence(self, one: Episode, two: Episode) -> Divergence | None:
        """The first divergence of two episodes, in anything but volatile infos."""
        return compare(one, two, volatile=self.contract.volatile_infos()).divergence

    def fresh(self, play: EpisodePlan, **options: Any) -> EpisodeResult:
        """Plays in an instance that is built, too, while the process's generators are held."""
        with held():
            return self.play(play, self.env(), **options)

    def call(
        self, name: str, function: Callable[..., Any], *arguments: Any, **named: Any
    ) -> Called:
        """Calls into the environment; what it raises is data."""
        try:
            return Called(function(*arguments, **named))
        except (KeyboardInterrupt, TimeUpError):
            raise
        except BaseException as error:  # whatever foreign code raises is evidence
            text = traceback_text(error, limit=-12)
            kind = type_name_of(type(error))
            return Called(failed=FailedCall(name, 0, kind, message(error)[:500], text))

    def reset(self, env: Any, play: EpisodePlan) -> Called:
        """A reset with the play's seed and options, for probes with a loop of their own."""
        options = None if play.options is None else dict(play.options)
        given = {"seed": play.seed, "options": options}
        return self.call("reset", env.reset, **{k: v for k, v in given.items() if v is not None})

    def step(self, env: Any, actions: Any) -> Called:
        """A counted step, for probes with a loop of their own."""
        self.meter.count()
        return self.call("step", env.step, actions)

    def at(self, turn: int | None = None, agent: Any = None, field: str = "") -> Where:
        """A place in the episode in hand."""
        return Where(
            self.probe, self.number, turn, None if agent is None else agent_name(agent), field
        )

    def fact(
        self,
        value: Kind,
        *,
        turn: int | None = None,
        agent: Any = None,
        field: str = "",
        proof: Reproducer | None = None,
    ) -> Fact[Kind]:
        """A fact of the episode in hand."""
        return Fact(self.at(turn, agent, field), value, proof)

    def space_of(self, agent: Any) -> Any:
        """The action space of an agent, as it is known before the first reset; None without one."""
        spec = self.agents.get(agent_name(agent))
        return spaces_of(self.opened.env, agent)[1] if spec is None else spec.action_space

    def handed(self, actions: Mapping[Any, Any]) -> Any:
        """The actions of a turn as `step` takes them: in an AEC environment the only one."""
        return actions if self.api == "parallel" else next(iter(actions.values()), None)

    def for_probe(self, probe: str, ration: int) -> ProbeSession:
        """The same session for another probe."""
        return replace(self, probe=probe, ration=ration, number=0, base=None, _made=[])


@cache
def _random() -> Chosen:
    """The policy of every episode, looked up once, as that asks all installed distributions."""
    return resolve("random")
