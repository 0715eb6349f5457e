"""Where no run lies: what is there instead, and which runs beside it may have been meant."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Final

from gamekeeper.errors import BundleError
from gamekeeper.record.files.manifest import MANIFEST

MOST_LOOKED_AT: Final = 1_000
"""Entries of a folder that are looked at for runs; one of evidence may hold a great many."""
MOST_NAMED: Final = 5


def no_bundle(folder: Path) -> BundleError:
    """That there is no bundle in `folder`, with the runs in it, or the nearest one beside it."""
    mend = "check the path, or record a run with `gamekeeper record`"
    if folder.is_dir():
        seen, inside = f"a folder without {MANIFEST}", _runs_in(folder)
        if inside:
            mend = f"name one of the runs in it: {_listed(inside)}"
    elif folder.is_file():
        seen = "a file"
    else:
        seen = "no such folder"
        close = difflib.get_close_matches(folder.name, _runs_in(folder.parent), n=1)
        if close:
            mend = f"the nearest run there is {str(folder.with_name(close[0]))!r}"
    return BundleError(
        "there is no bundle here", where=str(folder), expected=f"a folder with {MANIFEST}",
        seen=seen, mend=mend,
    )  # fmt: skip


def _runs_in(folder: Path) -> list[str]:
    """Names of the runs that lie in a folder; none where nobody may look."""
    try:
        entries = sorted(islice(folder.iterdir(), MOST_LOOKED_AT))
        return [entry.name for entry in entries if (entry / MANIFEST).is_file()]
    except OSError:
        return []


def _listed(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMED
    shown = ", ".join(map(repr, names[:MOST_NAMED]))
    return f"{shown} and {more} more" if more > 0 else shown
