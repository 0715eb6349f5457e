"""JSON documents: exactly what stands on stdout with --json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from gamekeeper.core.finite import finite
from gamekeeper.errors import GamekeeperError

Document = Mapping[str, Any]


def document_text(document: Document) -> str:
    """One JSON document on one line, in ASCII; a number that JSON lacks (NaN, infinity) is null."""
    return json.dumps(finite(document), allow_nan=False)


def error_document(error: GamekeeperError) -> dict[str, Any]:
    """An error as the value of `error` in a document."""
    return {
        "kind": type(error).__name__,
        "what": error.what,
        "where": error.where,
        "expected": error.expected,
        "seen": error.seen,
        "mend": error.mend,
    }
