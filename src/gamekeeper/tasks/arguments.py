"""Checks of arguments that all tasks share."""

from typing import Final

import numpy as np

from gamekeeper.errors import SpecError

NEVER: Final = 1 << 62
"""More ticks than are ever played: the horizon of a task without one."""


def check_whole(name: str, value: object, least: int, most: int | None = None) -> None:
    """Refuses an argument that isn't a whole number in its range.

    Args:
        least, most: ends of the range; None: there is no upper end.
    Raises:
        SpecError: it isn't one.
    """
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if is_whole and least <= value and (most is None or value <= most):  # type: ignore[operator]  # it is a number
        return
    bounds = f"{least} or more" if most is None else f"from {least} to {most}"
    raise SpecError(
        f"the task can't be made with {name}={value!r}",
        where=name,
        expected=f"a whole number, {bounds}",
        actual=repr(value),
        fix=f"give {name} as a whole number, {bounds}",
    )


def check_part(name: str, value: object) -> None:
    """Refuses an argument that isn't a number from 0 to 1.

    Raises:
        SpecError: it isn't one.
    """
    if isinstance(value, int | float) and 0.0 <= value <= 1.0:
        return
    raise SpecError(
        f"the task can't be made with {name}={value!r}",
        where=name,
        expected="a number from 0 to 1",
        actual=repr(value),
        fix=f"give {name} as a number from 0 to 1",
    )
