"""What an exception says is foreign code, and never gets in the way."""

from typing import Any

import pytest

from benchmarks.attacking.hostile import TEXTS
from benchmarks.attacking.hostile_env import error_of, value_of
from gamekeeper.episodes.canonical import shown, to_json, type_name
from gamekeeper.episodes.exception_text import (
    MESSAGE_CHARS,
    TRACEBACK_CHARS,
    message,
    said_by,
    traceback_text,
)


@pytest.mark.parametrize("way", TEXTS)
def test_raised_texts_of_hostile_exceptions_are_texts(way: str) -> None:
    """Whatever `__str__` and `__repr__` do, what is said of it is a bounded text of UTF-8."""
    error = error_of(way)
    for text, most in (
        (message(error), MESSAGE_CHARS),
        (said_by(error), MESSAGE_CHARS),
        (traceback_text(error), TRACEBACK_CHARS),
    ):
        assert type(text) is str
        assert 0 < len(text.encode()) <= most + 200


def test_raised_texts_survive_attributes_that_raise() -> None:
    """Also where the notes, the cause and the traceback of an exception can't be looked at."""

    class HostileError(Exception):
        __notes__: Any = property(lambda self: 1 / 0)
        __cause__: Any = property(lambda self: 1 / 0)
        __traceback__: Any = property(lambda self: 1 / 0)

    assert "HostileError: said" in traceback_text(HostileError("said"))


@pytest.mark.parametrize("way", ["raises", "raises-base", "raises-exit", "attribute", "class"])
@pytest.mark.parametrize("base", [object, str, dict, list, float])
def test_canon_writes_any_value(base: type, way: str) -> None:
    """A value whose methods raise anything has a text, alone and within others."""
    value = value_of(base, way)
    assert to_json(value)
    assert to_json({"value": [value]})
    assert type(shown(value)) is type(type_name(value)) is str
