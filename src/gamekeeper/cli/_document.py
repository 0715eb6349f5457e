"""JSON documents: exactly what stands on stdout with --json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from gamekeeper.errors import GamekeeperError

Document = Mapping[str, Any]


def document_text(document: Document) -> str:
    """One JSON document on one line, in ASCII; a number that JSON lacks (NaN, infinity) is null."""
    return json.dumps(_finite(document), allow_nan=False)


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


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
