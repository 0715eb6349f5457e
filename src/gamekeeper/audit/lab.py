"""Where a probe works: instances of the environment, plays in them, and a count of what it costs.

A probe is a module in `audit/probes/` (or an entry point of `gamekeeper.probes`) with

    SHARE: how much of the budget it gets, beside the shares of the others
    look(lab, play): yields a `Fact`, `Twin` or `Trace` for all that it saw in one play
    plays(lab): optional; the plays to look at, `lab.plays(3, runs=2)` unless told
    API, FRESH: optional; only for this API; only where more than one instance can be had
    against(lab): optional; why it can't look here, or None
    TRIES: optional; how many shorter plays are tried for one finding, where a look is dear

`look` is asked again with shorter plays (their actions on paper) to find the shortest way to see
something again, so it may depend on nothing but its play.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Final, Protocol, TypeAlias, runtime_checkable

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.agent_spec import AgentSpec
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Twin
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import Trace
from gamekeeper.core.where import Where
from gamekeeper.game.capture.oddity import type_name_of
from gamekeeper.game.open import Opened, open_env
from gamekeeper.game.policy import Chosen, resolve
from gamekeeper.record.recording import cast_of
from gamekeeper.run.change import Change
from gamekeeper.run.episode import Failed, Play, Played, Stopped, Watch, perform
from gamekeeper.run.global_generators import held
from gamekeeper.waiting import own_s

Saw: TypeAlias = Fact | Twin | Trace

LEAST_TURNS: Final = 20
"""A play shorter than this shows too little."""
RESET_STEPS: Final = 1
"""What a reset counts in the budget, in steps."""


@runtime_checkable
class Probe(Protocol):
    """A schedule of plays that lets promises be seen to hold or break."""

    SHARE: float

    def look(self, lab: Lab, play: Play, /) -> Iterator[Saw]:
        """What one play came to."""


@dataclass(slots=True)
class Meter:
    """Counts steps of the environment, and stops everything when its time is up.

    Attributes:
        deadline_s: of `waiting.own_s`, as what is compiled first says nothing of the environment;
            None: there is none.
        steps: taken so far.
        beat: called at each count, as a sign of life.
    """

    deadline_s: float | None = None
    steps: int = 0
    beat: Callable[[], None] | None = None

    def count(self, steps: int = 1) -> None:
        """Counts; raises `Stopped` once the time is up."""
        self.steps += steps
        if self.beat is not None:
            self.beat()
        if self.deadline_s is not None and own_s() > self.deadline_s:
            raise Stopped


@dataclass(frozen=True, slots=True)
class Called:
    """What a call into the environment came to: a value, or what it raised."""

    value: Any = None
    failed: Failed | None = None


@dataclass(slots=True)
class Lab:
    """One probe's bench.

    Attributes:
        probe: its name.
        api: `aec` or `parallel`.
        contract: declared; an empty one where nothing is.
        agents: what is known of each possible agent before the first reset.
        seed: play k is reset with `seed + k`; one above the audit's, as 0 is easily taken for no
            seed: that is for a probe of its own to see, and no other probe's noise.
        ration: environment steps that the probe may take in all.
        number: of the play in hand.
        base: the first play of the look, with its actions, once it was played.
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
    base: Play | None = None
    _made: list[Any] = field(default_factory=list)

    @property
    def can_make(self) -> bool:
        """Whether more than the one instance that was handed over can be had."""
        return self.opened.make is not None

    def env(self) -> Any:
        """A fresh instance where one can be had, else the only one."""
        return self.make() if self.can_make else self.opened.env

    def make(self, **kwargs: Any) -> Any:
        """A fresh instance, closed after the look; `kwargs` on top of the user's own.

        Raises:
            SpecError: it can't be built (with these arguments), or only an object is there.
        """
        if self.opened.make is None:
            env = open_env(self.spec, **{**self.kwargs, **kwargs}).env
        else:
            env = self.opened.make(**kwargs)
        self._made.append(env)
        return env

    def close(self) -> None:
        """Closes the instances of the look."""
        made, self._made = self._made, []
        for env in made:
            self.call("close", env.close)

    def plays(self, count: int, *, runs: int = 1, most_turns: int = 1000) -> Iterator[Play]:
        """`count` plays from seeds in a row, each played `runs` times within the ration."""
        turns = max(self.ration // max(count * runs, 1), LEAST_TURNS)
        for k in range(count):
            yield Play(seed=self.seed + k, stream=k, most_turns=min(turns, most_turns))

    def long_plays(self, count: int, *, runs: int = 1, most_turns: int = 1000) -> Iterator[Play]:
        """Up to `count` plays of which the first may take the whole ration, `runs` times over.

        So what only happens late in an episode is seen too. Later ones are for what those before
        left, where they ended early.
        """
        begun = self.meter.steps
        for k in range(count):
            left = self.ration - (self.meter.steps - begun)
            turns = max(left // runs, LEAST_TURNS)
            yield Play(seed=self.seed + k, stream=k, most_turns=min(turns, most_turns))

    def play(
        self,
        play: Play,
        env: Any = None,
        *,
        change: Change | None = None,
        watch: Watch | None = None,
        state: bool = True,
        hold: bool = True,
    ) -> Played:
        """Plays in `env` (a fresh instance if None), with random legal actions or those on paper.

        The generators of the whole process start from one seed unless `hold` is False, so that who
        draws from them makes no difference between a play, its sham and its twin.

        The first play of a look is its `base`: its actions are what a reader plays again.
        """
        env = self.env() if env is None else env
        self.meter.count(RESET_STEPS)
        with held() if hold else nullcontext():
            played = perform(
                play, env,
                cast=None if play.actions is not None else cast_of(_random(), env, self.contract),
                cast_seed=self.seed, change=change, contract=self.contract,
                identity=self.opened.identity, label=self.probe, number=self.number, state=state,
                watch=watch, on_step=self.meter.count,
            )  # fmt: skip
        if self.base is None:
            self.base = played.play
        return played

    def twin(
        self, base: Played, sham: Played, change: Change, env: Any = None, **options: Any
    ) -> Twin:
        """The base's actions played again with one change, beside its sham."""
        twin = self.play(base.play, env, change=change, **options)
        return Twin(
            base.trace, sham.trace, twin.trace, change.to_json(),
            tuple(self.contract.volatile_infos()),
        )  # fmt: skip

    def call(
        self, name: str, function: Callable[..., Any], *arguments: Any, **named: Any
    ) -> Called:
        """Calls into the environment; what it raises is data."""
        try:
            return Called(function(*arguments, **named))
        except (KeyboardInterrupt, Stopped):
            raise
        except BaseException as error:  # whatever foreign code raises is evidence
            text = "".join(traceback.format_exception(error, limit=-12))
            kind = type_name_of(type(error))
            return Called(failed=Failed(name, 0, kind, str(error)[:500], text))

    def step(self, env: Any, actions: Any) -> Called:
        """A counted step, for probes with a loop of their own."""
        self.meter.count()
        return self.call("step", env.step, actions)

    def at(self, turn: int | None = None, agent: Any = None, field: str = "") -> Where:
        """A place in the play in hand."""
        return Where(
            self.probe, self.number, turn, None if agent is None else agent_name(agent), field
        )

    def fact(
        self,
        name: str,
        value: Any,
        *,
        turn: int | None = None,
        agent: Any = None,
        field: str = "",
        **more: Any,
    ) -> Fact:
        """A fact of the play in hand; `more` as in `Fact`."""
        return Fact(name, self.at(turn, agent, field), value, **more)

    def paper(self, play: Play, actions: list[Mapping[Any, Any]]) -> None:
        """Notes what was played, where a probe has a loop of its own."""
        if self.base is None:
            self.base = replace(play, actions=tuple(actions), most_turns=max(len(actions), 1))

    def for_probe(self, probe: str, ration: int) -> Lab:
        """The same lab for another probe."""
        return replace(self, probe=probe, ration=ration, number=0, base=None, _made=[])


@cache
def _random() -> Chosen:
    """The policy of every play, looked up once: that asks all distributions that are installed."""
    return resolve("random")
