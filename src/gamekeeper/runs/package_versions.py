"""Versions of a package, each tried in a virtual environment that differs in that package alone."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import RunError

PIP: Final = (sys.executable, "-m", "pip", "--disable-pip-version-check")
TIMEOUT_S: Final = 600.0
"""Longest time that pip may take for one answer."""
NAME: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?")
VERSION: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9.!+_-]*")
LISTED: Final = re.compile(r"^Available versions: (.+)$", re.MULTILINE)


def versions_between(package: str, since: str | None, until: str | None) -> list[str]:
    """Versions that pip can install here, the oldest first: after `since`, up to `until`.

    Raises:
        RunError: pip knows no such package or version.
    """
    found = LISTED.search(_pip("index", "versions", _plain(NAME, package)))
    names = [each.strip() for each in found[1].split(",")][::-1] if found else []
    for each in filter(None, (since, until)):
        if each not in names:
            raise _none(package, f"no version {each} among {', '.join(names[-8:])}")
    first = 0 if since is None else names.index(since) + 1
    chosen = names[first : len(names) if until is None else names.index(until) + 1]
    if not chosen:
        raise _none(package, "no version between --from and --to")
    return chosen


@contextmanager
def python_with(package: str, version: str) -> Iterator[Path]:
    """Interpreter of a virtual environment with one package in another version, all else as here.

    Raises:
        RunError: pip can't install it.
    """
    wanted = f"{_plain(NAME, package)}=={_plain(VERSION, version)}"
    with tempfile.TemporaryDirectory(prefix="gamekeeper-") as folder:
        builder = venv.EnvBuilder()
        builder.create(folder)
        python = Path(builder.ensure_directories(folder).env_exe)
        code = "import sysconfig; print(sysconfig.get_path('purelib'))"
        site = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
        _pip("--python", str(python), "install", "--quiet", "--no-deps", wanted)
        here = [each for each in sys.path if Path(each).is_absolute() and Path(each).is_dir()]
        lines = [each for each in here if not _is_standard(each)]
        (Path(site.stdout.strip()) / "here.pth").write_text("\n".join([*lines, ""]))
        yield python


def answer_of(python: Path, words: Sequence[str], timeout_s: float) -> dict[str, Any] | str:
    """Document that a gamekeeper command prints there; a text: what it says in its place."""
    line = [str(python), "-m", "gamekeeper", *words, "--json"]
    try:
        done = subprocess.run(line, capture_output=True, text=True, timeout=timeout_s, check=False)
        document = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        return f"no answer in {timeout_s:g} s"
    except ValueError:
        return (done.stderr.strip().splitlines() or ["no answer"])[-1][:300]
    return document if isinstance(document, dict) else str(document)[:300]


def _is_standard(folder: str) -> bool:
    """Tells if a folder of the import path is the standard library's, which a venv has anyway."""
    return Path(folder).is_relative_to(sys.base_prefix) and "site-packages" not in folder


def _plain(form: re.Pattern[str], text: str) -> str:
    if form.fullmatch(text) is None:
        raise _none(text, "no name of a package or version")
    return text


def _pip(*words: str) -> str:
    """Output of a pip command.

    Raises:
        RunError: it fails.
    """
    try:
        done = subprocess.run(
            [*PIP, *words], capture_output=True, text=True, check=True, timeout=TIMEOUT_S
        )
    except (OSError, subprocess.SubprocessError) as error:
        said = str(getattr(error, "stderr", "") or error).strip().splitlines()
        raise _none(" ".join(words), (said or ["no answer"])[-1]) from error
    return done.stdout


def _none(where: str, actual: str) -> RunError:
    return RunError(
        "pip has no such version",
        where=where[:200],
        expected="a package and versions that pip can install here",
        actual=actual[:300],
        fix="name them with --versions 1.0,1.1, or ask: pip index versions PACKAGE",
    )
