"""Lines of an environment that use global generators, or ask the system for entropy."""

import random
import sys
import sysconfig
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, Self

import numpy as np

from gamekeeper.auditing.source import own_packages
from gamekeeper.rollouts.process_randomness import states

MOST_LINES: Final = 3
"""Lines that are named for each generator."""
MOST_EVENTS: Final = 20_000
"""Calls, lines and returns that are looked at: about half a second."""
OURS: Final = __name__.partition(".")[0]
INSTALLED: Final = tuple(sysconfig.get_paths()[name] for name in ("stdlib", "purelib", "platlib"))
"""Folders of code that draws for another, unless it is of the environment's own packages."""


@dataclass(frozen=True, slots=True)
class OwnCode:
    """Code of an environment: of the packages of its classes, or of none that is installed."""

    packages: frozenset[str]

    @classmethod
    def of(cls, env: Any) -> Self:
        """That of an environment, whatever it is wrapped in."""
        return cls(own_packages(env) - {"gymnasium"})  # whose base class seeds for its child

    def place(self, frame: FrameType | None) -> str:
        """File and line of a frame; empty where it isn't the environment's."""
        package = _package(frame)
        if frame is None or package == OURS:
            return ""
        file = frame.f_code.co_filename
        is_own = package in self.packages or not file.startswith((*INSTALLED, "<"))
        return f"{file}:{frame.f_lineno}" if is_own else ""


def _package(frame: FrameType | None) -> str:
    return "" if frame is None else str(frame.f_globals.get("__name__")).partition(".")[0]


@contextmanager
def moving_lines(own: OwnCode, names: Collection[str]) -> Iterator[dict[str, list[str]]]:
    """Gives the lines that move global generators, by generator, the first to do so first.

    Where another tracer runs, as a debugger's, there are none.

    Args:
        own: code whose lines are named; those that draw for it aren't.
        names: the generators, as `states` names them.
    """
    found: dict[str, list[str]] = {name: [] for name in names}
    seen, last, left = states(), "", MOST_EVENTS

    def notice() -> None:
        now = states()
        for name in found:
            if now[name] != seen[name] and last and last not in found[name]:
                found[name].append(last)
        seen.update(now)

    def follow(frame: FrameType, event: str, arg: Any) -> Any:
        nonlocal last, left
        if event == "call" and not own.place(frame):
            return None
        left -= 1
        if left <= 0 or all(len(lines) >= MOST_LINES for lines in found.values()):
            sys.settrace(None)
            return None
        notice()
        last = own.place(frame.f_back if event == "return" else frame)
        return follow

    if sys.gettrace() is not None:
        yield found
        return
    sys.settrace(follow)
    try:
        yield found
    finally:
        sys.settrace(None)


@contextmanager
def entropy_lines(own: OwnCode) -> Iterator[list[str]]:
    """Gives the lines that ask the system for entropy, the first to do so first."""
    found: list[str] = []

    def note() -> None:
        frame: FrameType | None = sys._getframe(2)
        while _package(frame) != OURS and frame is not None and not own.place(frame):
            frame = frame.f_back
        place = own.place(frame)
        if place and place not in found and len(found) < MOST_LINES:
            found.append(place)

    def noted(call: Callable[..., Any], is_asked: Callable[..., bool]) -> Callable[..., Any]:
        def asked(*args: Any, **kwargs: Any) -> Any:
            if is_asked(*args, **kwargs):
                note()
            return call(*args, **kwargs)

        return asked

    places: tuple[tuple[Any, str, Callable[..., bool]], ...] = (
        (np.random.bit_generator, "randbits", lambda *args: True),
        (random.Random, "seed", lambda self, a=None, version=2: a is None),
        (random, "seed", lambda a=None, version=2: a is None),
    )
    before = [getattr(owner, name) for owner, name, _ in places]
    for (owner, name, is_asked), call in zip(places, before, strict=True):
        setattr(owner, name, noted(call, is_asked))
    try:
        yield found
    finally:
        for (owner, name, _), call in zip(places, before, strict=True):
            setattr(owner, name, call)
