"""A run opened to be shown."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from gamekeeper.diagnose.labels import labels
from gamekeeper.record.bundle import load
from gamekeeper.report.page.compose import Shown, shown


def opened(path: str | PathLike[str], *, key: str, name: str | None = None) -> Shown:
    """A run with its figures and labels, ready to be shown.

    Args:
        path: the folder of the run.
        key: its letter on the page.
        name: what the page calls it; None: the folder's name.
    """
    folder = Path(path)
    evidence = load(folder)
    said = [each.to_json() for each in labels(folder)]
    called = folder.resolve().name if name is None else name
    return shown(evidence, key=key, path=str(path), name=called, labels=said)
