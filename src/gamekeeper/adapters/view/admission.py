"""Who is let in: only the person who started the server, only from this machine's own pages.

A server on loopback can be reached by every process of the machine and, through the browser, by
every page that its user looks at. Against other users stands a random token; against pages of other
sites the cookie's SameSite, the browser's own word (Sec-Fetch-Site, Origin) and, where a name is
pointed at 127.0.0.1 so that a foreign page counts as ours, the Host header.

Source: OWASP, "Server-Side Request Forgery" and "DNS rebinding"; Fetch Metadata Request Headers,
W3C working draft 2021.
"""

from __future__ import annotations

import hmac
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol
from urllib.parse import parse_qsl

from gamekeeper.adapters.view.answers import Answer, page_answer, refusal

METHODS: Final = ("GET", "HEAD")
HOSTS: Final = ("127.0.0.1", "localhost")
OURS: Final = ("none", "same-origin")
"""What a browser says of requests that its user typed, or that come from a page of ours."""
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
        port: on which it listens.
        token: the secret of its address.
    """

    port: int
    token: str

    @property
    def url(self) -> str:
        """The address that lets in whoever knows it."""
        return f"http://{HOSTS[0]}:{self.port}{ENTRANCE}?{FIELD}={self.token}"

    @property
    def cookie(self) -> str:
        """The cookie's name: cookies are shared by all ports, so that each server has its own."""
        return f"gamekeeper-{self.port}"

    def check(self, method: str, target: str, headers: Headers) -> Answer | None:
        """The answer to who isn't let in, or who comes in just now; None: let them in."""
        path, _, query = target.partition("?")
        as_page = is_for_people(path)
        hosts = headers.get_all("Host") or ()
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts():
            return refusal(
                421, "this server answers to its own name alone", where="Host",
                expected=" or ".join(self._hosts()), seen=", ".join(hosts)[:100], as_page=as_page,
            )  # fmt: skip
        if method not in METHODS:
            return _with(
                refusal(405, "evidence is looked at, never changed", expected="GET or HEAD",
                        seen=method[:20], as_page=as_page),
                Allow=", ".join(METHODS),
            )  # fmt: skip
        for origin in headers.get_all("Origin") or ():
            if origin.lower() != f"http://{hosts[0].lower()}":
                return self._foreign("Origin", origin, as_page=as_page)
        token = _field(query, FIELD) if path == ENTRANCE else None
        if token is not None and self._is_ours(token):
            return self._welcome()
        sites = headers.get_all("Sec-Fetch-Site") or ()
        if any(site.lower() not in OURS for site in sites):
            return self._foreign("Sec-Fetch-Site", ", ".join(sites), as_page=as_page)
        if not any(self._is_ours(value) for value in self._cookies(headers)):
            return refusal(
                403, "this needs the token of the server", where=path[:100], mend=OPEN_AGAIN,
                as_page=as_page,
            )  # fmt: skip
        return None

    def _hosts(self) -> tuple[str, ...]:
        return tuple(f"{host}:{self.port}" for host in HOSTS)

    def _is_ours(self, token: str) -> bool:
        """Compares in a time that says nothing of how much of it is right."""
        given = token.encode("utf-8", "backslashreplace")
        return hmac.compare_digest(given, self.token.encode("ascii"))

    def _cookies(self, headers: Headers) -> list[str]:
        pairs = [
            pair.strip() for line in headers.get_all("Cookie") or () for pair in line.split(";")
        ]
        return [
            pair[len(self.cookie) + 1 :] for pair in pairs if pair.startswith(f"{self.cookie}=")
        ]

    def _welcome(self) -> Answer:
        """Sets the cookie and goes on to the page, whose address is without the token.

        The page goes on by itself, since a redirect would hand on where the visit began: where it
        began in another program's page, the browser would hold the cookie back.
        """
        head = f'<meta http-equiv="refresh" content="0;url={ENTRANCE}">'
        body = f'<p><a href="{ENTRANCE}">On to the runs</a></p>\n'
        cookie = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        return _with(page_answer(body, title="Gamekeeper", head=head), **{"Set-Cookie": cookie})

    def _foreign(self, header: str, seen: str, *, as_page: bool) -> Answer:
        return refusal(
            403, "another site's page asked for this", where=header, seen=seen[:100],
            mend=OPEN_AGAIN, as_page=as_page,
        )  # fmt: skip


def is_for_people(path: str) -> bool:
    """Whether a page is asked for; everything else is asked for by the page."""
    return path in (ENTRANCE, "/report")


def _field(query: str, name: str) -> str | None:
    try:
        pairs = parse_qsl(query, max_num_fields=8)
    except ValueError:
        return None
    return next((value for key, value in pairs if key == name), None)


def _with(answer: Answer, **headers: str) -> Answer:
    both: Mapping[str, str] = {**answer.headers, **headers}
    return Answer(answer.status, answer.kind, answer.body, both)
