"""In which order this process lists a set of names; loads nothing, as it is asked for often."""

from __future__ import annotations

from collections.abc import Callable


def order_task(report: Callable[..., None], *, names: list[str]) -> list[str]:
    """The names in the order in which a set of them is iterated over here."""
    return list(set(names))
