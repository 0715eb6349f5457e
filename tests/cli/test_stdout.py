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
    line = ["rollout", *rough(is_loud=True, length=2), "--episodes", "1", "--json"]
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
    words = [sys.executable, "-m", "gamekeeper", "rollout", LINE, "--episodes", "1", "--out", "run"]
    line = f"exec {shlex.join(words)} <&- >&- 2>&-"
    done = subprocess.run(["sh", "-c", line], env=SURROUNDINGS, cwd=tmp_path, check=False)
    assert done.returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run"]
    assert (tmp_path / "run" / "agent_steps.parquet").is_file()


LINES = [
    ["verify", "RUN"],
    ["show", "RUN", "--json"],
    ["diff", "RUN", "RUN"],
    ["list"],
    ["contract", LINE],
    ["query", "RUN"],
    ["nonsense", "--json"],
    ["verify", "--help"],
    ["--help"],
    ["--version"],
]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux alone has a file that is full")
@pytest.mark.parametrize(
    "line", LINES, ids=lambda line: " ".join(line).replace(LINE, "two_robot_line")
)
def test_stdout_that_is_full_is_no_verdict(line: list[str], line_run: Path) -> None:
    """Whatever the command: exit code 2, since 1 would say that a run is damaged, and a line."""
    words = [str(line_run) if word == "RUN" else word for word in line]
    with Path("/dev/full").open("w") as full:
        done = run_to(full.fileno(), *words)
    assert done.returncode == 2
    if line[0] == "nonsense":  # wrong use has its reason on stderr anyway
        assert "No such command" in done.stderr
        assert "Traceback" not in done.stderr
    else:
        assert done.stderr == "stdout can't be written: No space left on device\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux alone has a file that is full")
def test_work_is_finished_when_stdout_is_full(tmp_path: Path) -> None:
    """A recording is whole, though nothing could be told of it; the same where stderr is full."""
    from gamekeeper.runs.run_check import verify

    with Path("/dev/full").open("w") as full:
        for name, streams in (("one", {"stderr": subprocess.DEVNULL}), ("two", {"stderr": full})):
            line = ["rollout", LINE, "--episodes", "1", "--out", str(tmp_path / name)]
            done = subprocess.run(
                [sys.executable, "-m", "gamekeeper", *line],
                env=SURROUNDINGS,
                stdout=full,
                check=False,
                **streams,
            )
            assert done.returncode == 2
            assert verify(tmp_path / name).ok


def run_to(stdout: int, *line: str) -> "subprocess.CompletedProcess[str]":
    """A command in a process of its own that writes there."""
    return subprocess.run(
        [sys.executable, "-m", "gamekeeper", *line],
        env=SURROUNDINGS,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )


def test_reader_that_leaves_ends_it_quietly(tmp_path: Path) -> None:
    """`gamekeeper show RUN | head -1` can't say what the command came to: exit code 2, no line."""
    read, write = os.pipe()
    os.close(read)
    try:
        done = run_to(write, "contract", LINE)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (2, "")


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
