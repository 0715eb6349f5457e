"""The set-up says what is missing and how to fix it, on machines that lack something."""

import os
import stat
import subprocess
from pathlib import Path

import pytest

from tests.surface.sources import ROOT

SETUP = ROOT / "requirements" / "setup.sh"
TOOLS = ["sh", "cat", "date", "du", "cut", "grep", "tail"]


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A folder that is the whole PATH of a machine: a few tools, no Python."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for tool in TOOLS:
        found = next(p for d in os.get_exec_path() if (p := Path(d) / tool).exists())
        (folder / tool).symlink_to(found)
    return folder


def add_script(folder: Path, name: str, body: str) -> None:
    """Puts a shell script into a folder of programs."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


def add_python(folder: Path, name: str, version: str, *, venv: bool) -> None:
    """Puts a stand-in for Python there, which knows its version and whether it has venv."""
    body = f'case "$*" in *version_info*) echo {version};; *ensurepip*) exit {0 if venv else 1};;'
    add_script(folder, name, f'{body} *) echo "$0 $*";; esac')


def run_setup(machine: Path, *arguments: str, **env: str) -> subprocess.CompletedProcess[str]:
    """What the set-up does on that machine."""
    return subprocess.run(
        [machine / "sh", SETUP, *arguments],
        env={"PATH": str(machine), **env},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("pythons", "words"),
    [
        ([], "seen: none"),
        ([("python3", "3.9", True)], "python3 is 3.9"),
        ([("python3", "3.99", True)], "python3 is 3.99"),
        ([("python3.12", "3.12", False)], "apt-get install python3.12-venv"),
    ],
    ids=["none", "old", "too new", "no venv"],
)
def test_setup_names_the_missing_python(
    machine: Path, pythons: list[tuple[str, str, bool]], words: str
) -> None:
    """A machine without a suitable Python is told which is wanted, what was seen, and the fix."""
    for name, version, venv in pythons:
        add_python(machine, name, version, venv=venv)
    done = run_setup(machine, "make", "env")
    assert done.returncode == 1
    assert words in done.stderr
    assert "fix: " in done.stderr


def test_setup_takes_the_newest_python(machine: Path) -> None:
    """Of several interpreters the newest with a whole venv module is taken."""
    add_python(machine, "python3", "3.11", venv=True)
    add_python(machine, "python3.12", "3.12", venv=True)
    add_python(machine, "python3.13", "3.13", venv=False)
    done = run_setup(machine, "make", "env")
    assert done.returncode == 0
    assert "Python 3.12 (python3.12)" in done.stdout
    assert "python3.12 -m venv --clear env" in done.stdout


def test_setup_obeys_a_named_python(machine: Path) -> None:
    """PYTHON=… is taken, or refused by name; nothing else is tried."""
    add_python(machine, "python3.12", "3.12", venv=True)
    add_python(machine, "mine", "3.11", venv=True)
    assert "Python 3.11 (mine)" in run_setup(machine, "make", "env", PYTHON="mine").stdout
    assert "nowhere can't be run" in run_setup(machine, "make", "env", PYTHON="nowhere").stderr


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("NewConnectionError: name resolution", "no way to the package index"),
        ("OSError: [Errno 28] No space left on device", "the disk is full"),
        ("THESE PACKAGES DO NOT MATCH THE HASHES", "not the one that was locked"),
        ("something else", "pip could not install"),
    ],
)
def test_setup_explains_a_failed_pip(machine: Path, tmp_path: Path, said: str, words: str) -> None:
    """What pip said is shown, then what it most likely means and the fix."""
    env = tmp_path / "env"
    add_script(env / "bin", "python", f'echo "{said}"; exit 1')
    done = run_setup(machine, "install", str(env), "requirements/base.txt")
    assert done.returncode == 1
    assert said in done.stderr
    assert words in done.stderr
    assert "fix: " in done.stderr
