"""Where a set-up is played: its environment and its policies, opened once for many episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from gamekeeper.core.canon import to_json
from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.core.outcome import Outcome
from gamekeeper.core.seeds import episode_seed
from gamekeeper.diagnose.setup import REFERENCE, Setup
from gamekeeper.errors import SpecError
from gamekeeper.game.open import open_env
from gamekeeper.record.recording import cast_of
from gamekeeper.run.change import Change
from gamekeeper.run.episode import Play, Played, perform
from gamekeeper.run.tally import tally


class Stage:
    """A set-up, ready to be played. Use as a context: it closes the environment.

    Attributes:
        opened, env: the environment.
        described: its policies, as evidence names them.
        cast: its policies.
        contract: names reward terms and volatile infos.
    """

    def __init__(self, setup: Setup, contract: Contract) -> None:
        """Opens the environment and finds the policies.

        Raises:
            SpecError: the environment can't be opened, or has no such attribute.
            PolicyError: a policy can't be found.
        """
        self.setup, self.contract = setup, contract
        self.opened = open_env(setup.spec, **setup.kwargs)
        self.env: Any = self.opened.env
        self._undo: list[Callable[[], None]] = []
        try:
            self.cast: Any = cast_of(dict(setup.policies), self.env, contract)
            agents = list(getattr(self.env, "possible_agents", ()))
            self.described = to_json(self.cast.described(agents))
            self._set()
            if setup.forgets:
                self.cast = _Forgetful(self.cast, setup.forgets)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the environment; policies are as they were."""
        for undo in reversed(self._undo):
            undo()
        self._undo = []
        self.env.close()

    def outcome(
        self, run_seed: int, episode: int, *, on_step: Callable[[], None] | None = None
    ) -> Outcome:
        """What episode number `episode` of a run comes to."""
        return tally(
            self._play(run_seed, episode), self.env, cast=self.cast, cast_seed=run_seed,
            change=self.setup.change, contract=self.contract, on_step=on_step,
        )  # fmt: skip

    def played(self, run_seed: int, episode: int, *, change: Change | None = None) -> Played:
        """The same episode with all its rows.

        Args:
            change: in place of the set-up's own.
        """
        return perform(
            self._play(run_seed, episode), self.env, cast=self.cast, cast_seed=run_seed,
            change=change or self.setup.change, contract=self.contract, number=episode,
        )  # fmt: skip

    def _play(self, run_seed: int, episode: int) -> Play:
        options = self.setup.options
        return Play(
            seed=episode_seed(run_seed, episode),
            stream=episode,
            most_turns=self.setup.most_turns,
            options=options[episode % len(options)],
        )

    def _set(self) -> None:
        for agent, settings in self.setup.settings.items():
            policy = self.cast.chosen_for(agent).policy
            self._set_all(policy, settings, f"the policy of {agent}")
        for name, value in self.setup.layers.items():
            self._set_all(_layer_with(self.env, name), {name: value}, "the wrapper")

    def _set_all(self, thing: Any, settings: Mapping[str, Any], shown: str) -> None:
        for name, value in settings.items():
            if not hasattr(thing, name):
                raise SpecError(
                    f"{shown} has no setting {name!r}",
                    where=f"knobs.{name}",
                    seen=repr(thing)[:200],
                )
            before = getattr(thing, name)
            setattr(thing, name, value)
            self._undo.append(partial(setattr, thing, name, before))


@dataclass(frozen=True, slots=True)
class Seen:
    """What of a set-up shows only once it is opened.

    Attributes:
        agents: all that may play, by name.
        has_reference: the environment brings a policy called `reference`.
        settings: values of policies' attributes that knobs name, by agent.
        layers: values of wrappers' attributes that knobs name.
        resettable: agents whose policy has a memory of its own that can be reset.
        ways: policies that the environment brings, by name.
        unfit: by change and agent, why a stressor can't be tried.
    """

    agents: tuple[str, ...]
    has_reference: bool
    settings: Mapping[str, Mapping[str, Any]]
    layers: Mapping[str, Any]
    resettable: tuple[str, ...]
    ways: tuple[str, ...]
    unfit: Mapping[tuple[str, str], str]


def seen_of(stage: Stage, stressors: Mapping[str, type[Change]]) -> Seen:
    """What an opened set-up shows."""
    env, knobs = stage.env, stage.contract.knobs
    agents = [agent_name(agent) for agent in getattr(env, "possible_agents", ())]
    names = [name for name, knob in knobs.items() if knob.of == "policy"]
    policies = {agent: stage.cast.chosen_for(agent).policy for agent in agents}
    settings = {
        agent: {n: getattr(policy, n) for n in names if hasattr(policy, n)}
        for agent, policy in policies.items()
    }
    layers: dict[str, Any] = {}
    for name, knob in knobs.items():
        layer = _layer_with(env, name) if knob.of == "wrapper" else None
        if layer is not None and hasattr(layer, name):
            layers[name] = getattr(layer, name)
    own = getattr(env.unwrapped, "policies", None)
    ways = tuple(map(str, own)) if isinstance(own, Mapping) else ()
    unfit = {
        (name, agent): why
        for name, kind in stressors.items()
        for agent in agents
        if (why := kind.applies(stage.contract, env, agent)) is not None
    }
    resettable = [
        agent for agent, policy in policies.items() if callable(getattr(policy, "reset", None))
    ]
    return Seen(
        tuple(agents), REFERENCE in ways, settings, layers, tuple(resettable), ways, unfit
    )  # fmt: skip


def _layer_with(env: Any, name: str) -> Any:
    """The outermost layer of an environment that has an attribute of its own by this name."""
    while not (name in vars(env) or hasattr(type(env), name)):
        inner = vars(env).get("env")
        if inner is None:
            return env
        env = inner
    return env


class _Forgetful:
    """A cast in which policies of some agents are reset before each of their decisions."""

    def __init__(self, cast: Any, agents: tuple[str, ...]) -> None:
        self._cast, self._agents, self._seed = cast, frozenset(agents), 0

    def begin(self, run_seed: int, episode: int) -> None:
        self._seed = episode_seed(run_seed, episode)
        self._cast.begin(run_seed, episode)

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        if agent_name(agent) in self._agents:
            self._cast.chosen_for(agent).policy.reset(seed=self._seed)
        return self._cast.act(agent, observation, info)
