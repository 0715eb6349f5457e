"""Documents of commands, stored among the annotations of the run that they are about."""

import json
from pathlib import Path
from typing import Any, Final

from gamekeeper._version import __version__
from gamekeeper.cli._screen import Screen, document_text
from gamekeeper.errors import RunError

MOST_BYTES: Final = 16 << 20
"""Largest document that is stored among a run's annotations."""
COMMANDS: Final = {"attribution": "attribute", "pivots": "pivots"}
"""The command that writes each kind."""


def annotated(screen: Screen, run: Path, kind: str, document: dict[str, Any]) -> None:
    """Adds the document to the run's annotations, where a report finds it; never twice."""
    from gamekeeper.runs.files.notes import annotate, read_notes

    text = document_text(document)
    if len(text) > MOST_BYTES:
        screen.note(f"not stored in the run's annotations: it has {len(text):,} bytes")
        return
    plain = json.loads(text)
    try:
        known = [note.get("document") for note in read_notes(run) if note.get("kind") == kind]
        if known[-1:] != [plain]:
            by = f"gamekeeper {COMMANDS[kind]} {__version__}"
            annotate(run, {"kind": kind, "by": by, "document": plain})
            screen.note("saved with the run; gamekeeper report shows it")
    except RunError as error:  # a run that can't be written is answered about all the same
        screen.note(f"not stored in the run's annotations: {error.what}")
