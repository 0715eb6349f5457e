import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from gamekeeper import cli
from gamekeeper.cli import _app
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import EnvError, SpecError
from tests.cli.lines import SURROUNDINGS, said

COMMANDS = ["run", "contract", "rollout", "replay", "diff", "verify", "recover", "show"]


def with_command(monkeypatch: pytest.MonkeyPatch, command: Any, name: str = "probe") -> None:
    """Makes a function the only command."""
    module = SimpleNamespace(command=command)
    monkeypatch.setattr(_app, "commands", lambda: [(name, module), ("other", module)])


def test_commands_are_the_modules_of_the_package() -> None:
    """Every module without an underscore is a command, in the order of a user's work."""
    modules = {path.stem for path in Path(cli.__file__).parent.glob("[!_]*.py")}
    names = [name for name, _ in _app.commands()]
    assert {name.replace("-", "_") for name in names} == modules
    assert [name for name in names if name in COMMANDS] == COMMANDS


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command_is_a_result(name: str) -> None:
    """Help goes to stdout, exits 0, and names the options that every command takes."""
    done = CliRunner().invoke(_app.build_app(), [name, "--help"], env={"COLUMNS": "120"})
    assert done.exit_code == 0
    assert "--json" in done.stdout
    assert "--quiet" in done.stdout


def test_version_is_said(capfd: pytest.CaptureFixture[str]) -> None:
    """`gamekeeper --version` names program and version."""
    assert said(capfd, "--version") == (0, "gamekeeper 0.1.0\n", "")


def test_help_needs_no_numpy() -> None:
    """What is heavy is imported by the commands that need it, not to show their names."""
    code = "import sys; from gamekeeper.cli import main; main(['--help']); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], env=SURROUNDINGS, capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert loaded & {"numpy", "pyarrow", "gymnasium", "pettingzoo", "asyncio"} == set()


@pytest.mark.parametrize(
    "line", [["no-such-command"], ["show"], ["show", "x", "--no-such-option"], ["diff", "one"]]
)
def test_wrong_use_exits_2(line: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    """A line that can't be read says so on stderr; stdout stays empty."""
    code, out, err = said(capfd, *line)
    assert (code, out) == (2, "")
    assert "Usage: gamekeeper" in err


def test_wrong_use_is_a_document_with_json(capfd: pytest.CaptureFixture[str]) -> None:
    """With --json a line that can't be read is a document too."""
    code, out, _ = said(capfd, "show", "--json")
    assert code == 2
    assert "RUN" in json.loads(out)["error"]["what"]


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (EnvError("it raised", where="episode 3"), 1),
        (SpecError("no such thing", expected="a", actual="b", fix="write a"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_error_has_its_exit_code(
    error: BaseException,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """1 where an environment failed, 2 for wrong use, 130 for Ctrl-C; the text is on stderr."""

    def command(screen: Screen) -> CommandResult:
        raise error

    with_command(monkeypatch, command)
    seen, out, err = said(capfd, "probe")
    assert (seen, out) == (code, "")
    assert str(error) in err
    assert "Traceback" not in err
    assert list(json.loads(said(capfd, "probe", "--json")[1])) == ["error"]


def test_error_document_has_every_part(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """What, where, expected, actual and fix stand apart, beside the kind of the error."""

    def command(screen: Screen) -> CommandResult:
        raise SpecError("no such thing", where="here", expected="a", actual="b", fix="write a")

    with_command(monkeypatch, command)
    expected = {
        "kind": "SpecError",
        "what": "no such thing",
        "where": "here",
        "expected": "a",
        "actual": "b",
        "fix": "write a",
    }
    assert json.loads(said(capfd, "probe", "--json")[1]) == {"error": expected}


def test_fault_of_ours_is_called_one(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """What nobody foresaw shows its traceback and says whose fault it is."""

    def command(screen: Screen) -> CommandResult:
        raise ZeroDivisionError("nobody foresaw this")

    with_command(monkeypatch, command)
    code, _, err = said(capfd, "probe")
    assert code == 2
    assert "nobody foresaw this" in err
    assert "fault of gamekeeper" in err


def test_common_option_that_changes_nothing_is_taken(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Scripts may hand every command the same options; a note says which did nothing."""

    def command(screen: Screen) -> CommandResult:
        return CommandResult({"done": True})

    with_command(monkeypatch, command)
    common = ["--seed", "7", "--workers", "1", "--policy", "noop"]
    code, out, err = said(capfd, "probe", *common, "--json")
    assert (code, json.loads(out)) == (0, {"done": True})
    assert "note: --seed has no effect on probe" in err
    assert "--policy" in err
    assert "--workers" not in err  # 1 is what it is anyway
    assert said(capfd, "probe", *common, "--quiet")[2] == ""


def test_number_that_json_lacks_is_null(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """NaN and infinity never stand in a document: strict readers refuse them."""

    def command(screen: Screen) -> CommandResult:
        return CommandResult(
            {"mean": float("nan"), "all": [1.0, float("inf")], "agent": {"x": -0.5}}
        )

    with_command(monkeypatch, command)
    out = said(capfd, "probe", "--json")[1]
    assert json.loads(out) == {"mean": None, "all": [1.0, None], "agent": {"x": -0.5}}


@pytest.mark.parametrize("line", [("show",), ("query", "--sql", "select 1"), ("verify",)])
def test_name_that_is_too_long_is_told(
    line: tuple[str, ...], capfd: pytest.CaptureFixture[str]
) -> None:
    """It is what was typed, and no fault of ours."""
    code, out, err = said(capfd, line[0], "a" * 5_000, *line[1:])
    assert code == 2
    assert "fault of gamekeeper" not in out + err
    assert len(err) < 2_000
