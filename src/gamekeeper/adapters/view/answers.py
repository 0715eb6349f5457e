"""What the server answers with: pages, JSON documents, and refusals that say what to do."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Any, Final

from gamekeeper.core.finite import finite
from gamekeeper.errors import GamekeeperError

JSON: Final = "application/json"
HTML: Final = "text/html; charset=utf-8"
NOTHING: Final = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
"""The content policy of what is no page of ours: it may load nothing and stand in no frame."""
ALWAYS: Final[Mapping[str, str]] = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Frame-Options": "DENY",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer.

    Args:
        status: HTTP's.
        kind: the media type of the body.
        headers: beside those that every answer has (`ALWAYS`).
    """

    status: int
    kind: str
    body: bytes
    headers: Mapping[str, str] = field(default_factory=dict)

    def header_lines(self) -> dict[str, str]:
        """All headers."""
        own = {"Content-Type": self.kind, "Content-Length": str(len(self.body))}
        return {"Content-Security-Policy": NOTHING, **ALWAYS, **own, **self.headers}


def json_answer(document: Any, *, status: int = 200) -> Answer:
    """A JSON document; a number that JSON lacks (NaN, infinity) is null."""
    try:
        text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    except ValueError:
        text = json.dumps(finite(document), allow_nan=False, separators=(",", ":"))
    return Answer(status, JSON, text.encode("ascii"))


def refusal(
    status: int,
    what: str,
    *,
    where: str = "",
    expected: str = "",
    seen: str = "",
    mend: str = "",
    kind: str = "Refused",
    as_page: bool = False,
) -> Answer:
    """An answer that says what went wrong, where, and how to mend it.

    Args:
        as_page: for a person's eyes; otherwise a JSON document with the field `error`.
    """
    fields = {
        "kind": kind, "what": what, "where": where, "expected": expected, "seen": seen,
        "mend": mend,
    }  # fmt: skip
    if not as_page:
        return json_answer({"error": fields}, status=status)
    rows = "".join(
        f"<p>{name}: {escape(fields[name])}</p>\n"
        for name in ("where", "expected", "seen", "mend")
        if fields[name]
    )
    return page_answer(f"<h1>{escape(what)}</h1>\n{rows}", title=what, status=status)


def error_answer(error: GamekeeperError, *, status: int, as_page: bool = False) -> Answer:
    """One of our errors as an answer."""
    return refusal(status, **error_fields(error), as_page=as_page)


def error_fields(error: GamekeeperError) -> dict[str, str]:
    """One of our errors as plain data."""
    names = ("what", "where", "expected", "seen", "mend")
    return {"kind": type(error).__name__, **{name: str(getattr(error, name)) for name in names}}


def page_answer(body: str, *, title: str, status: int = 200, head: str = "") -> Answer:
    """A plain page: markup that holds no style, no script and no text that isn't escaped yet."""
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f'<meta name="color-scheme" content="light dark">{head}\n'
        f"<title>{escape(title)}</title></head>\n<body>\n{body}</body></html>\n"
    )
    return Answer(status, HTML, text.encode("utf-8", "replace"))
