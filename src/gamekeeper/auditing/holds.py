"""Causes held still, by Python that stands at the head of a reproducer.

Each function takes the `make` of a reproducer and returns one that builds the same environment with
one cause held still. Its source stands at the head of the program, so it names nothing of ours.
"""

from __future__ import annotations

import copy
import gc
import inspect
import random
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from gamekeeper.checks.reproducer_source import text_of

MAKE: Final = "\ndef make():\n"
"""The line before which a reproducer's imports stand, and after which its environment is built."""
SEED: Final = "\nSEED = "
"""The line after `make`, before which it is replaced."""


def with_class(env: Any, **methods: Any) -> Any:
    """The environment, its class replaced by one with these methods in front of its own."""
    cls = type(env)
    held = type(f"Held{cls.__name__}", (cls,), {**methods, "__module__": "__main__"})
    sys.modules["__main__"].__dict__[held.__name__] = held  # by which pickle finds it
    env.__class__ = held
    return env


def globals_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Seeds the global generators before each call by its number within the episode."""

    def seed_all(number: int) -> None:
        np.random.seed(number)
        random.seed(number)
        if "torch" in sys.modules:
            sys.modules["torch"].manual_seed(number)

    def built() -> Any:
        seed_all(0)
        env = make()
        cls = type(env)

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            self.__dict__["calls_made"] = 0
            seed_all(0)
            return cls.reset(self, *args, **kwargs)

        def step(self: Any, action: Any) -> Any:
            self.__dict__["calls_made"] += 1
            seed_all(self.__dict__["calls_made"])
            return cls.step(self, action)

        return with_class(env, reset=reset, step=step)

    return built


def hold_entropy() -> Callable[[], None]:
    """Gives the same bits whenever a generator asks the system for entropy.

    Returns:
        Puts things back.
    """
    places = (np.random.bit_generator, random.Random, random.SystemRandom)
    own_seed = random.Random.seed

    def seeded(self: Any, a: Any = None, version: int = 2) -> None:
        own_seed(self, 0 if a is None else a, version)

    values = [
        (places[0], "randbits", lambda count: 0),
        (places[1], "seed", seeded),
        (places[2], "random", lambda self: 0.5),
        (places[2], "getrandbits", lambda self, k: 0),
    ]
    before = [(place, name, getattr(place, name)) for place, name, _ in values]

    def put(named: Any) -> None:
        for place, name, value in named:
            setattr(place, name, value)

    put(values)
    return lambda: put(before)


def entropy_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Gives the same bits whenever a generator asks the system for entropy."""
    hold_entropy()
    return make


def generators_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Restarts the environment's own generators at each reset, and holds the system's entropy."""
    hold_entropy()

    def generators(root: Any) -> Iterator[Any]:
        seen: dict[int, Any] = {}
        waiting = [root]
        while waiting and len(seen) < 100_000:
            each = waiting.pop()
            if id(each) in seen or inspect.isroutine(each) or inspect.ismodule(each):
                continue
            seen[id(each)] = each
            if isinstance(each, np.random.Generator | np.random.RandomState | random.Random):
                yield each
            elif not isinstance(each, type):
                waiting += gc.get_referents(each)

    def restart(env: Any) -> None:
        for each in generators(env):
            if isinstance(each, np.random.RandomState | random.Random):
                each.seed(0)
            else:
                each.bit_generator.state = type(each.bit_generator)(0).state

    def built() -> Any:
        env = make()
        cls = type(env)

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            restart(self)
            return cls.reset(self, *args, **kwargs)

        return with_class(env, reset=reset)

    return built


def instances_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Resets a fresh instance in place of a used one."""

    def built() -> Any:
        env = make()
        cls = type(env)

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            self.__dict__.clear()
            self.__dict__.update(make().__dict__)
            return cls.reset(self, *args, **kwargs)

        return with_class(env, reset=reset)

    return built


def copies_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Makes each copy by playing the same calls again in a fresh instance."""

    def played(calls: Any) -> Any:
        env = built()
        for name, args, kwargs in calls:
            getattr(env, name)(*args, **kwargs)
        return env

    def built() -> Any:
        env = make()
        cls = type(env)
        env.__dict__["calls_made"] = []

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            self.__dict__["calls_made"] = [("reset", args, kwargs)]
            return cls.reset(self, *args, **kwargs)

        def step(self: Any, action: Any) -> Any:
            self.__dict__["calls_made"].append(("step", (copy.deepcopy(action),), {}))
            return cls.step(self, action)

        def duplicate(self: Any, memo: Any) -> Any:
            return played(list(self.__dict__["calls_made"]))

        def reduce(self: Any, protocol: Any) -> Any:
            return played, (list(self.__dict__["calls_made"]),)

        played.__module__, played.__qualname__ = "__main__", "played"
        sys.modules["__main__"].__dict__["played"] = played  # by which pickle finds it
        methods = {"__deepcopy__": duplicate, "__reduce_ex__": reduce}
        return with_class(env, reset=reset, step=step, **methods)

    return built


@contextmanager
def still_entropy() -> Iterator[None]:
    """Within it a generator that asks the system for entropy gets the same bits each time."""
    put_back = hold_entropy()
    try:
        yield
    finally:
        put_back()


@dataclass(frozen=True, slots=True)
class Hold:
    """Holds one kind of cause still.

    Attributes:
        words: what is done, for `follows_from`.
        function: takes `make`, returns another.
        consequences: checks whose failure may follow from the cause; empty: of any.
    """

    words: str
    function: Callable[[Callable[[], Any]], Callable[[], Any]]
    consequences: tuple[str, ...] = ()


GLOBALS: Final = Hold("global generators seeded before each call", globals_held)
ENTROPY: Final = Hold("the system's entropy replaced by a constant", entropy_held)
GENERATORS: Final = Hold("own generators restarted at each reset", generators_held)
INSTANCES: Final = Hold("a fresh instance for each reset", instances_held)
COPIES: Final = Hold("copies made by playing the same calls again", copies_held, ("GK702", "GK703"))

OF_DRAWS: Final = (GLOBALS, ENTROPY)
"""Held where the same play differs by itself, so that another fault in it can be shown."""
HOLDS: Final = {
    "GK602": GLOBALS,
    "GK601": GENERATORS,
    "GK605": ENTROPY,
    "GK606": INSTANCES,
    "GK604": INSTANCES,
    "GK701": COPIES,
}
"""By the check whose failure is a cause, in the order in which causes are established."""


def held_still(program: str, hold: Hold) -> str:
    """The program with a cause held still in every environment that it builds."""
    text, modules = text_of(hold.function)
    imports = "".join(f"import {name}\n" for name in modules)
    head, found, rest = program.partition(MAKE)
    body, seed, tail = rest.partition(SEED)
    if not found or not seed:
        return program
    replaced = f"\n{text}\nmake = {hold.function.__name__}(make)\n"
    return f"{head}\n{imports}{MAKE}{body}{replaced}{seed}{tail}"
