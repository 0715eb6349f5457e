"""Spaces of other libraries as Gymnasium's, read by what they hold and not by who made them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import DTypeLike, NDArray

from gamekeeper.errors import SpecError

Space = spaces.Space[Any]


def as_gymnasium(space: Any) -> Space:
    """The same space as one of Gymnasium's.

    The old Gym's spaces, JaxMARL's and gymnax's are known by the names of their classes, so that
    nothing of them has to be installed.

    Raises:
        SpecError: it is of a kind that has no likeness.
    """
    if isinstance(space, spaces.Space):
        return space
    kinds = {kind.__name__ for kind in type(space).__mro__}
    if "Discrete" in kinds:
        return spaces.Discrete(int(space.n), start=int(getattr(space, "start", 0)))
    if "MultiDiscrete" in kinds:
        counts = getattr(space, "nvec", None)
        return spaces.MultiDiscrete(np.asarray(space.num_categories if counts is None else counts))
    if "MultiBinary" in kinds:
        return spaces.MultiBinary(space.n)
    if "Box" in kinds:
        shape = np.ravel(space.shape).astype(int).tolist()  # a single length stands for its tuple
        return box(space.low, space.high, tuple(shape), np.dtype(space.dtype))
    parts = space if isinstance(space, Mapping) else getattr(space, "spaces", None)
    if isinstance(parts, Mapping):
        return spaces.Dict({str(name): as_gymnasium(part) for name, part in parts.items()})
    if isinstance(parts, list | tuple):
        return spaces.Tuple([as_gymnasium(part) for part in parts])
    raise SpecError(
        "a space has no likeness in Gymnasium",
        expected="Discrete, MultiDiscrete, MultiBinary, Box, Tuple or Dict",
        actual=f"{type(space).__module__}.{type(space).__qualname__}",
        fix="give the environment spaces of these kinds",
    )


def box(low: Any, high: Any, shape: tuple[int, ...], dtype: DTypeLike) -> spaces.Box:
    """A Box of any dtype; a bound that whole numbers can't reach is the dtype's own."""
    kind = np.dtype(dtype)
    if kind.kind == "b":
        return spaces.Box(0, 1, shape, np.int8)
    return spaces.Box(_bound(low, shape, kind), _bound(high, shape, kind), shape, kind.type)


def _bound(bound: Any, shape: tuple[int, ...], kind: np.dtype[Any]) -> NDArray[Any]:
    """A bound as an array of the dtype; infinities of whole numbers are its ends."""
    wide = np.broadcast_to(np.asarray(bound), shape)
    if kind.kind not in "iu":
        return wide.astype(kind)
    # As Python's numbers: the largest whole numbers of 64 bits are no doubles.
    low, high = np.iinfo(kind).min, np.iinfo(kind).max
    ends = [
        low if value <= low else high if value >= high else int(value)
        for value in wide.ravel().tolist()
    ]
    return np.array(ends, kind).reshape(shape)


def several(space: Any) -> list[Space] | None:
    """The spaces of several agents: of a Tuple, a list or a tuple; None where it is one space."""
    if isinstance(space, list | tuple):
        return [as_gymnasium(part) for part in space]
    kinds = {kind.__name__ for kind in type(space).__mro__}
    if "Tuple" in kinds:
        return [as_gymnasium(part) for part in space.spaces]
    if "MultiAgentActionSpace" in kinds or "MultiAgentObservationSpace" in kinds:
        return [as_gymnasium(part) for part in space]
    return None


def idle(space: Space) -> Any:
    """Placeholder action of an agent that has ended, where a list has a place for it.

    The smallest number of a Discrete space, zeros elsewhere as far as the bounds allow.
    """
    if isinstance(space, spaces.Discrete):
        return int(space.start)
    if isinstance(space, spaces.Box):
        return np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
    if isinstance(space, spaces.Tuple):
        return tuple(idle(part) for part in space.spaces)
    if isinstance(space, spaces.Dict):
        return {name: idle(part) for name, part in space.spaces.items()}
    return np.zeros(space.shape or (), space.dtype)
