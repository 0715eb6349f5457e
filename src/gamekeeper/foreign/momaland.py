"""`momaland:mobeach_v0`: a MOMAland environment, its vector rewards made into sums of terms."""

import importlib
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import AECEnv, ParallelEnv

from gamekeeper.contract import Contract
from gamekeeper.contract.sections import RewardTerm
from gamekeeper.errors import EnvError, SpecError
from gamekeeper.interface import foreign_openers
from gamekeeper.interface.construction import find_factory
from gamekeeper.interface.contract_draft import draft_contract
from gamekeeper.interface.env_source import Source, api_of

Paid: TypeAlias = dict[Any, dict[str, float]]


class Objectives:
    """A vector reward as terms: each component by its weight, and their sum the reward.

    The vector is kept: a term is a column of evidence (`reward.<objective>`), and the contract
    declares it. With the usual weights of 1 the terms are the vector itself.
    """

    __slots__ = ("names", "weights")

    def __init__(
        self, env: Any, names: Sequence[str] | None, weights: Sequence[float] | None
    ) -> None:
        """Settles names and weights from what the environment declares.

        Args:
            env: has `reward_space(agent)`.
            names: of the components, in order; None: `objective_0`, ...
            weights: by which they are summed; None: 1 each.
        Raises:
            SpecError: names or weights aren't as many as there are components.
        """
        sizes = {int(env.reward_space(agent).shape[0]) for agent in env.possible_agents}
        if len(sizes) != 1:
            raise SpecError(
                "agents have vectors of different lengths",
                where="reward_space",
                expected="one length",
                actual=", ".join(map(str, sorted(sizes))) or "no agents before the first reset",
                fix="declare objectives of equal number for all agents",
            )
        (size,) = sizes
        self.names = [f"objective_{k}" for k in range(size)] if names is None else list(names)
        self.weights = [1.0] * size if weights is None else [float(weight) for weight in weights]
        for what, given in (("objectives", self.names), ("weights", self.weights)):
            if len(given) != size:
                raise SpecError(
                    f"{what} aren't one of each component of the reward",
                    where=what,
                    expected=str(size),
                    actual=str(len(given)),
                    fix=f"give {size}, one for each component",
                )

    def terms(self, rewards: Mapping[Any, Any]) -> Paid:
        """The weighted components by agent.

        Raises:
            EnvError: a reward is no vector of the declared length.
        """
        paid: Paid = {}
        for agent, vector in rewards.items():
            values = np.ravel(np.asarray(vector, dtype=np.float64)).tolist()
            if len(values) != len(self.names):
                raise EnvError(
                    f"the reward of {agent!r} is no vector of its declared length",
                    where="rewards",
                    expected=f"{len(self.names)} components",
                    actual=repr(vector)[:200],
                    fix="return rewards of the declared length, or correct reward_space",
                )
            weighted = zip(self.names, self.weights, values, strict=True)
            paid[agent] = {name: weight * value for name, weight, value in weighted}
        return paid

    def declared(self, env: Any) -> Contract:
        """Contract of the environment as far as it is known, with a term for each component."""
        kinds = {name: RewardTerm(kind="individual") for name in self.names}
        return replace(draft_contract(env), rewards=kinds)


def _sums(paid: Paid) -> dict[Any, float]:
    return {agent: sum(terms.values(), 0.0) for agent, terms in paid.items()}


class _Weighted:
    """Part that both APIs have in common around the guest, an environment of vector rewards."""

    unknown: tuple[str, ...] = ("which agent earns a component, and whether all share it",)

    def __init__(
        self, env: Any, names: Sequence[str] | None, weights: Sequence[float] | None
    ) -> None:
        self.guest = env
        self.metadata, self.render_mode = env.metadata, getattr(env, "render_mode", None)
        self.possible_agents = list(env.possible_agents)
        self._objectives = Objectives(env, names, weights)
        self.terms: Paid = {}
        self.contract = self._objectives.declared(self)

    def observation_space(self, agent: Any) -> Space[Any]:
        """The guest's."""
        return self.guest.observation_space(agent)  # type: ignore[no-any-return]

    def action_space(self, agent: Any) -> Space[Any]:
        """The guest's."""
        return self.guest.action_space(agent)  # type: ignore[no-any-return]

    def state(self) -> Any:
        """The guest's."""
        return self.guest.state()

    def render(self) -> Any:
        """The guest's."""
        return self.guest.render()

    def close(self) -> None:
        """Closes the guest."""
        self.guest.close()


class Scalarised(_Weighted, ParallelEnv[Any, Any, Any]):
    """A Parallel environment of vector rewards, its rewards the sums of their weighted components.

    All else goes through as it is: roster, spaces, observations, ends, infos, state, rendering.
    """

    @property
    def agents(self) -> Any:
        """The live agents."""
        return self.guest.agents

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begins an episode."""
        self.terms = {}
        out = self.guest.reset(seed=seed, options=options)
        # Some of MOMAland's give observations alone, as PettingZoo's interface once was.
        return out if isinstance(out, tuple) else (out, {agent: {} for agent in self.agents})

    def step(self, actions: Any) -> Any:
        """Plays one tick; its rewards are numbers."""
        observations, rewards, *rest = self.guest.step(actions)
        self.terms = self._objectives.terms(rewards)
        return (observations, _sums(self.terms), *rest)


class ScalarisedTurns(_Weighted, AECEnv[Any, Any, Any]):
    """The same for an environment of turns: `rewards` and what `last` adds up are numbers."""

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begins an episode."""
        self.guest.reset(seed=seed, options=options)
        self._take()

    def step(self, action: Any) -> None:
        """Plays one turn."""
        self.guest.step(action)
        self._take()

    def observe(self, agent: Any) -> Any:
        """The guest's."""
        return self.guest.observe(agent)

    def _take(self) -> None:
        """Reads the guest's books, which may be new dictionaries after every turn."""
        guest = self.guest
        self.agents, self.agent_selection = guest.agents, guest.agent_selection
        self.terminations, self.truncations = guest.terminations, guest.truncations
        self.infos = guest.infos
        self.terms = self._objectives.terms(guest.rewards)
        self.rewards = _sums(self.terms)
        books = guest.unwrapped._cumulative_rewards  # a wrapper hides names with an underscore
        self._cumulative_rewards = _sums(self._objectives.terms(books))


WORD: Final = "momaland"
SYNTAX: Final = "momaland:mobeach_v0"
ORDER: Final = foreign_openers.ORDER
matches: Final = foreign_openers.begins_with(WORD)
distrust: Final = foreign_openers.distrust_packages(WORD)


def locate(spec: str, api: str | None) -> Source:
    """The environment, with its own arguments and two of ours.

    `objectives` names the components of its reward, in order (else `objective_0`, ...); `weights`
    are those by which they are summed (else 1 each).
    """
    name = foreign_openers.rest(spec, WORD) or ""
    envs = foreign_openers.need(f"{WORD}.envs")
    homes = {
        info.name.rpartition(".")[2]: info.name
        for info in pkgutil.walk_packages(envs.__path__, f"{envs.__name__}.", onerror=_passed_over)
        if info.name.rpartition("_v")[2].isdigit()
    }
    if name not in homes:
        raise foreign_openers.unknown(name, "MOMAland", list(homes))
    module = importlib.import_module(homes[name])
    factory = find_factory(module, None, api, where=homes[name]).factory

    def build(
        *,
        objectives: Sequence[str] | None = None,
        weights: Sequence[float] | None = None,
        **kwargs: Any,
    ) -> object:
        env: Any = factory(**kwargs)
        kind = Scalarised if api_of(env) == "parallel" else ScalarisedTurns
        return kind(env, objectives, weights)

    return foreign_openers.source(WORD, name, build)


def _passed_over(package: str) -> None:
    """A package of MOMAland's whose own requirements aren't installed hides no other."""
