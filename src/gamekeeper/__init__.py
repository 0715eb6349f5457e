"""Gamekeeper keeps multi-agent environments honest; `import gamekeeper as gk` for its public names.

Names load when they are first used: the import itself brings neither numpy nor anything heavier.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from gamekeeper import vector
    from gamekeeper.adapters.page import report
    from gamekeeper.audit.front import audit
    from gamekeeper.core.contract import Contract
    from gamekeeper.diagnose.attribution.attribute import attribute
    from gamekeeper.diagnose.diagnose import diagnose
    from gamekeeper.evaluate.evaluate import evaluate
    from gamekeeper.game.opening.opened import Env
    from gamekeeper.game.tick_env import TickEnv
    from gamekeeper.game.to_aec import to_aec
    from gamekeeper.game.to_parallel import to_parallel
    from gamekeeper.game.turn_env import TurnEnv
    from gamekeeper.record.bundle import load
    from gamekeeper.record.diff import diff
    from gamekeeper.record.recording import record, rollout
    from gamekeeper.record.replay import replay

__version__ = "0.1.0"
__all__ = [
    "Contract",
    "TickEnv",
    "TurnEnv",
    "attribute",
    "audit",
    "diagnose",
    "diff",
    "draft_contract",
    "evaluate",
    "load",
    "make",
    "record",
    "replay",
    "report",
    "rollout",
    "to_aec",
    "to_parallel",
    "vector",
]

_HOMES: Final = {
    "Contract": "gamekeeper.game.contract_file",  # importing it gives Contract its `load`
    "TickEnv": "gamekeeper.game.tick_env",
    "TurnEnv": "gamekeeper.game.turn_env",
    "attribute": "gamekeeper.diagnose.attribution.attribute",
    "audit": "gamekeeper.audit.front",
    "diagnose": "gamekeeper.diagnose.diagnose",
    "diff": "gamekeeper.record.diff",
    "evaluate": "gamekeeper.evaluate.evaluate",
    "load": "gamekeeper.record.bundle",
    "record": "gamekeeper.record.recording",
    "replay": "gamekeeper.record.replay",
    "report": "gamekeeper.adapters.page",
    "rollout": "gamekeeper.record.recording",
    "to_aec": "gamekeeper.game.to_aec",
    "to_parallel": "gamekeeper.game.to_parallel",
}
"""The module that holds a name which loads when it is first used."""
_ROOMS: Final = ("vector",)
"""Rooms that are public as they are: `gk.vector.make`."""


def make(spec: object, /, *, slim: bool = True, **kwargs: Any) -> Env:
    """A live AECEnv or ParallelEnv from an id, `module:factory`, `file.py:factory` or a factory.

    `parallel:` or `aec:` in front of a text asks for an API. Where PettingZoo's own wrappers and
    converters stand around the rules, one face with the same promises takes their place and is
    faster; `gamekeeper show ENV` says what is replaced.

    Args:
        spec: what to open.
        slim: False: as it ships.
        **kwargs: handed to the factory.
    Raises:
        SpecError: nothing can be opened under that name; says what was looked for.
    """
    from gamekeeper.game.converting import slim as slimming
    from gamekeeper.game.open import open_env
    from gamekeeper.game.opening.origins import remember

    opened = open_env(spec, **kwargs)
    env = slimming.slim(opened.env) if slim else opened.env
    remember(env, opened.identity)
    return env


def draft_contract(spec: object, /, **kwargs: Any) -> Contract:
    """The contract as far as the environment shows it before its first step.

    What stays undeclared, `gamekeeper contract ENV` asks for by name.

    Args:
        spec: what to open; an environment object stays open.
        **kwargs: handed to the factory.
    Raises:
        SpecError: nothing can be opened under that name.
    """
    from gamekeeper.game import draft
    from gamekeeper.game.open import open_env

    opened = open_env(spec, **kwargs)
    try:
        return draft.draft_contract(opened.env)
    finally:
        if opened.make is not None:
            opened.env.close()


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    # A room of that name stands here already, put by the import above: it is called in its place.
    return globals().setdefault(name, value)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


class _Room(ModuleType):
    """A package that bears the name of a public function, and is that function when called."""

    @property
    def _function(self) -> Any:
        name = self.__name__.rpartition(".")[2]
        return getattr(importlib.import_module(_HOMES[name]), name)

    @property
    def __signature__(self) -> Any:
        import inspect

        return inspect.signature(self._function)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._function(*arguments, **options)


class _Front(ModuleType):
    """This module; a package inside it that is put where a function is expected can be called.

    Importing `gamekeeper.record.bundle` sets the attribute `record` here, over any function of
    that name: `gk.record(env, path)` must work whatever was imported before.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name in _HOMES and type(value) is ModuleType:
            value.__class__ = _Room
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Front
