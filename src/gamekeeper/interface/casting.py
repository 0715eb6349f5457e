"""Values made an environment's own to give: copies, exactly of the type that their space says.

A space is read once and becomes one function. What has the space's dtype and shape is copied, and
nothing else about it is looked at, bounds included (the audit does, GK213). Anything else is
converted only where nothing is lost: as numbers, both are equal.
"""

import copy
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import GraphInstance

Cast: TypeAlias = Callable[[Any], Any]
"""From a value to a copy of it, of the type that a space says; raises a `CastError`."""


class Casts(dict[Any, Cast]):
    """Functions by agent; a copy or a pickle of it is empty, and they are made again."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Leaves the functions out."""
        return Casts, ()


ARRAYS: Final = (spaces.Box, spaces.MultiDiscrete, spaces.MultiBinary)
_NUMBERS: Final = "biufc"
_SHOWN: Final = 120  # characters of a value in an error


class CastError(Exception):
    """A value that its space has no exact form for."""

    def __init__(self, expected: str, actual: str, fix: str, path: str = "") -> None:
        super().__init__(expected, actual)
        self.expected, self.actual, self.fix, self.path = expected, actual, fix, path


def own(value: Any) -> Any:
    """The value with new containers and arrays, all the way down; other objects as they are."""
    if isinstance(value, np.ndarray):
        return copy.deepcopy(value) if value.dtype.hasobject else value.copy()
    if isinstance(value, dict):
        return {key: own(part) for key, part in value.items()}
    if type(value) in (list, tuple):
        return type(value)([own(part) for part in value])
    return copy.copy(value) if isinstance(value, set | bytearray) else value


def cast_to(space: spaces.Space[Any], without: str | None = None) -> Cast:
    """Function that copies and converts values to a space.

    Args:
        space: of Gymnasium's kinds; values of others are copied deeply and not looked at.
        without: a key of a Dict space that the base fills in itself, where the value lacks it.
    """
    if isinstance(space, ARRAYS):
        return _to_array(np.dtype(space.dtype), tuple(space.shape or ()))
    if isinstance(space, spaces.Discrete):
        return _to_whole(space)
    if isinstance(space, spaces.Dict):
        return _to_dict(space, without)
    if isinstance(space, spaces.Tuple):
        return _to_tuple([cast_to(part) for part in space.spaces])
    if isinstance(space, spaces.Text):
        return _to_text
    if isinstance(space, spaces.Sequence):
        return _to_sequence(space)
    if isinstance(space, spaces.Graph):
        return _to_graph
    return copy.deepcopy


def _to_array(dtype: np.dtype[Any], shape: tuple[int, ...]) -> Cast:
    array = np.ndarray

    def cast(value: Any) -> Any:
        if type(value) is array and value.shape == shape:
            found = value.dtype
            if found is dtype or found == dtype:
                return value.copy()
        return _converted(value, dtype, shape)

    return cast


def _converted(value: Any, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Any:
    """A new array of the dtype and shape, equal to the value number by number."""
    expected = f"an array of {dtype} {list(shape)}"
    try:
        found = np.asarray(value)
    except Exception:  # a ragged list, or an object that says no in its own way
        raise CastError(expected, described(value), _arrays(dtype)) from None
    if found.dtype.kind not in _NUMBERS:
        raise CastError(expected, described(value), _arrays(dtype))
    if found.shape != shape:
        fix = f"return shape {shape}, or declare a space of shape {found.shape}"
        raise CastError(expected, f"shape {found.shape}", fix)
    with np.errstate(all="ignore"):  # what overflows isn't equal
        exact = found.astype(dtype)
        same = (exact == found) | ((exact != exact) & (found != found))  # or NaN in both
    if not same.all():
        first = found[~same][0] if found.ndim else found[()]
        raise CastError(
            expected,
            f"{first.item()!r} of {found.dtype}, which {dtype} can't hold exactly",
            f"round it yourself: np.asarray(..., np.{dtype}), or declare the space's "
            f"dtype=np.{found.dtype}",
        )
    return exact


def _arrays(dtype: np.dtype[Any]) -> str:
    return f"return np.array([...], np.{dtype})"


def _to_whole(space: spaces.Discrete) -> Cast:
    dtype = np.dtype(space.dtype)

    def cast(value: Any) -> Any:
        if type(value) is int or (isinstance(value, np.integer) and value.dtype == dtype):
            return value
        found = _converted(value, dtype, ())
        return found[()] if isinstance(value, np.generic | np.ndarray) else int(found)

    return cast


def _to_dict(space: spaces.Dict, without: str | None) -> Cast:
    parts = {key: cast_to(part) for key, part in space.spaces.items()}
    least = parts.keys() - {without}

    def cast(value: Any) -> Any:
        if not isinstance(value, Mapping) or not least <= value.keys() <= parts.keys():
            seen = f"the keys {list(value)}" if isinstance(value, Mapping) else described(value)
            fix = f"return a dictionary with the keys {sorted(map(str, least))}"
            raise CastError(f"a dictionary with the keys {list(parts)}", seen, fix)
        found = {}
        for key, part in parts.items():
            if key in value:
                try:
                    found[key] = part(value[key])
                except CastError as misfit:
                    misfit.path = f"[{key!r}]{misfit.path}"
                    raise
        return found

    return cast


def _to_tuple(parts: list[Cast]) -> Cast:
    def cast(value: Any) -> Any:
        if not isinstance(value, tuple | list) or len(value) != len(parts):
            fix = f"return a tuple of {len(parts)}"
            raise CastError(f"a tuple of {len(parts)}", described(value), fix)
        return tuple(_each(parts, value))

    return cast


def _each(casts: Any, values: Any) -> list[Any]:
    """Each value by its own function; an error knows the place."""
    found = []
    for place, (part, value) in enumerate(zip(casts, values, strict=True)):
        try:
            found.append(part(value))
        except CastError as misfit:
            misfit.path = f"[{place}]{misfit.path}"
            raise
    return found


def _to_text(value: Any) -> Any:
    if isinstance(value, str):
        return value
    raise CastError("a text", described(value), "return a str")


def _to_sequence(space: spaces.Sequence) -> Cast:
    part = cast_to(space.feature_space)
    if space.stack:
        return own

    def cast(value: Any) -> Any:
        if not isinstance(value, tuple | list):
            raise CastError("a tuple", described(value), "return a tuple")
        return tuple(_each([part] * len(value), value))

    return cast


def _to_graph(value: Any) -> Any:
    if isinstance(value, GraphInstance):
        return GraphInstance(*map(own, value))
    fix = "return a gymnasium.spaces.GraphInstance"
    raise CastError("a GraphInstance", described(value), fix)


def described(value: object) -> str:
    """A value in few words; of an array its dtype and shape."""
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} {list(value.shape)}"
    return f"{type(value).__name__}: {value!r}"[:_SHOWN]
