"""Random generators of an environment: found, and compared before and after a call."""

import gc
import random
from collections import deque
from collections.abc import Callable, Iterator
from itertools import pairwise
from types import BuiltinFunctionType, CodeType, FrameType, FunctionType, ModuleType
from typing import Any, Final

import numpy as np

from gamekeeper.randomness.stream import Stream

DEPTH: Final = 5
MOST_OBJECTS: Final = 20_000
# what leads out of an environment into everything else
_SHARED: Final = (type, ModuleType, FunctionType, BuiltinFunctionType, CodeType, FrameType)
_CONTAINERS: Final = (dict, list, tuple, set, frozenset, deque)  # no deeper than what holds them
_PLAIN: Final = (str, bytes, int, float, complex, bool, type(None), np.ndarray, np.generic, type)


def is_still(env: Any, call: Callable[[], Any]) -> bool:
    """Makes `call` once and says whether it may be made again: it neither raises nor draws.

    A generator that was drawn from is put back, so that asking doesn't disturb the environment.
    """
    before = [(generator, state_of(generator)) for generator in generators(env)]
    try:
        call()
    except KeyboardInterrupt:
        raise
    except BaseException:  # not offered (NotImplementedError) or broken: it isn't called again
        calm = False
    else:
        calm = True
    for generator, state in before:
        if not is_same_state(state_of(generator), state):
            put_back(generator, state)
            calm = False
    return calm


def generators(env: Any) -> Iterator[Any]:
    """The random generators that `env` holds, down to five objects deep, and the global ones.

    Nearest first, so that what is held both near and far is looked into from near.
    """
    yield random
    yield np.random
    yield from (link[1] for link in _links(env, ()))


def chains(env: Any, *, without: tuple[type, ...]) -> list[tuple[Any, ...]]:
    """Objects that lead from `env` to each generator that it holds, both ends among them.

    Instances of `without` aren't looked into.
    """
    found = []
    for link in _links(env, without):
        chain, at = [], link
        while at is not None:
            chain.append(at[1])
            at = at[0]
        found.append(tuple(reversed(chain)))
    return found


def at_end(chain: tuple[Any, ...]) -> Any:
    """The generator that a chain leads to now; None where the chain is broken.

    A generator that was replaced by the only one of its class in the same place is that one.
    """
    for parent, child in pairwise(chain):
        parts = gc.get_referents(parent)
        if any(part is child for part in parts):
            continue
        others = [part for part in parts if type(part) is type(child)]
        return others[0] if child is chain[-1] and len(others) == 1 else None
    return chain[-1]


def _links(env: Any, without: tuple[type, ...]) -> Iterator[Any]:
    """Yields each generator as a pair with the pair of the object that holds it, up to `env`."""
    plain: Any = (*_PLAIN, *without)
    seen: set[int] = set()
    queue: deque[tuple[Any, int]] = deque([((None, env), 0)])
    while queue and len(seen) < MOST_OBJECTS:
        link, depth = queue.popleft()
        item = link[1]
        if id(item) in seen or isinstance(item, plain):
            continue
        seen.add(id(item))
        if isinstance(item, np.random.Generator | np.random.RandomState | random.Random | Stream):
            yield link
        elif isinstance(item, _CONTAINERS):
            # What a container holds comes next, and is no deeper than what holds the container.
            queue.extendleft(((link, part), depth) for part in reversed(_parts(item)))
        elif depth < DEPTH:
            queue.extend(((link, part), depth + 1) for part in _parts(item))


def _parts(item: Any) -> list[Any]:
    """Parts of an object, as the garbage collector lists them.

    Not by its `__dict__`: an instance whose dictionary was ever looked at keeps its attributes in
    it from then on, and each access costs twice as much (CPython 3.11 and later).
    """
    return [part for part in gc.get_referents(item) if not isinstance(part, _SHARED)]


def state_of(generator: Any) -> Any:
    """State of a generator, to be compared with `is_same_state`."""
    if isinstance(generator, np.random.Generator):
        return generator.bit_generator.state
    if isinstance(generator, Stream):
        return generator.draws
    if isinstance(generator, random.Random) or generator is random:
        return generator.getstate()
    return generator.get_state()


def put_back(generator: Any, state: Any) -> None:
    """Sets the state of a generator, as `state_of` gave it."""
    if isinstance(generator, np.random.Generator):
        generator.bit_generator.state = state
    elif isinstance(generator, Stream):
        generator.draws = state
    elif isinstance(generator, random.Random) or generator is random:
        generator.setstate(state)
    else:
        generator.set_state(state)


def is_same_state(left: Any, right: Any) -> bool:
    """Tells whether two states are equal; arrays may stand in dictionaries, tuples and lists."""
    try:
        return bool(left == right)
    except ValueError:  # arrays within: element by element
        pass
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(
            is_same_state(left[key], right[key]) for key in left
        )
    if isinstance(left, tuple | list):
        return len(left) == len(right) and all(map(is_same_state, left, right))
    return bool(np.array_equal(left, right))
