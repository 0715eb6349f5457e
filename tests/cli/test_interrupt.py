"""Ctrl-C, wherever a command is: 130, no traceback, nothing left behind."""

import random
from typing import Any

import pytest

from benchmarks import interrupt
from gamekeeper.cli import _app, main
from gamekeeper.errors import RunError


def test_clean_up_that_fails_after_ctrl_c_is_an_interrupt(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An error that a `finally` raises in place of the interrupt doesn't hide it."""

    def command(*_: object, **__: object) -> Any:
        try:
            raise KeyboardInterrupt
        finally:
            raise RunError("the draft can't be taken away")

    screen = _app.Screen(out=__import__("sys").stdout)
    assert _app._performed(command, screen, {}, idle_policies=None) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_ctrl_c_while_the_command_line_is_made_exits_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Importing the commands takes a moment, in which nobody wants a traceback either."""

    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(_app, "build_app", interrupted)
    assert main(["list"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_commands_that_are_interrupted_leave_nothing_behind() -> None:
    """Each long command, at a random instant of its first seconds; see benchmarks/interrupt.py."""
    with interrupt.bench(seed=5) as made:
        names = random.Random(5).sample(sorted(interrupt.COMMANDS), 6)
        for name in names:
            figures = interrupt.interrupted(made, name, instants=1, life_s=2.0)
            assert interrupt.is_whole(figures), figures
