"""What was found out about a run: documents in files, and those among its annotations."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeAlias

from gamekeeper.errors import EvidenceError
from gamekeeper.record.files.folder import read_bounded
from gamekeeper.record.files.notes import read_notes
from gamekeeper.report.page.compose import Documents

PathText: TypeAlias = str | PathLike[str]
Given: TypeAlias = Mapping[str, Any] | PathText | None
"""A document, the file of it, or nothing."""

DOCUMENT_BYTES: Final = 1 << 28
COMMANDS: Final = {
    "audit": "audit ENV --json",
    "diagnosis": "diagnose RUN --json",
    "attribution": "attribute RUN --json",
    "evaluation": "evaluate --out FOLDER",
}
"""What writes each of them."""


def documents_of(
    run: PathText,
    *,
    audit: Given = None,
    diagnosis: Given = None,
    attribution: Given = None,
    evaluation: Given = None,
) -> Documents:
    """What is known of a run: what was given, else what its annotations hold.

    Raises:
        EvidenceError: a document isn't of its kind.
        BundleError: a file can't be read.
    """
    noted: dict[str, Any] = {}
    for note in read_notes(run):
        kind = str(note.get("kind"))
        # a diagnosis stands under its own name since before there were other documents
        document = note.get("document", note.get(kind))
        if isinstance(document, Mapping):
            noted[kind] = document
    return Documents(
        audit=_document(audit or noted.get("audit"), "audit", ("verdicts", "measured")),
        diagnosis=_document(diagnosis or noted.get("diagnosis"), "diagnosis", ("agents",)),
        attribution=_document(
            attribution or noted.get("attribution"), "attribution", ("agents", "team")
        ),
        evaluation=_document(evaluation, "evaluation", ("results",)),
    )


def _document(given: Given, kind: str, needed: Sequence[str]) -> Mapping[str, Any] | None:
    """A document, or the one in a file or folder.

    Raises:
        EvidenceError: it isn't one of this kind.
    """
    if given is None:
        return None
    where = kind
    value: Any = given
    if not isinstance(given, Mapping):
        path = Path(given)
        path = path / f"{kind}.json" if path.is_dir() else path
        where = str(path)
        try:
            value = json.loads(read_bounded(path, DOCUMENT_BYTES))
        except EvidenceError:  # the file can't be read
            raise
        except (ValueError, RecursionError) as error:
            value = str(error)
    if not isinstance(value, Mapping) or any(name not in value for name in needed):
        raise EvidenceError(
            f"this is no {kind}",
            where=where,
            expected=f"a JSON object with {', '.join(needed)}",
            seen=", ".join(map(str, value))[:100]
            if isinstance(value, Mapping)
            else str(value)[:80],
            mend=f"give what `gamekeeper {COMMANDS[kind]}` wrote",
        )
    return value
