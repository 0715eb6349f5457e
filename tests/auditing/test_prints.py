"""Prints of an audit's processes: the environment's are counted, Gamekeeper's own said once."""

from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.auditing.audit_process import collected_prints
from gamekeeper.errors import GamekeeperError

NOTE = "gamekeeper: kernels run as plain Python\n"
LOUD = """
import os
import sys
from gamekeeper.tasks.two_robot_line import TwoRobotLine


def loud():
    print("loud on stdout")
    os.write(2, b"loud on stderr\\n")
    return TwoRobotLine()


def dying():
    os.write(2, b"last words\\n")
    os._exit(3)
"""


@pytest.mark.parametrize(("printed", "size"), [(NOTE * 3, 0), (f"{NOTE}abc\n{NOTE}", 4)])
def test_notes_of_several_processes_are_said_once_and_not_counted(printed: str, size: int) -> None:
    """Three processes say the same; the file stays where the environment printed too."""
    said: list[str] = []
    with collected_prints(said.append) as path:
        path.write_text(printed)
    assert said.count(NOTE.rstrip()) == 1
    assert path.exists() == bool(size) == any(f"printed {size} bytes" in each for each in said)
    path.unlink(missing_ok=True)


@pytest.fixture
def loud_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with a printing and a dying environment; its prints are collected beside it."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    path = tmp_path / "loud_line.py"
    path.write_text(LOUD)
    return path


def test_prints_from_python_lie_in_the_file_that_the_result_names(
    loud_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The caller's own streams get one line, beside that of a kernel that is compiled first."""
    result = gk.audit(f"{loud_file}:loud", budget=200, select=("GK1",))
    out, err = capfd.readouterr()
    printed = Path(result.prints).read_text()
    assert "loud on stdout" in printed
    assert "loud on stderr" in printed
    (told,) = [line for line in err.splitlines() if not line.startswith("gamekeeper: ")]
    assert (out, "loud on" in err, result.prints in told) == ("", False, True)
    assert result.to_json()["prints"] == result.prints


def test_prints_of_a_dying_environment_are_kept(
    loud_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The audit raises, and its one line says where the last words are."""
    with pytest.raises(GamekeeperError):
        gk.audit(f"{loud_file}:dying", budget=200)
    (kept,) = loud_file.parent.glob("gamekeeper-*.txt")
    assert "last words" in kept.read_text()
    assert str(kept) in capfd.readouterr().err


def test_prints_of_a_silent_environment_are_no_file(
    loud_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """No line, no file."""
    result = gk.audit("two_robot_line", budget=200, select=("GK1",))
    assert result.prints == ""
    assert not list(loud_file.parent.glob("gamekeeper-*.txt"))
    assert capfd.readouterr().err == ""
