"""Admission of requests: only the user who started the server, only from the server's own pages.

A server on loopback can be reached by every process of the machine and, through the browser, by
every page that its user opens. A random token keeps out other users; the cookie's SameSite, the
browser's own headers (Sec-Fetch-Site, Origin) and, against names that are pointed at 127.0.0.1
(DNS rebinding), the Host header keep out pages of other sites.

Source: OWASP, "Server-Side Request Forgery" and "DNS rebinding"; Fetch Metadata Request Headers,
W3C working draft 2021.

Answers of the server: pages, JSON documents, and refusals with a fix.
"""

import hmac
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any, Final, Protocol
from urllib.parse import parse_qsl

from gamekeeper.episodes.plain_json import finite
from gamekeeper.errors import GamekeeperError

JSON: Final = "application/json"
HTML: Final = "text/html; charset=utf-8"
NOTHING: Final = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
"""Content policy of other answers than pages: they may not load anything or stand in a frame."""
ALWAYS: Final[Mapping[str, str]] = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Frame-Options": "DENY",
}


@dataclass(frozen=True, slots=True)
class Response:
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


def json_answer(document: Any, *, status: int = 200) -> Response:
    """A JSON document; a number that JSON lacks (NaN, infinity) is null."""
    try:
        text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    except ValueError:
        text = json.dumps(finite(document), allow_nan=False, separators=(",", ":"))
    return Response(status, JSON, text.encode("ascii"))


def refusal(
    status: int,
    what: str,
    *,
    where: str = "",
    expected: str = "",
    actual: str = "",
    fix: str = "",
    kind: str = "Refused",
    as_page: bool = False,
) -> Response:
    """An answer that names a failure, its place and a fix.

    Args:
        as_page: True: an HTML page; otherwise a JSON document with the field `error`.
    """
    fields = {
        "kind": kind,
        "what": what,
        "where": where,
        "expected": expected,
        "actual": actual,
        "fix": fix,
    }
    if not as_page:
        return json_answer({"error": fields}, status=status)
    rows = "".join(
        f"<p>{name}: {escape(fields[name])}</p>\n"
        for name in ("where", "expected", "actual", "fix")
        if fields[name]
    )
    return page_answer(f"<h1>{escape(what)}</h1>\n{rows}", title=what, status=status)


def error_answer(error: GamekeeperError, *, status: int, as_page: bool = False) -> Response:
    """One of our errors as an answer."""
    return refusal(status, **error.to_json(), as_page=as_page)


def page_answer(body: str, *, title: str, status: int = 200, head: str = "") -> Response:
    """A plain page without style and script; text in `body` must be escaped already."""
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width">\n'
        f'<meta name="color-scheme" content="light dark">{head}\n'
        f"<title>{escape(title)}</title></head>\n<body>\n{body}</body></html>\n"
    )
    return Response(status, HTML, text.encode("utf-8", "replace"))


READS: Final = ("GET", "HEAD")
HOSTS: Final = ("127.0.0.1", "localhost")
OURS: Final = ("none", "same-origin")
"""Values of Sec-Fetch-Site for addresses that the user typed, and for this server's pages."""
ENTRANCE: Final = "/"
FIELD: Final = "token"
OPEN_AGAIN: Final = "open the address that `gamekeeper view` printed, with its token"


class Headers(Protocol):
    """Headers as the standard library's servers have them."""

    def get_all(self, name: str) -> Sequence[str] | None:
        """Every value of one header, None where it wasn't sent."""


@dataclass(frozen=True, slots=True)
class Admission:
    """The rules of one server.

    Args:
        token: the secret of its address.
        takes_orders: POST is answered, too, to pages of its own.
    """

    port: int
    token: str
    takes_orders: bool = False

    @property
    def url(self) -> str:
        """The address with the token."""
        return f"http://{HOSTS[0]}:{self.port}{ENTRANCE}?{FIELD}={self.token}"

    @property
    def cookie(self) -> str:
        """The cookie's name: cookies are shared by all ports, so that each server has its own."""
        return f"gamekeeper-{self.port}"

    def check(self, method: str, target: str, headers: Headers) -> Response | None:
        """The answer to a request that is refused, or that brings the token; None: it is admitted.

        The Host header is checked first: without it, a page under a foreign name that is pointed
        at this machine could read answers. Then the method, then foreign origins; the token is
        accepted before Sec-Fetch-Site, as the printed address may be opened from another program.
        """
        path, _, query = target.partition("?")
        as_page = is_for_people(path)
        hosts = headers.get_all("Host") or ()
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts():
            return refusal(
                421,
                "this server only answers requests to its own address",
                where="Host",
                expected=" or ".join(self._hosts()),
                actual=", ".join(hosts)[:100],
                fix=OPEN_AGAIN,
                as_page=as_page,
            )
        methods = (*READS, "POST") if self.takes_orders else READS
        if method not in methods:
            return _with(
                refusal(
                    405,
                    "this server only reads runs",
                    expected=" or ".join(methods),
                    actual=method[:20],
                    as_page=as_page,
                ),
                Allow=", ".join(methods),
            )
        origins = headers.get_all("Origin") or ()
        if method == "POST" and not origins:  # a browser always says where an order comes from
            return self._foreign("Origin", "none", as_page=as_page)
        for origin in origins:
            if origin.lower() != f"http://{hosts[0].lower()}":
                return self._foreign("Origin", origin, as_page=as_page)
        token = field_of(query, FIELD) if path == ENTRANCE else None
        if token is not None and self._is_ours(token):
            return self._welcome()
        sites = headers.get_all("Sec-Fetch-Site") or ()
        if any(site.lower() not in OURS for site in sites):
            return self._foreign("Sec-Fetch-Site", ", ".join(sites), as_page=as_page)
        if not any(self._is_ours(value) for value in self._cookies(headers)):
            return refusal(
                403,
                "this needs the token of the server",
                where=path[:100],
                fix=OPEN_AGAIN,
                as_page=as_page,
            )
        return None

    def _hosts(self) -> tuple[str, ...]:
        return tuple(f"{host}:{self.port}" for host in HOSTS)

    def _is_ours(self, token: str) -> bool:
        """Compares in constant time, so that timing doesn't reveal a part of the token."""
        given = token.encode("utf-8", "backslashreplace")
        return hmac.compare_digest(given, self.token.encode("ascii"))

    def _cookies(self, headers: Headers) -> list[str]:
        pairs = [
            pair.strip() for line in headers.get_all("Cookie") or () for pair in line.split(";")
        ]
        return [
            pair[len(self.cookie) + 1 :] for pair in pairs if pair.startswith(f"{self.cookie}=")
        ]

    def _welcome(self) -> Response:
        """Sets the cookie and leads to the page, whose address is without the token.

        By a refresh and not a redirect: a browser withholds a SameSite cookie from a redirect that
        began in another program's page.
        """
        head = f'<meta http-equiv="refresh" content="0;url={ENTRANCE}">'
        body = f'<p><a href="{ENTRANCE}">Show the runs</a></p>\n'
        cookie = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        return _with(page_answer(body, title="Gamekeeper", head=head), **{"Set-Cookie": cookie})

    def _foreign(self, header: str, seen: str, *, as_page: bool) -> Response:
        return refusal(
            403,
            "a page of another site sent this request",
            where=header,
            actual=seen[:100],
            fix=OPEN_AGAIN,
            as_page=as_page,
        )


def is_for_people(path: str) -> bool:
    """True for the address of a page; all others are requested by pages."""
    return path in (ENTRANCE, "/report")


def field_of(query: str, name: str) -> str | None:
    """The value of a query's field; None where it is missing, or the query has too many fields."""
    try:
        pairs = parse_qsl(query, max_num_fields=8)
    except ValueError:
        return None
    return next((value for key, value in pairs if key == name), None)


def _with(answer: Response, **headers: str) -> Response:
    both: Mapping[str, str] = {**answer.headers, **headers}
    return Response(answer.status, answer.kind, answer.body, both)
