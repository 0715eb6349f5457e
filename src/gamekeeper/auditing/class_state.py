"""State that classes and modules of an environment keep, and that its instances share."""

import contextlib
import contextvars
import copy
import inspect
import random
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np


def kept_by_classes(env: Any) -> Iterator[tuple[Any, str, Any]]:
    """Values that classes of an environment and its wrappers keep: owner, attribute, value.

    Generators of the modules of its package are among them, by the module's name.
    """
    dice = np.random.Generator, np.random.RandomState, random.Random
    kinds = dict, list, set, np.ndarray, *dice
    packages = {cls.__module__.partition(".")[0] for cls in type(env).__mro__}
    while env is not None:
        for cls in type(env).__mro__:
            for name, value in list(vars(cls).items()):
                if inspect.isfunction(value):
                    if any(isinstance(each, kinds) for each in value.__defaults__ or ()):
                        yield value, "__defaults__", value.__defaults__
                elif isinstance(value, kinds) and not name.startswith("__"):
                    yield cls, name, value
        inside = getattr(env, "__dict__", {})
        env = next((inside[name] for name in ("env", "aec_env", "par_env") if name in inside), None)
    for module in [each for each in list(sys.modules) if each.partition(".")[0] in packages]:
        for name, value in list(vars(sys.modules[module]).items()):
            held = value.get(None) if isinstance(value, contextvars.ContextVar) else value
            if isinstance(held, dice):
                yield module, name, held


def put_back(owner: Any, name: str, value: Any) -> None:
    """Gives a class, a function or the module of that name its value again."""
    owner = sys.modules[owner] if isinstance(owner, str) else owner
    held = getattr(owner, name)
    if isinstance(held, contextvars.ContextVar):
        held.set(value)
    else:
        setattr(owner, name, value)


class ClassState:
    """State of an environment's and its wrappers' classes and modules before any play."""

    __slots__ = ("_values",)

    def __init__(self, env: Any) -> None:
        self._values: list[tuple[Any, str, Any]] = []
        for owner, name, value in kept_by_classes(env):
            with contextlib.suppress(Exception):  # what can't be copied stays as it is
                self._values.append((owner, name, copy.deepcopy(value)))

    def restore(self) -> None:
        """Puts copies of it back."""
        for owner, name, value in self._values:
            put_back(owner, name, copy.deepcopy(value))
