"""Under an import guard nothing is found in closed folders, however they are spelled."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gamekeeper import import_guard
from gamekeeper.import_guard import digest_of, guarded, site_folders, unguarded

NAME = "herd_that_is_not_installed"


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a module, which is the current folder."""
    folder = tmp_path / "closed"
    folder.mkdir()
    (folder / f"{NAME}.py").write_text("")
    monkeypatch.chdir(folder)
    monkeypatch.delitem(sys.modules, NAME, raising=False)
    importlib.invalidate_caches()
    return folder


def entries(folder: Path) -> list[str]:
    """Ways to spell a folder on the import path."""
    link = folder.parent / "link"
    link.symlink_to(folder)
    return ["", ".", str(folder), str(link), f"{folder}/../closed", str(folder / "inner")]


@pytest.mark.parametrize("which", range(6))
def test_guard_drops_every_spelling_of_the_current_folder(
    closed: Path, monkeypatch: pytest.MonkeyPatch, which: int
) -> None:
    """Empty, relative, linked and roundabout entries are gone, and come back afterwards."""
    entry = entries(closed)[which]
    monkeypatch.syspath_prepend(entry)
    before = list(sys.path)
    with guarded():
        assert entry not in sys.path
        sys.path.append(entry)  # as packages do that count on the current folder
        with pytest.raises(ImportError):
            importlib.import_module(NAME)
        sys.path.remove(entry)
    assert before == sys.path


def test_guard_keeps_what_is_installed_below_the_current_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A virtual environment often lies in the current folder."""
    sites = {os.path.realpath(folder) for folder in site_folders()}
    monkeypatch.chdir("/")
    with guarded() as guard:
        there = {os.path.realpath(entry) for entry in sys.path}
        assert there & sites
        assert all(guard.allows(entry) for entry in sys.path)
    assert import_guard.active() is None


def test_unguarded_gives_the_path_back_meanwhile(
    closed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user's word lifts a guard, and only for as long as it is meant."""
    monkeypatch.syspath_prepend(str(closed))
    with guarded():
        with unguarded():
            assert str(closed) in sys.path
        assert str(closed) not in sys.path


def test_guard_that_leaves_the_current_folder_open_opens_it_inside_another(closed: Path) -> None:
    """As where the command's own guard closes it, and the user then names code that lies there."""
    (closed / "run").mkdir()
    with guarded(), guarded(closed / "run", is_here_closed=False) as guard:
        assert guard.allows(str(closed))
        assert not guard.allows(str(closed / "run"))
    with guarded(), guarded(closed, is_here_closed=False) as guard:
        assert not guard.allows(str(closed))


def test_guard_finds_a_known_module_only_unchanged(closed: Path) -> None:
    """A recorded module is found by its name, as long as its file has the digest."""
    file = closed / f"{NAME}.py"
    known = {NAME: (str(file), digest_of(file.read_bytes()))}
    with guarded(modules=known):
        importlib.import_module(NAME)
        del sys.modules[NAME]
        file.write_text("raise SystemExit")
        with pytest.raises(ImportError, match="isn't the one"):
            importlib.import_module(NAME)


def test_worker_starts_under_the_guard_of_its_parent(
    closed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither the worker's own start nor what it starts looks in the current folder."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", ".", str(closed), "/opt"]))
    with guarded():
        variables = import_guard.worker_environment(os.environ)
    assert (variables["PYTHONPATH"], variables["PYTHONSAFEPATH"]) == ("/opt", "1")
    done = subprocess.run([sys.executable, "-c", f"import {NAME}"], env=variables, check=False)
    assert done.returncode == 1
