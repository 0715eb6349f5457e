"""Spaces as TorchRL's specs, and leaves of values as tensors under its keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torchrl.data import Binary, Bounded, Categorical, Composite, MultiCategorical, Unbounded

from gamekeeper.errors import SpecError
from gamekeeper.vector.vector_form import ArrayLeaf, leaves

WIDER: Final = {"u2": np.int32, "u4": np.int64, "u8": np.int64}
"""Unsigned numbers that torch can hold and hardly compute with."""


@dataclass(frozen=True, slots=True)
class SpecPart:
    """One tensor of an observation or of an action.

    Attributes:
        place: the number of its leaf in the space.
        key: its path below `observation` or `action`.
        space: of the leaf.
    """

    place: int
    key: tuple[str, ...]
    space: Any


def parts_of(space: Any, *, without: str | None = None) -> list[SpecPart]:
    """The tensors of a space, without the mask within it; of one other key, that one bare."""
    found = [
        SpecPart(place, tuple(str(key) for key in leaf.path), _at(space, leaf))
        for place, leaf in enumerate(leaves(space, "space"))
        if without is None or leaf.path[:1] != (without,)
    ]
    firsts = {part.key[:1] for part in found}
    if without is not None and len(found) < len(list(leaves(space, "space"))) and len(firsts) == 1:
        return [SpecPart(part.place, part.key[1:], part.space) for part in found]
    return found


def _at(space: Any, leaf: ArrayLeaf) -> Any:
    for key in leaf.path:
        space = space[key]
    return space


def observed(parts: list[SpecPart], lead: tuple[int, ...]) -> Any:
    """The spec of an observation whose tensors are [*lead, ...].

    Bounds are wide enough for the zeros of agents that aren't live.
    """
    return _nested({part.key: _shown(part.space, lead) for part in parts}, lead)


def acted(parts: list[SpecPart], lead: tuple[int, ...]) -> Any:
    """The spec of an action; whole numbers count from 0.

    Raises:
        SpecError: a part of an action space is unbounded.
    """
    return _nested({part.key: _done(part.space, lead) for part in parts}, lead)


def _nested(found: dict[tuple[str, ...], Any], lead: tuple[int, ...]) -> Any:
    if list(found) == [()]:
        return found[()]
    whole = Composite(shape=lead)
    for key, spec in found.items():
        for depth in range(1, len(key)):
            if key[:depth] not in whole.keys(include_nested=True):
                whole[key[:depth]] = Composite(shape=lead)
        whole[key] = spec
    return whole


def _shown(space: Any, lead: tuple[int, ...]) -> Any:
    if isinstance(space, spaces.Discrete) and space.start == 0:
        return _done(space, lead)
    if isinstance(space, spaces.MultiDiscrete) and not space.start.any() and space.nvec.ndim == 1:
        return _done(space, lead)
    shape, dtype = (*lead, *(space.shape or ())), torch_dtype(space.dtype)
    if (
        isinstance(space, spaces.Box)
        and np.isfinite(space.low).all() & np.isfinite(space.high).all()
    ):
        return _bounded(np.minimum(space.low, 0), np.maximum(space.high, 0), shape, dtype)
    return Unbounded(shape=shape, dtype=dtype)


def _done(space: Any, lead: tuple[int, ...]) -> Any:
    if isinstance(space, spaces.Discrete):
        return Categorical(int(space.n), shape=lead, dtype=torch.int64)
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        nvec = torch.as_tensor(space.nvec)
        return MultiCategorical(nvec, shape=(*lead, len(nvec)), dtype=torch.int64)
    shape = (*lead, *(space.shape or ()))
    if isinstance(space, spaces.MultiBinary):
        return Binary(shape[-1], shape=shape, dtype=torch.int8)
    if isinstance(space, spaces.Box):
        dtype = torch_dtype(space.dtype)
        if np.isfinite(space.low).all() and np.isfinite(space.high).all():
            return _bounded(space.low, space.high, shape, dtype)
        return Unbounded(shape=shape, dtype=dtype)
    raise SpecError(
        "TorchRL has no spec for such an action",
        where="action_space",
        actual=str(space)[:200],
        expected="Discrete, MultiDiscrete with one axis, MultiBinary, Box, or Dict of them",
        fix="flatten the actions, in the environment",
    )


def _bounded(low: Any, high: Any, shape: tuple[int, ...], dtype: Any) -> Any:
    bounds = (
        torch.as_tensor(np.array(np.broadcast_to(each, shape))).to(dtype) for each in (low, high)
    )
    return Bounded(*bounds, shape=shape, dtype=dtype)


def torch_dtype(dtype: Any) -> Any:
    """The dtype of the tensor that `tensor` makes of such an array."""
    return tensor(np.zeros(1, dtype)).dtype


def tensor(array: NDArray[Any]) -> Any:
    """An array as a tensor, over the same memory where that can be."""
    wider = WIDER.get(array.dtype.str[1:])
    return torch.from_numpy(array if wider is None else array.astype(wider))


def width(parts: list[SpecPart]) -> int:
    """Length of an observation as one vector, in which a whole number of n takes n places."""
    return sum(_width(part.space) for part in parts)


def _width(space: Any) -> int:
    if isinstance(space, spaces.Discrete):
        return int(space.n)
    if isinstance(space, spaces.MultiDiscrete):
        return int(space.nvec.sum())
    return int(np.prod(space.shape or (), dtype=int))


def flat(
    parts: list[SpecPart], arrays: list[NDArray[Any]], there: NDArray[np.bool_]
) -> NDArray[Any]:
    """Observations as vectors of float32, whole numbers one-hot, as Gymnasium's `flatten` has them.

    Args:
        parts: of the observation.
        arrays: [copy, agent, ...] of each part.
        there: [copy, agent], agents that are live; the others are all zeros.
    """
    found = []
    for part, array in zip(parts, arrays, strict=True):
        if isinstance(part.space, spaces.Discrete | spaces.MultiDiscrete):
            nvec = np.atleast_1d(getattr(part.space, "nvec", getattr(part.space, "n", 0))).ravel()
            start = np.atleast_1d(part.space.start).ravel()
            values = array.reshape(*there.shape, -1) - start
            hot = [np.arange(n) == values[..., i, None] for i, n in enumerate(nvec)]
            found += [each & there[..., None] for each in hot]
        else:
            found.append(array.reshape(*there.shape, -1))
    return np.concatenate(found, axis=-1, dtype=np.float32, casting="unsafe")
