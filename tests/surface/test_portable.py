"""Nothing stops macOS and Windows but what says so: imports, names of files, encodings."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts import workers
from gamekeeper.runs.parts.fan_out import _check_free
from tests.surface.sources import PACKAGE, ROOT, kept_files

RESERVED = re.compile(r'[<>:"\\|?*\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.I)


def test_package_loads_where_only_posix_names_are_missing(tmp_path: Path) -> None:
    """Every module is imported, and evidence written and read, without fork, fcntl and the like.

    Text files opened without an encoding would be read in the machine's own: they are errors too.
    """
    done = subprocess.run(
        [
            sys.executable,
            *("-X", "warn_default_encoding"),
            *("-W", "ignore", "-W", "error::EncodingWarning:gamekeeper"),
            str(ROOT / "tests" / "surface" / "elsewhere.py"),
            str(tmp_path),
        ],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found.pop("loaded") > 500
    assert found == {"missing": [], "difference": None, "ok": [True] * 3, "rows": 2, "page": True}


def test_worker_processes_say_what_they_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there are no POSIX processes, the error names the way out."""
    monkeypatch.setattr(workers.os, "name", "nt")
    with pytest.raises(GamekeeperError) as caught:
        workers.environment_of()
    monkeypatch.undo()
    assert "WSL" in str(caught.value.fix)


def test_a_runs_folder_is_looked_at_without_posix_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`Path.is_mount` raises on Windows before Python 3.12, so nothing asks it."""
    monkeypatch.delattr(Path, "is_mount")
    _check_free(tmp_path)


def test_kept_files_have_names_for_every_system() -> None:
    """No name is reserved on Windows, and no two differ by case alone."""
    names = [path.relative_to(ROOT).as_posix() for path in kept_files()]
    assert [n for n in names if any(RESERVED.search(part) for part in n.split("/"))] == []
    assert len({name.casefold() for name in names}) == len(names)


def test_sources_open_no_text_in_the_machines_encoding() -> None:
    """`open`, `read_text` and `write_text` of the package and the examples name an encoding."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "ruff", "check", "--isolated", "--no-cache", "--preview"),
            *("--select", "PLW1514", str(PACKAGE), str(ROOT / "examples")),
        ],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
