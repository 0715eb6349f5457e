"""What a rerun can do differently: the hooks that a change may use, all of them idle unless taken.

A change is a frozen dataclass that inherits from `Change`; its fields are its parameters. `start`
gives the hooks for one play, so that nothing of one play is carried into the next.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from dataclasses import Field, dataclass, fields
from functools import cache
from types import ModuleType
from typing import Any, ClassVar, Final, Literal

from numpy.random import Generator

from gamekeeper import plugins
from gamekeeper.core import canon
from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.errors import EvidenceError
from gamekeeper.game.door import AgentId

GROUP: Final = "gamekeeper.changes"
"""Entry points of third parties' changes: each names a class, or a module with some."""
PACKAGE: Final = "gamekeeper.run.changes"


class Hooks:
    """What is done in one play, beside what would be done anyway; every method may be replaced.

    Attributes:
        wants_given: `given` is called; it costs a call for each agent and turn.
    """

    wants_given: bool = False

    def declared(self, contract: Contract) -> None:
        """What is declared of the game; told once, before anything else."""

    def before_reset(self, env: Any) -> None:
        """Before the reset."""

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        """What a live agent that acts now was given, its mask among it; before `acts`.

        Also where the actions stand on paper. Only where `wants_given`.
        """

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """The actions of a turn in place of `actions`, one of an AEC environment's agent in turn.

        A dead agent's None stands in it too. The dictionary is the hooks' own, its values are not.
        """
        return actions

    def sees(self, turn: int, agent: AgentId, observation: Any) -> Any:
        """What a policy is shown in place of `observation`; the evidence keeps what was given."""
        return observation

    def between(self, turn: int, env: Any) -> None:
        """After the reset (turn 0) and after every crossing, before anybody chooses."""

    def after(self, env: Any) -> None:
        """Once the play is over; also where it broke off."""


@dataclass(frozen=True, slots=True)
class Change:
    """Exactly one thing done differently.

    Attributes:
        label: what failing under it is called; None: it has nothing to do with a failure.
        kind: a `stressor` makes one thing worse, a `remedy` makes one thing ideal.
    """

    label: ClassVar[Label | None] = None
    kind: ClassVar[Literal["stressor", "remedy"] | None] = None

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play.

        Args:
            rng: the change's own stream; equal for equal plays.
        """
        raise NotImplementedError

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Why it can't be tried on an agent of `env`; None where it can."""
        return None

    def to_json(self) -> dict[str, Any]:
        """Plain data: its kind under `change`, and its parameters."""
        named = {each.name: _written(each, getattr(self, each.name)) for each in fields(self)}
        return {"change": type(self).__name__, **named}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Change:
        """The change that `to_json` told of.

        Raises:
            EvidenceError: there is no such change, or it hasn't these parameters.
        """
        known, name = _known(), data.get("change")
        if name not in known:
            raise EvidenceError(
                f"there is no change called {name!r}",
                where="change",
                expected=", ".join(sorted(known)),
                seen=repr(name),
                mend="install the package that brings it",
            )
        kinds = {each.name: each for each in fields(known[name])}
        given = {key: value for key, value in data.items() if key != "change"}
        if not set(given) <= set(kinds):
            raise EvidenceError(
                f"the change {name} hasn't these parameters",
                where="change",
                expected=", ".join(kinds) or "none",
                seen=", ".join(given),
            )
        return known[name](**{key: _read(kinds[key], value) for key, value in given.items()})


def changes() -> dict[str, type[Change]]:
    """Every change by its name: those that Gamekeeper brings, and those of installed packages."""
    return dict(_known())


@cache  # looking for installed packages takes 10 ms, and every arm of an experiment is read
def _known() -> dict[str, type[Change]]:
    found: dict[str, type[Change]] = {}
    for part in plugins.load(GROUP, PACKAGE).found.values():
        own = vars(part).values() if isinstance(part, ModuleType) else [part]
        for each in own:
            if not inspect.isclass(each) or not issubclass(each, Change):
                continue
            if each.start is not Change.start:  # else it is a base of others
                found.setdefault(each.__name__, each)
    return dict(sorted(found.items()))


def _written(field: Field[Any], value: Any) -> Any:
    """A parameter as plain JSON; a field that is a tuple anyway is a list there."""
    if _is_tuple(field) and isinstance(value, tuple | list):
        return [json.loads(canon.to_json(each)) for each in value]
    return json.loads(canon.to_json(value))


def _read(field: Field[Any], value: Any) -> Any:
    if _is_tuple(field) and isinstance(value, tuple | list):
        return tuple(canon.from_json(json.dumps(each)) for each in value)
    return canon.from_json(json.dumps(value))


def _is_tuple(field: Field[Any]) -> bool:
    return str(field.type).startswith("tuple[")
