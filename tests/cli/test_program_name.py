"""Commands that are shown name the program as the person started it."""

import sys
from pathlib import Path

import pytest

from gamekeeper.cli._screen import as_typed

LINE = "Next  gamekeeper show runs/x; `gamekeeper replay RUN` or gamekeeper set-up, .gamekeeper run"


@pytest.mark.parametrize(
    ("argv", "orig", "name"),
    [
        ("/usr/lib/gamekeeper/__main__.py", ".venv/bin/python", ".venv/bin/python -m gamekeeper"),
        ("/nowhere/gamekeeper", "python", "gamekeeper"),
        ("/usr/bin/pytest", "python", "gamekeeper"),
    ],
)
def test_commands_are_named_as_typed(
    argv: str, orig: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a module the interpreter, too; words after the name that are no command stay."""
    monkeypatch.setattr(sys, "argv", [argv, "run"])
    monkeypatch.setattr(sys, "orig_argv", [orig, "-m", "gamekeeper", "run"])
    assert as_typed(LINE) == LINE.replace("gamekeeper show", f"{name} show").replace(
        "`gamekeeper replay", f"`{name} replay"
    )


def test_script_is_named_by_its_path_where_the_shell_has_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`.venv/bin/gamekeeper` as it was typed; its name alone once it is first on the PATH."""
    script = tmp_path / "bin" / "gamekeeper"
    script.parent.mkdir()
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["bin/gamekeeper"])
    monkeypatch.setenv("PATH", "/nowhere")
    assert as_typed("gamekeeper run x") == "bin/gamekeeper run x"
    monkeypatch.setenv("PATH", str(script.parent))
    assert as_typed("gamekeeper run x") == "gamekeeper run x"
