"""The way to standard error."""

import sys
from typing import Any

import pytest

from benchmarks.attacking.hostile_env import value_of
from gamekeeper.terminal import say


def test_say_writes_control_characters_out(capsys: pytest.CaptureFixture[str]) -> None:
    """No terminal is steered by a text that quotes foreign code."""
    say("a\x1b[2Jb\x9b\ud800\tc\nd")
    assert capsys.readouterr().err == "a\\u001b[2Jb\\u009b\\ud800\tc\nd\n"


@pytest.mark.parametrize("stream", [None, object(), value_of(object, "raises-exit")])
def test_say_needs_no_stream(
    stream: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """An environment may have closed or replaced it."""
    monkeypatch.setattr(sys, "stderr", stream)
    say("said")
    monkeypatch.undo()
    assert capfd.readouterr().err == "said\n"
