"""Lines that use global generators or the system's entropy are named."""

from __future__ import annotations

import inspect
import random
import sys
from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.draw_places import OwnCode, entropy_lines, moving_lines
from tests.faults.rovers import Rovers

OWN = OwnCode(frozenset({"tests"}))


def line_of(function: Any, text: str) -> str:
    """File and line of the one line of a function that holds a text."""
    lines, first = inspect.getsourcelines(function)
    (number,) = (first + k for k, line in enumerate(lines) if text in line)
    return f"{inspect.getsourcefile(function)}:{number}"


class Gusts(Rovers):
    """Seeds NumPy's generator at a reset, and draws the wind from it."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """As it is, with a generator that isn't its own."""
        np.random.seed(seed)
        return super().reset(seed, options)

    def step(self, actions: Any) -> Any:
        """Pays by the wind."""
        out = super().step(actions)
        wind = [np.random.random() for _ in out[1]]
        return (out[0], dict(zip(out[1], wind, strict=True)), *out[2:])


class Lucky(Rovers):
    """Builds a generator of its own at each reset, of which no seed knows."""

    def step(self, actions: Any) -> Any:
        """Pays by luck."""
        out = super().step(actions)
        luck = np.random.default_rng().random()
        return (out[0], dict.fromkeys(out[1], luck), *out[2:])


def shuffled() -> list[int]:
    """Draws by a function of the standard library, between lines that don't draw."""
    cards = [1, 2, 3]
    random.shuffle(cards)
    return sorted(cards)


def test_line_that_draws_is_named_and_not_the_library_that_draws_for_it() -> None:
    """The first generator is used by one line, the other by none."""
    with moving_lines(OWN, ["random", "numpy.random"]) as lines:
        shuffled()
    assert lines == {"random": [line_of(shuffled, "shuffle(cards)")], "numpy.random": []}
    assert sys.gettrace() is None


def test_lines_are_left_to_another_tracer() -> None:
    """A debugger goes on as it did."""

    def other(*_: Any) -> None:
        return None

    sys.settrace(other)
    try:
        with moving_lines(OWN, ["random"]) as lines:
            shuffled()
        assert sys.gettrace() is other
    finally:
        sys.settrace(None)
    assert lines == {"random": []}


def unseeded() -> None:
    """Builds generators with a seed and without one."""
    np.random.default_rng(3)
    random.Random(3)
    np.random.default_rng()
    random.Random()
    random.seed()


def test_lines_that_ask_for_entropy_are_named() -> None:
    """A generator that has its seed asks for nothing."""
    seed, randbits = random.Random.seed, np.random.bit_generator.randbits  # type: ignore[attr-defined]  # which no stub names
    with entropy_lines(OWN) as lines:
        unseeded()
    asking = "default_rng()", "Random()", "random.seed()"
    assert lines == [line_of(unseeded, text) for text in asking]
    assert seed is random.Random.seed
    assert randbits is np.random.bit_generator.randbits  # type: ignore[attr-defined]  # as above


@pytest.mark.parametrize(
    ("kind", "id", "method", "text"),
    [
        (Gusts, "GK602", "step", "np.random.random()"),
        (Gusts, "GK602", "reset", "np.random.seed"),
        (Lucky, "GK601", "step", "default_rng()"),
    ],
)
def test_audit_names_the_lines_that_draw(kind: Any, id: str, method: str, text: str) -> None:
    """A finding has file and line of the environment."""
    found = audit_here(kind, select=(id,), budget=300).of(id)
    assert found.outcome == "failed"
    assert line_of(getattr(kind, method), text) in found.findings[0].lines
