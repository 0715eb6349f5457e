"""Draws held still: of the global generators, the system, an environment's own, its spaces.

As in `holds`, the source of each function stands at the head of a reproducer.
"""

import contextlib
import copy
import pickle
import random
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from gamekeeper.auditing.holds import (
    before_resets,
    global_states,
    own_generators,
    put_global_states,
    with_class,
    with_methods,
)
from gamekeeper.checks.object_ids import ids_from


@contextlib.contextmanager
def seeds_given() -> Iterator[None]:
    """Seeds the global generators with a constant where no seed is given: not with entropy."""
    places: tuple[Any, ...] = np.random, random
    before = [each.seed for each in places]
    for each, seed in zip(places, before, strict=True):
        each.seed = lambda a=None, *rest, seed=seed: seed(764_309 if a is None else a, *rest)
    try:
        yield
    finally:
        for each, seed in zip(places, before, strict=True):
            each.seed = seed


def globals_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Keeps what each environment draws from the global generators apart from all other draws.

    They begin as in the audit, so that its actions fit: elsewhere where a reset's seed is another.
    """

    def seed_all(number: int) -> None:
        np.random.seed(number)
        random.seed(number)
        if "torch" in sys.modules:
            sys.modules["torch"].manual_seed(number)

    @contextlib.contextmanager
    def going_on(env: Any) -> Iterator[None]:
        put_global_states(env.__dict__["drawn_to"])
        with seeds_given():
            yield
        env.__dict__["drawn_to"] = global_states()

    def built() -> Any:
        seed_all(764_309)
        with seeds_given():
            env = make()
        cls = type(env)
        env.__dict__["drawn_to"] = global_states()

        def reset(self: Any, *args: Any, **kwargs: Any) -> Any:
            with going_on(self):
                seed = kwargs.get("seed")
                if seed is not None:
                    seed_all((764_309 + seed - globals().get("SEED", 0)) % 2**32)
                return cls.reset(self, *args, **kwargs)

        def step(self: Any, action: Any) -> Any:
            with going_on(self):
                return cls.step(self, action)

        return with_class(env, reset=reset, step=step)

    return built


def resets_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Seeds the global generators before an environment is built, and before each reset."""

    def seed_all(env: Any = None) -> None:
        np.random.seed(764_309)
        random.seed(764_309)
        if "torch" in sys.modules:
            sys.modules["torch"].manual_seed(764_309)

    def built() -> Any:
        seed_all()
        return make()

    return before_resets(built, seed_all)


def hold_entropy(bits: int = 0) -> Callable[[], None]:
    """Gives the same bits whenever a generator asks the system for entropy.

    Args:
        bits: what is given; other bits make other draws.
    Returns:
        Puts things back.
    """
    places = (np.random.bit_generator, random.Random, random.SystemRandom)
    own_seed = random.Random.seed

    def seeded(self: Any, a: Any = None, version: int = 2) -> None:
        own_seed(self, bits if a is None else a, version)

    values = [
        (places[0], "randbits", lambda count: bits),
        (places[1], "seed", seeded),
        (random, "seed", lambda a=None, version=2: seeded(random._inst, a, version)),
        (places[2], "random", lambda self: 0.5 / (1 + bits)),
        (places[2], "getrandbits", lambda self, k: bits),
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


def is_data(value: Any) -> bool:
    """Tells whether a value is made of numbers, texts and arrays alone."""
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, list | tuple | set | frozenset):
        return all(map(is_data, value))
    return isinstance(value, int | float | str | bytes | np.ndarray | np.generic | None)


def drawn_by_constructor(make: Callable[[], Any]) -> dict[str, Any]:
    """Attributes that are data, and other data where the system's entropy is; held thereafter."""
    hold_entropy(1)
    other = vars(make().unwrapped)
    hold_entropy()
    both = {name: [value, other.get(name)] for name, value in vars(make().unwrapped).items()}
    return {
        name: pair[0]
        for name, pair in both.items()
        if is_data(pair) and pickle.dumps(pair[0]) != pickle.dumps(pair[1])
    }


def generators_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Restarts the environment's own generators at each reset, and holds the system's entropy.

    What the constructor drew is put back there too: a seed came too late for it.
    """
    drawn = drawn_by_constructor(make)

    def restart(env: Any) -> None:
        vars(env.unwrapped).update(copy.deepcopy(drawn))
        for each in own_generators(env):
            if isinstance(each, np.random.RandomState | random.Random):
                each.seed(0)
            else:
                each.bit_generator.state = type(each.bit_generator)(0).state

    return before_resets(make, restart)


def spaces_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Seeds the spaces of all possible agents at each reset.

    A copy that the environment makes itself has spaces that go on from where its own stand.
    """

    def spaces_of(env: Any) -> list[Any]:
        names = "observation_space", "action_space"
        return [getattr(env, name)(agent) for agent in env.possible_agents for name in names]

    def seed(env: Any) -> None:
        for each in spaces_of(env):
            each.seed(0)

    def methods(cls: Any) -> dict[str, Callable[..., Any]]:
        def duplicate(self: Any, memo: Any) -> Any:
            stood = [each.bit_generator.state for each in own_generators(spaces_of(self))]
            other = cls.__deepcopy__(self, memo)
            seed(other)  # a space has no generator before it is asked for one
            for each, state in zip(own_generators(spaces_of(other)), stood, strict=False):
                each.bit_generator.state = state
            return other

        return {"__deepcopy__": duplicate} if hasattr(cls, "__deepcopy__") else {}

    return with_methods(before_resets(make, seed), methods)


def ids_held(make: Callable[[], Any]) -> Callable[[], Any]:
    """Numbers objects anew, at each reset, where an environment asks for their id()."""
    first = make()

    def built() -> Any:
        ids_from(first, 0)
        return make()

    return before_resets(built, lambda env: ids_from(env, 0))
