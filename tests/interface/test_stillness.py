"""Whether a call draws: seen by the generators an environment holds, which are put back."""

import gc
import random
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gamekeeper.interface.generators import generators, is_still


class Holder:
    """Anything with attributes."""

    def __init__(self, **held: Any) -> None:
        self.__dict__.update(held)


class Slotted:
    __slots__ = ("__hidden", "rng")

    def __init__(self, rng: Any) -> None:
        self.rng = rng
        self.__hidden = rng

    def draw(self) -> Any:
        return self.__hidden.random()


def nested(rng: Any, depth: int) -> Any:
    """An environment that holds `rng` some attributes deep."""
    item = rng
    for _ in range(depth):
        item = Holder(inner=item)
    return Holder(env=item)


DRAWS: list[tuple[str, Callable[[], Any], Callable[[Any], Any]]] = [
    ("generator", lambda: np.random.default_rng(1), lambda rng: rng.random()),
    ("philox", lambda: np.random.Generator(np.random.Philox(1)), lambda rng: rng.normal()),
    ("mt19937", lambda: np.random.Generator(np.random.MT19937(1)), lambda rng: rng.random()),
    ("randomstate", lambda: np.random.RandomState(1), lambda rng: rng.rand()),
    ("random", lambda: random.Random(1), lambda rng: rng.random()),
]


@pytest.mark.parametrize(("make", "draw"), [each[1:] for each in DRAWS], ids=[d[0] for d in DRAWS])
def test_call_that_draws_is_seen_and_put_back(make: Any, draw: Any) -> None:
    """Every kind of generator, in attributes, containers and slots."""
    for hold in (
        lambda rng: Holder(rng=rng),
        lambda rng: Holder(spaces={"a": [Holder(rng=rng)]}),
        lambda rng: Holder(world=(Slotted(rng),)),
        Slotted,
    ):
        rng = make()
        env = hold(rng)
        assert is_still(env, lambda: None)
        assert not is_still(env, lambda rng=rng: draw(rng))
        assert draw(rng) == draw(make())


def test_private_slots_are_looked_into() -> None:
    """`__hidden` in a class's slots is kept under a longer name."""
    env = Slotted(np.random.default_rng(1))
    assert not is_still(env, env.draw)


@pytest.mark.parametrize(
    ("name", "draw"), [("numpy", lambda: np.random.rand()), ("random", lambda: random.random())]
)
def test_global_generators_count(name: str, draw: Any) -> None:
    """The module's own generator is the environment's too."""
    numpy_state, state = np.random.get_state(), random.getstate()
    try:
        assert not is_still(Holder(), draw)
        assert state == random.getstate()
        assert np.array_equal(numpy_state[1], np.random.get_state()[1])
    finally:
        np.random.set_state(numpy_state)
        random.setstate(state)


def test_call_that_raises_is_not_made_again() -> None:
    """`state()` that isn't implemented, a `render()` without a screen."""

    def call() -> None:
        raise NotImplementedError

    assert not is_still(Holder(), call)


def test_generator_held_near_and_far_is_found() -> None:
    """What lies deep by one way and shallow by another is looked into by the short one."""
    rng = np.random.default_rng(1)
    shared = Holder(a=Holder(b=Holder(rng=rng)))
    env = Holder(near=shared, far=nested(shared, 4))
    assert any(found is rng for found in generators(env))
    assert any(found is rng for found in generators(Holder(far=nested(shared, 4), near=shared)))
    assert not any(found is rng for found in generators(nested(rng, 9)))


def test_cycles_end() -> None:
    """Environments point at themselves."""
    env = Holder()
    env.me, env.list = env, [env]
    assert is_still(env, lambda: 1)


def test_looking_leaves_instances_as_fast_as_they_were() -> None:
    """The instance dictionary of an environment isn't made by the look: that would slow it."""

    class Env:
        def __init__(self) -> None:
            self.rng = np.random.default_rng(1)

    env = Env()
    before = sys.getsizeof(env), len(gc.get_referents(env))
    assert is_still(env, lambda: None)
    assert (sys.getsizeof(env), len(gc.get_referents(env))) == before
    assert not any(isinstance(part, dict) for part in gc.get_referents(env))
