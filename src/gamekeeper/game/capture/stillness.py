"""Whether a call leaves an environment's random generators as they were."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from gamekeeper.core.stream import Stream

DEPTH: Final = 5
MOST_OBJECTS: Final = 20_000
_PLAIN: Final = (str, bytes, int, float, complex, bool, type(None), np.ndarray, np.generic, type)


def is_still(env: Any, call: Callable[[], Any]) -> bool:
    """Makes `call` once and says whether it may be made again: it neither raises nor draws.

    A generator that was drawn from is put back, so that asking doesn't disturb the environment.
    """
    before = [(generator, _state(generator)) for generator in generators(env)]
    try:
        call()
    except Exception:  # not offered (NotImplementedError) or broken: it isn't called again
        calm = False
    else:
        calm = True
    for generator, state in before:
        if not _same(_state(generator), state):
            _restore(generator, state)
            calm = False
    return calm


def generators(env: Any) -> Iterator[Any]:
    """The random generators that `env` holds, down to a depth of 5, and the global ones.

    Nearest first, so that what is held both near and far is looked into from near.
    """
    yield random
    yield np.random
    seen: set[int] = set()
    queue = deque([(env, 0)])
    while queue and len(seen) < MOST_OBJECTS:
        item, depth = queue.popleft()
        if id(item) in seen or isinstance(item, _PLAIN):
            continue
        seen.add(id(item))
        if isinstance(item, np.random.Generator | np.random.RandomState | random.Random | Stream):
            yield item
        elif depth < DEPTH:
            queue.extend((part, depth + 1) for part in _parts(item))


def _parts(item: Any) -> list[Any]:
    if isinstance(item, dict):
        return list(item.values())
    if isinstance(item, list | tuple | set | frozenset | deque):
        return list(item)
    slots = [name for kind in type(item).__mro__ for name in _slots(kind)]
    held = [getattr(item, name, None) for name in slots]
    return [*getattr(item, "__dict__", {}).values(), *held]


def _slots(kind: type) -> tuple[str, ...]:
    """The names that a class keeps in slots of its own; not the properties of builtins."""
    names = kind.__dict__.get("__slots__", ())
    names = (names,) if isinstance(names, str) else tuple(names)
    hidden = f"_{kind.__name__.lstrip('_')}"
    return tuple(
        hidden + name if name.startswith("__") and not name.endswith("__") else name
        for name in names
        if name not in ("__dict__", "__weakref__")
    )


def _state(generator: Any) -> Any:
    if isinstance(generator, np.random.Generator):
        return generator.bit_generator.state
    if isinstance(generator, Stream):
        return generator.draws
    if isinstance(generator, random.Random) or generator is random:
        return generator.getstate()
    return generator.get_state()


def _restore(generator: Any, state: Any) -> None:
    if isinstance(generator, np.random.Generator):
        generator.bit_generator.state = state
    elif isinstance(generator, Stream):
        generator.draws = state
    elif isinstance(generator, random.Random) or generator is random:
        generator.setstate(state)
    else:
        generator.set_state(state)


def _same(left: Any, right: Any) -> bool:
    """Whether two states are equal; they hold arrays inside dictionaries and tuples."""
    if isinstance(left, np.ndarray):
        return bool(np.array_equal(left, right))
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(_same(left[key], right[key]) for key in left)
    if isinstance(left, tuple):
        return len(left) == len(right) and all(map(_same, left, right))
    return bool(left == right)
