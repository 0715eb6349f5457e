"""What an audit's processes print: the environment's is counted, Gamekeeper's own said once."""

import io
from pathlib import Path

import pytest

from gamekeeper.cli._audit import _told_prints
from gamekeeper.cli._screen import Screen

NOTE = "gamekeeper: kernels run as plain Python\n"


@pytest.mark.parametrize(("printed", "size"), [(NOTE * 3, 0), (f"{NOTE}abc\n{NOTE}", 4)])
def test_notes_of_several_processes_are_said_once_and_not_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], printed: str, size: int
) -> None:
    """Three processes say the same; the file stays where the environment printed too."""
    path = tmp_path / "prints.txt"
    with _told_prints(Screen(io.StringIO()), path):
        path.write_text(printed)
    said = capsys.readouterr().err
    assert said.count("plain Python") == 1
    assert path.exists() == bool(size) == (f"printed {size} bytes" in said)
