"""Documents about a run: those in files, and those among its annotations."""

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeAlias

from gamekeeper.errors import EvidenceError
from gamekeeper.reporting.page.composition import Documents
from gamekeeper.runs.files.folder import read_bounded
from gamekeeper.runs.files.notes import read_notes

PathText: TypeAlias = str | PathLike[str]
Given: TypeAlias = Mapping[str, Any] | PathText | None
"""A document, the file of it, or nothing."""

DOCUMENT_BYTES: Final = 1 << 28
COMMANDS: Final = {
    "audit": "audit ENV --json",
    "diagnosis": "diagnose RUN --json",
    "attribution": "attribute RUN --json",
    "pivots": "pivots RUN --json",
    "evaluation": "evaluate --out FOLDER",
}
"""The command that writes each of them."""


def documents_of(
    run: PathText,
    *,
    audit: Given = None,
    diagnosis: Given = None,
    attribution: Given = None,
    pivots: Given = None,
    evaluation: Given = None,
) -> Documents:
    """Reads the documents about a run: the given ones, else those of its annotations.

    Raises:
        EvidenceError: a document isn't of its kind.
        RunError: a file can't be read.
    """
    noted: dict[str, Any] = {}
    for note in read_notes(run):
        kind = str(note.get("kind"))
        document = note.get("document", note.get(kind))  # some runs have a diagnosis by its kind
        if isinstance(document, Mapping):
            noted[kind] = _added(noted.get(kind), document)
    return Documents(
        audit=_document(audit or noted.get("audit"), "audit", ("verdicts", "measured")),
        diagnosis=_document(diagnosis or noted.get("diagnosis"), "diagnosis", ("agents",)),
        attribution=_document(
            attribution or noted.get("attribution"), "attribution", ("agents", "team")
        ),
        pivots=_document(pivots or noted.get("pivots"), "pivots", ("episodes", "conditions")),
        evaluation=_document(evaluation, "evaluation", ("results",)),
    )


def _added(before: Mapping[str, Any] | None, document: Mapping[str, Any]) -> Mapping[str, Any]:
    """The document; one of pivots with episodes that an earlier one was asked about."""
    if before is None or "conditions" not in before or not _is_of_pivots(before, document):
        return document
    known = {each["episode"]: each for each in [*before["episodes"], *document["episodes"]]}
    return {**document, "episodes": [known[number] for number in sorted(known)]}


def _is_of_pivots(*documents: Mapping[str, Any]) -> bool:
    """Tells whether all are documents of pivots under one condition."""
    are_lists = all(isinstance(each.get("episodes"), list) for each in documents)
    return are_lists and len({str(each.get("conditions")) for each in documents}) == 1


def _document(given: Given, kind: str, needed: Sequence[str]) -> Mapping[str, Any] | None:
    """Returns a document, or reads it from a file or folder.

    Raises:
        EvidenceError: it isn't one of this kind.
    """
    if given is None:
        return None
    where, value = kind, given
    if not isinstance(given, Mapping):
        path = Path(given)
        path = path / f"{kind}.json" if path.is_dir() else path
        where, text = str(path), read_bounded(path, DOCUMENT_BYTES)
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            value = str(error)
    if not isinstance(value, Mapping) or any(name not in value for name in needed):
        raise EvidenceError(
            f"the document isn't of the kind {kind!r}",
            where=where,
            expected=f"a JSON object with {', '.join(needed)}",
            actual=", ".join(map(str, value))[:100]
            if isinstance(value, Mapping)
            else str(value)[:80],
            fix=f"give the output of `gamekeeper {COMMANDS[kind]}`",
        )
    return value
