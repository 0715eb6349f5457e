"""Interventions: what a rerun can do differently, by hooks that are all idle unless taken.

An intervention is a frozen dataclass that inherits from `Intervention`; its fields are its
parameters. `start` gives the hooks for one episode, so that nothing of one episode is carried on.
"""

from __future__ import annotations

import inspect
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import Field, dataclass, fields
from functools import cache
from types import ModuleType
from typing import Any, ClassVar, Final, Literal

from numpy.random import Generator

from gamekeeper import plugins
from gamekeeper.contract import Contract
from gamekeeper.episodes import canonical
from gamekeeper.episodes.outcome import Label
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.capture import AgentId

GROUP: Final = "gamekeeper.interventions"
"""Entry points of third parties' interventions: each names a class, or a module with some."""
PACKAGE: Final = "gamekeeper.rollouts.interventions"


class Hooks:
    """Hooks of one intervention into one episode; every method may be replaced.

    Attributes:
        wants_given: `given` is called; it costs a call for each agent and turn.
    """

    wants_given: bool = False

    def declared(self, contract: Contract) -> None:
        """Takes what is declared of the game; called once, before anything else."""

    def before_reset(self, env: Any) -> None:
        """Before the reset."""

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        """Takes the observation and mask of a live agent that acts now; called before `acts`.

        Also where the actions are scripted. Only where `wants_given`.
        """

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """The actions of a turn in place of `actions`, one of an AEC environment's agent in turn.

        A dead agent's None stands in it too. The dictionary is the hooks' own, its values are not.
        """
        return actions

    def sees(self, turn: int, agent: AgentId, observation: Any) -> Any:
        """Observation that a policy sees in place of `observation`; evidence keeps the true one."""
        return observation

    def between(self, turn: int, env: Any) -> None:
        """After the reset (turn 0) and after every step, before anybody chooses."""

    def after(self, env: Any) -> None:
        """Once the episode is over; also where it broke off."""


class PlacedHooks(Hooks):
    """Hooks that keep the contract, and the environment for the spaces of its agents."""

    def __init__(self) -> None:
        self.contract, self.env = Contract(), None

    def declared(self, contract: Contract) -> None:
        """Keeps the contract."""
        self.contract = contract

    def before_reset(self, env: Any) -> None:
        """Keeps the environment."""
        self.env = env


@dataclass(frozen=True, slots=True)
class Intervention(ABC):
    """Exactly one thing done differently.

    Attributes:
        label: what failing under it is called; None: it has nothing to do with a failure.
        kind: a `perturbation` makes one thing worse, an `ideal` substitute makes it ideal.
    """

    label: ClassVar[Label | None] = None
    kind: ClassVar[Literal["perturbation", "ideal"] | None] = None

    @abstractmethod
    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode.

        Args:
            rng: the intervention's own stream; equal for equal plays.
        """

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Reason why it can't be tried on an agent of `env`; None where it can."""
        return None

    def to_json(self) -> dict[str, Any]:
        """Plain data: its class under `change`, and its parameters."""
        named = {each.name: _written(each, getattr(self, each.name)) for each in fields(self)}
        return {"change": type(self).__name__, **named}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Intervention:
        """The intervention that `to_json` wrote.

        Raises:
            EvidenceError: there is no such intervention, or it hasn't these parameters.
        """
        known, name = _known(), data.get("change")
        if name not in known:
            raise EvidenceError(
                f"there is no intervention called {name!r}",
                where="intervention",
                expected=", ".join(sorted(known)),
                actual=repr(name),
                fix="install the package that brings it",
            )
        kinds = {each.name: each for each in fields(known[name])}
        given = {key: value for key, value in data.items() if key != "change"}
        if not set(given) <= set(kinds):
            raise EvidenceError(
                f"the intervention {name} hasn't these parameters",
                where="intervention",
                expected=", ".join(kinds) or "none",
                actual=", ".join(given),
                fix="leave out what isn't among these",
            )
        return known[name](**{key: _read(kinds[key], value) for key, value in given.items()})


def interventions() -> dict[str, type[Intervention]]:
    """Interventions by their names: Gamekeeper's own, and those of installed packages."""
    return dict(_known())


@cache  # looking for installed packages takes 10 ms, and every arm of an experiment is read
def _known() -> dict[str, type[Intervention]]:
    found: dict[str, type[Intervention]] = {}
    for part in plugins.load(GROUP, PACKAGE).found.values():
        own = vars(part).values() if isinstance(part, ModuleType) else [part]
        for each in own:
            if not inspect.isclass(each) or not issubclass(each, Intervention):
                continue
            if not inspect.isabstract(each):  # else it is a base of others
                found.setdefault(each.__name__, each)
    return dict(sorted(found.items()))


def _written(field: Field[Any], value: Any) -> Any:
    """A parameter as plain JSON; a field that is a tuple anyway is a list there."""
    if _is_tuple(field) and isinstance(value, tuple | list):
        return [json.loads(canonical.to_json(each)) for each in value]
    return json.loads(canonical.to_json(value))


def _read(field: Field[Any], value: Any) -> Any:
    if _is_tuple(field) and isinstance(value, tuple | list):
        return tuple(canonical.from_json(json.dumps(each)) for each in value)
    return canonical.from_json(json.dumps(value))


def _is_tuple(field: Field[Any]) -> bool:
    return str(field.type).startswith("tuple[")
