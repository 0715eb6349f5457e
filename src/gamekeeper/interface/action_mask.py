"""Action masks: their place in an observation or info, and their reading."""

from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.exception_text import message
from gamekeeper.errors import PolicyError

Reader: TypeAlias = Callable[[object, object], object]
"""From an observation and an info to the mask in them, or None."""

_PLAIN: Final = (dict, str, bytes, bool, int, float, complex, type(None), np.ndarray)
_KEY: Final = "action_mask"
_SIDES: Final = {"observation": 0, "obs": 0, "info": 1, "infos": 1}


def reader(place: str | None) -> Reader:
    """Function that finds a mask: at the contract's place, else under `action_mask`.

    A place that holds nothing this time is no mask: all actions are legal.

    Args:
        place: `observation.KEY` or `infos.KEY`, with further keys after more dots; None where the
            contract says nothing.
    Raises:
        PolicyError: the place is of another form.
    """
    if place is None:
        return _usual
    side, *keys = place.split(".")
    if side not in _SIDES or not keys or not all(keys):
        raise PolicyError(
            "a mask can't stand there",
            where="mask",
            expected="observation.KEY or infos.KEY",
            actual=repr(place),
            fix="name the mask's place as observation.KEY or infos.KEY",
        )
    return _at(_SIDES[side], tuple(keys))


def _usual(observation: object, info: object) -> object:
    # type first: asking an abstract class costs more than the rest
    if type(observation) is not np.ndarray and isinstance(observation, Mapping):
        mask = observation.get(_KEY)
        if mask is not None:
            return mask
    return info.get(_KEY) if type(info) is dict or isinstance(info, Mapping) else None


def _at(side: int, keys: tuple[str, ...]) -> Reader:
    def read(observation: object, info: object) -> object:
        value = info if side else observation
        for key in keys:
            if not isinstance(value, Mapping):
                return None
            value = value.get(key)
        return value

    return read


def legal_flags(mask: object, size: int) -> NDArray[np.bool_]:
    """The mask of a Discrete space as [size] booleans; what isn't zero is legal.

    Raises:
        PolicyError: it isn't one number for each action.
    """
    try:
        flags = np.asarray(mask).astype(bool)
    except (TypeError, ValueError) as error:
        raise _unfit(size, f"{type(mask).__qualname__}: {message(error)}") from None
    if flags.shape != (size,):
        raise _unfit(size, f"shape {flags.shape}")
    return flags


def for_sample(space: spaces.Space[Any], mask: object) -> Any:
    """The mask in the form that Gymnasium's `sample(mask=...)` takes, None where all is legal.

    Booleans and other numbers become int8; a part without any legal action counts as unmasked, as
    there would be nothing to choose; a flat mask of a MultiDiscrete is cut into its parts. For
    MultiBinary Gymnasium's own meaning holds: 0 and 1 are given, 2 is free.

    Raises:
        PolicyError: the mask doesn't have the structure of the space.
    """
    if mask is None or isinstance(space, spaces.Box):  # continuous actions have no list
        return None
    if isinstance(space, spaces.Discrete):
        flags = legal_flags(mask, int(space.n))
        return flags.astype(np.int8) if flags.any() else None
    if isinstance(space, spaces.MultiDiscrete):
        return _multi(space.nvec, mask)
    if isinstance(space, spaces.MultiBinary):
        if np.shape(np.asarray(mask)) != space.shape:
            raise _unfit(f"shape {space.shape}", f"shape {np.shape(np.asarray(mask))}")
        return np.asarray(mask).astype(np.int8)
    if isinstance(space, spaces.Dict):
        if not isinstance(mask, Mapping):
            raise _unfit(f"a mask for each of {list(space)}", type(mask).__qualname__)
        return {key: for_sample(part, mask.get(key)) for key, part in space.items()}
    if isinstance(space, spaces.Tuple | spaces.OneOf):
        parts = space.spaces
        if not isinstance(mask, tuple | list) or len(mask) != len(parts):
            raise _unfit(f"a tuple of {len(parts)} masks", type(mask).__qualname__)
        return tuple(for_sample(part, one) for part, one in zip(parts, mask, strict=True))
    return mask  # Text, Sequence, Graph and foreign spaces have forms of their own


def _multi(nvec: NDArray[Any], mask: object) -> Any:
    if nvec.ndim == 0:
        flags = legal_flags(mask, int(nvec))
        return (flags if flags.any() else ~flags).astype(np.int8)
    if _is_flat(mask, nvec):
        mask = np.split(np.asarray(mask), np.cumsum(nvec)[:-1])
    if not isinstance(mask, tuple | list | np.ndarray) or len(mask) != len(nvec):
        raise _unfit(f"a tuple of {len(nvec)} masks", type(mask).__qualname__)
    return tuple(_multi(part, one) for part, one in zip(nvec, mask, strict=True))


def _is_flat(mask: object, nvec: NDArray[Any]) -> bool:
    if not isinstance(mask, np.ndarray) or mask.dtype == object:
        return False
    return nvec.ndim == 1 and mask.shape == (int(nvec.sum()),)


def unreadable(mask: object) -> BaseException | None:
    """The exception that the mask's own code raises when it is read or recorded, if it does."""
    try:
        if not _is_plain(mask):
            np.asarray(mask)
            isinstance(mask, np.ndarray)  # asks for its class, as recording does
        to_json(mask)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # an environment's object may raise anything
        return error
    return None


def _is_plain(mask: object) -> bool:
    """The mask holds no code of the environment's: NumPy refuses it for its form alone."""
    if type(mask) in (tuple, list):
        return all(map(_is_plain, cast("list[object]", mask)))
    return type(mask) in _PLAIN


def _unfit(expected: object, seen: str) -> PolicyError:
    return PolicyError(
        "the action mask doesn't fit the action space",
        expected=f"{expected} numbers" if isinstance(expected, int) else str(expected),
        actual=seen,
        fix="say where the mask stands: roles.<role>.mask in the contract",
    )
