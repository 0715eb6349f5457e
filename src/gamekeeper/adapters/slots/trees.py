"""Values that are dictionaries and tuples of arrays, changed and filled part by part."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gamekeeper.vector.form import Leaf, Space, built


def changed(tree: Any, change: Callable[[Any], Any]) -> Any:
    """The same tree, every array in it changed."""
    if isinstance(tree, dict):
        return {key: changed(part, change) for key, part in tree.items()}
    if isinstance(tree, tuple):
        return tuple(changed(part, change) for part in tree)
    return change(tree)


def at(tree: Any, index: Any) -> Any:
    """What stands at an index of every array; nothing of it is shared with them."""

    def own(array: Any) -> Any:
        value = array[index]
        return value.copy() if isinstance(value, np.ndarray) else value

    return changed(tree, own)


def put(tree: Any, index: Any, value: Any) -> None:
    """Writes a value of the same form to an index of every array."""
    if isinstance(tree, dict):
        for key, part in tree.items():
            put(part, index, value[key])
    elif isinstance(tree, tuple):
        for part, own in zip(tree, value, strict=True):
            put(part, index, own)
    else:
        tree[index] = value


def fill(tree: Any, index: Any, value: Any) -> None:
    """Writes one number to an index of every array."""
    if isinstance(tree, dict | tuple):
        for part in tree.values() if isinstance(tree, dict) else tree:
            fill(part, index, value)
    else:
        tree[index] = value


def zeros(space: Space, leaves: tuple[Leaf, ...], lead: tuple[int, ...]) -> Any:
    """Zeros in the form of a space, with these axes in front."""
    return built(space, (np.zeros((*lead, *leaf.shape), leaf.dtype) for leaf in leaves))
