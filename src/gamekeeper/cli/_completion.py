"""Words that a shell completes: environments, runs, policies, checks."""

from pathlib import Path
from typing import Final

WORDS: Final = ("random", "first-legal", "noop", "reference")
OURS: Final = "gamekeeper/"
MOST_RUNS: Final = 200
"""Runs that are offered; a folder may hold thousands."""


def environments(incomplete: str) -> list[str]:
    """Names of environments that can be opened here, and Python files."""
    from gamekeeper.interface import registry

    registry.with_ours()
    ids = registry.ids()
    own = [each.partition("/")[2].rpartition("-v")[0] for each in ids if each.startswith(OURS)]
    folder = Path(incomplete) if incomplete.endswith("/") else Path(incomplete).parent
    files = [each.as_posix() for each in folder.glob("*.py")] if folder.is_dir() else []
    return _fitting([*own, *ids, *files], incomplete)


def runs(incomplete: str) -> list[str]:
    """Folders of runs: in `runs/`, in the folder that is typed, and in the current one."""
    typed = Path(incomplete)
    parents = {Path("runs"), Path(), typed if typed.is_dir() else typed.parent}
    found = [each.parent for p in parents if p.is_dir() for each in p.glob("*/manifest.json")]
    return _fitting([each.as_posix() for each in found], incomplete)[:MOST_RUNS]


def policies(incomplete: str) -> list[str]:
    """Words for policies, also behind `AGENT=`."""
    place, equals, word = incomplete.rpartition("=")
    return [f"{place}{equals}{each}" for each in _fitting(list(WORDS), word)]


def checks(incomplete: str) -> list[str]:
    """Ids of checks."""
    from gamekeeper.checks import check

    return _fitting(list(check.checks()), incomplete.upper())


def _fitting(words: list[str], incomplete: str) -> list[str]:
    return sorted({each for each in words if each.startswith(incomplete)})
