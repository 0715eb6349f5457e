"""Numbers on the command line: each has an end, and what lies beyond it is refused."""

from typing import Any

import pytest
import typer

from gamekeeper.cli._app import build_app
from tests.cli.lines import said

BEYOND = str(10**30)
COUNTS = {"N", "S"}
"""How options that take a number or seconds call them; megabytes and tolerances have no end."""


def numbers() -> list[tuple[str, str]]:
    """Every command with each of its options that count something."""
    group: Any = typer.main.get_command(build_app())
    return [
        (name, each.opts[0])
        for name, command in group.commands.items()
        for each in command.params
        if each.param_type_name == "option" and each.metavar in COUNTS
    ]


def test_numbers_are_found() -> None:
    """The law below is asked of something."""
    assert {("rollout", "--episodes"), ("audit", "--seeds"), ("run", "--timeout")} <= {*numbers()}


@pytest.mark.parametrize(("command", "option"), numbers())
def test_number_beyond_all_bounds_is_refused(
    command: str, option: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """A mistake of a key's length is told before anything is opened."""
    code, out, err = said(capfd, command, f"{option}={BEYOND}", "somewhere")
    assert (code, out) == (2, "")
    assert option in err
    assert "less than" in err or "range" in err
