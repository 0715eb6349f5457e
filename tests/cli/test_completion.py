"""A shell completes environments, runs, policies and checks."""

from pathlib import Path

import pytest

from gamekeeper.cli import _completion
from gamekeeper.cli._app import build_app


def test_environments_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ours by their short names, registered ids, and Python files."""
    monkeypatch.chdir(tmp_path)
    Path("wares.py").touch()
    assert {"warehouse", "warehouse_turns", "wares.py"} == set(_completion.environments("ware"))
    assert "classic/chess-v6" in _completion.environments("classic/")


def test_runs_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders with a manifest, in runs/ and in the folder that is typed."""
    monkeypatch.chdir(tmp_path)
    for name in ("runs/one", "runs/two", "deep/runs/other"):
        Path(name).mkdir(parents=True)
        (Path(name) / "manifest.json").touch()
    Path("runs/none").mkdir()
    assert _completion.runs("") == ["runs/one", "runs/two"]
    assert _completion.runs("runs/t") == ["runs/two"]
    assert _completion.runs("deep/runs/") == ["deep/runs/other"]


def test_policies_and_checks_are_completed() -> None:
    """Words for all agents or for one, and ids in capitals."""
    assert _completion.policies("r") == ["random", "reference"]
    assert _completion.policies("picker=no") == ["picker=noop"]
    assert "GK604" in _completion.checks("gk60")


def test_completion_is_wired(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What bash asks is answered by the commands themselves."""
    monkeypatch.setenv("_GAMEKEEPER_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "gamekeeper explain GK60")
    monkeypatch.setenv("COMP_CWORD", "2")
    with pytest.raises(SystemExit):
        build_app()([], prog_name="gamekeeper")
    assert "GK604" in capsys.readouterr().out.split()
