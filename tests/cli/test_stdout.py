import io
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from gamekeeper.cli._screen import Screen
from tests.cli.lines import LINE, SURROUNDINGS, rough, run_apart

NOISES = [
    "printed on import",
    "print of the environment",
    "bytes of the environment",
    "a program of the environment",
]


def test_stdout_holds_one_document_whatever_is_printed(tmp_path: Path) -> None:
    """Prints of Python, raw bytes and started programs of an environment all arrive at stderr."""
    line = ["record", *rough(is_loud=True, length=2), "--episodes", "1", "--json"]
    done = run_apart(*line, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["turns"] == 2
    assert done.stdout.count("\n") == 1
    assert [noise for noise in NOISES if noise not in done.stderr] == []


def test_claimed_stdout_turns_everything_over(tmp_path: Path) -> None:
    """While stdout is claimed, its descriptor is that of stderr; afterwards all is as it was."""
    code = """if True:
        import os, subprocess
        from gamekeeper.cli._stdout import claimed_stdout
        print("before")
        with claimed_stdout() as out:
            print("python")
            os.write(1, b"raw\\n")
            subprocess.run(["echo", "program"])
            out.write("result\\n")
        print("after")
    """
    done = subprocess.run(
        [sys.executable, "-c", code], env=SURROUNDINGS, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["before", "result", "after"]
    assert sorted(done.stderr.split()) == ["program", "python", "raw"]


def test_closed_streams_are_survived(tmp_path: Path) -> None:
    """A service that has closed its standard streams can record all the same."""
    words = [sys.executable, "-m", "gamekeeper", "record", LINE, "--episodes", "1", "--out", "run"]
    line = f"exec {shlex.join(words)} <&- >&- 2>&-"
    done = subprocess.run(["sh", "-c", line], env=SURROUNDINGS, cwd=tmp_path, check=False)
    assert done.returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]
    assert (tmp_path / "run" / "steps.parquet").is_file()


def test_reader_that_leaves_is_no_error(tmp_path: Path) -> None:
    """`gamekeeper show RUN | head -1` ends quietly when head has had enough."""
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "gamekeeper", "contract", LINE],
            env=SURROUNDINGS,
            stdout=write,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("variables", [{}, {"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_colours_need_a_terminal_that_wants_them(
    variables: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a terminal headings are bold, unless NO_COLOR or a dumb terminal says otherwise."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file):
        Screen(stream).show("Agents  two\n  picker")
        Screen(stream).verdict("verified: all", "good")
    plain = "Agents  two\n  picker\nverified: all\n"
    bold = "\033[1mAgents\033[0m  two\n  picker\n\033[1;32mverified: all\033[0m\n"
    assert file.getvalue() == plain
    assert terminal.getvalue() == (plain if variables else bold)
