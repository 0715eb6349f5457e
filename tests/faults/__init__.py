"""Faulty environments, each with one planted fault, and clean ones: checks are measured on them.

A file for each family of checks; `rovers`, `traders`, `tokens` and `lanterns` are clean, and the
others are made from them.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from gamekeeper.contract import Contract

BUDGET = 1_000


@dataclass(frozen=True, slots=True)
class Faulty:
    """A registered environment.

    Attributes:
        env: its class, which needs no argument.
        checks: ids of those that it fails; none of a clean one.
        also: ids of those that may fail beside them.
        declared: the contract that it is audited under; None where it declares none.
        budget: env steps after which its fault shows.
    """

    env: type
    checks: tuple[str, ...]
    also: tuple[str, ...]
    declared: Mapping[str, Any] | None
    budget: int

    @property
    def spec(self) -> str:
        """The environment as a user types it, in a checkout."""
        return f"{self.env.__module__}:{self.env.__name__}"

    @property
    def contract(self) -> Contract | None:
        """The declared contract, read."""
        return None if self.declared is None else Contract.from_json(self.declared)


_REGISTERED: dict[str, Faulty] = {}


def faulty(
    *checks: str,
    also: tuple[str, ...] = (),
    contract: Mapping[str, Any] | None = None,
    budget: int = BUDGET,
) -> Callable[[type], type]:
    """Registers an environment that fails these checks."""

    def register(env: type) -> type:
        known = _REGISTERED.setdefault(env.__name__, Faulty(env, checks, also, contract, budget))
        if known.env is not env:
            raise ValueError(f"two environments are called {env.__name__}")
        return env

    return register


def clean(*, contract: Mapping[str, Any] | None = None) -> Callable[[type], type]:
    """Registers an environment that passes every check."""
    return faulty(contract=contract)


@cache
def environments() -> dict[str, Faulty]:
    """All registered environments by the names of their classes."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    return dict(sorted(_REGISTERED.items()))
