import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.adapters.export_source import Export
from gamekeeper.cli import export
from gamekeeper.plugins import Plugins
from tests.cli.lines import document, said


def test_export_writes_arrays(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The document says where they are, of whom, and how many rows."""
    out = tmp_path / "sub" / "line.npz"
    code, found = document(capfd, "export", line_run, "--to", "numpy", "--out", out)
    assert code == 0
    assert found == {
        "run": str(line_run),
        "to": "numpy",
        "path": str(out),
        "agents": ["picker", "carrier"],
        "episodes": 3,
        "rows": gk.load(line_run).agent_steps.num_rows,
        "parts": [],
        "lost": ["by which terms 24 rewards were paid (NaN): the run doesn't say"],
    }
    with np.load(out) as arrays:
        about = json.loads(str(arrays["metadata"]))
    assert about["fingerprint"] == gk.load(line_run).fingerprint


def test_export_shows_what_it_wrote(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One line on stdout; `.npz` is put behind a name without it."""
    line = ["export", line_run, "--to", "numpy", "--out", tmp_path / "line", "--agent", "picker"]
    code, out, err = said(capfd, *line)
    lost = "lost: by which terms 12 rewards were paid (NaN): the run doesn't say\n"
    assert (code, err) == (0, lost)
    assert out.startswith(f"Exported  {tmp_path / 'line.npz'}: ")


def test_export_says_on_stderr_what_is_lost(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each loss is a note, and stands in the document."""
    gk.rollout("two_robot_line", episodes=1, level="digest", out=tmp_path / "run")
    line = ["export", tmp_path / "run", "--to", "numpy", "--out"]
    assert "lost: observations" in said(capfd, *line, tmp_path / "a")[2]
    assert said(capfd, *line, tmp_path / "b", "--quiet")[2] == ""
    assert "digest" in document(capfd, *line, tmp_path / "c")[1]["lost"][0]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["RUN", "--to", "csv", "--out", "x"], "no exporter is called 'csv'"),
        (["RUN", "--to", "numpy"], "no file is named"),
        (["RUN", "--to", "numpy", "--out", ""], "a folder has this name"),
        (["RUN", "--to", "numpy", "--out", "/"], "a folder has this name"),
        (
            ["RUN", "--to", "numpy", "--out", "x", "--agent", "wolf"],
            "the run has no agent called 'wolf'",
        ),
        (["nothing", "--to", "numpy", "--out", "x"], "there is no run here"),
        (["RUN"], "Missing option"),
        (["import", "RUN", "--out", "x"], "names no form of data"),
        (["import", "numpy:x.npz", "--out", "x"], "nothing reads 'numpy:'"),
        (["import", "minari:a/b-v0"], "Missing option"),
    ],
)
def test_export_and_import_refuse_what_makes_no_sense(
    words: list[str],
    told: str,
    line_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2, the reason on stderr, nothing on stdout or on disk."""
    monkeypatch.chdir(tmp_path)
    line = [str(line_run) if word == "RUN" else word for word in words]
    command = [] if line[0] == "import" else ["export"]
    code, out, err = said(capfd, *command, *line)
    assert (code, out) == (2, "")
    assert told in err
    assert list(tmp_path.iterdir()) == []


def test_export_replaces_an_earlier_file_and_keeps_evidence(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A file of that name is written over, unless it is part of a run."""
    (tmp_path / "line.npz").write_text("earlier")
    line = ["export", line_run, "--to", "numpy", "--out"]
    assert document(capfd, *line, tmp_path / "line.npz")[0] == 0
    assert (tmp_path / "line.npz").read_bytes()[:2] == b"PK"
    (tmp_path / "manifest.json").write_text("{}")
    code, found = document(capfd, *line, tmp_path / "line.npz")
    assert (code, found["error"]["kind"]) == (2, "RunError")
    assert found["error"]["fix"] == "--out line.npz in another folder"


@pytest.mark.parametrize(("form", "package"), [("minari", "minari"), ("rerun", "rerun")])
def test_export_names_the_extra_that_is_missing(
    form: str,
    package: str,
    line_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Where the other's package isn't installed, the fix is what to type."""
    monkeypatch.setitem(sys.modules, package, None)
    for name in [name for name in sys.modules if name.startswith(f"{package}.")]:
        monkeypatch.setitem(sys.modules, name, None)
    line = ["export", line_run, "--to", form, "--out", tmp_path / "x"]
    code, found = document(capfd, *line)
    assert code == 2
    assert found["error"]["fix"] == f"pip install 'gamekeeper[{form}]'"
    assert list(tmp_path.iterdir()) == []


def test_export_takes_what_packages_bring(
    line_run: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A form may be a function or a module; one with `load` is read under its name."""

    def write(run: Any, out: Any, *, agents: Any, say: Any) -> Export:
        """Writes nothing."""
        say("lost: everything")
        return Export("void", "nowhere", tuple(agents or ()), 3, 0)

    def load(data: str) -> Any:
        assert data == "there"
        return gk.load(line_run)

    theirs = {"void": write, "other": SimpleNamespace(export=write, load=load)}
    monkeypatch.setattr(export, "found", lambda: Plugins(theirs))
    code, out, err = said(capfd, "export", line_run, "--to", "void", "--agent", "picker")
    assert (code, out) == (0, "Exported  nowhere: 0 rows of 3 episodes\n")
    assert err == "lost: everything\n"
    assert said(capfd, "export", "other:there", "--to", "void")[0] == 0
    assert "nothing reads 'void:'" in said(capfd, "export", "void:there", "--to", "void")[2]
