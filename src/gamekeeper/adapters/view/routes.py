"""What a request asks for: the page, the index, an episode; no part of it is ever a file's name."""

from __future__ import annotations

import re
import traceback
from typing import Any, Final
from urllib.parse import parse_qsl, unquote

from gamekeeper.adapters.view.admission import Admission, Headers, is_for_people
from gamekeeper.adapters.view.answers import Answer, error_answer, json_answer, refusal
from gamekeeper.adapters.view.shelf import PAGES, Shelf
from gamekeeper.errors import GamekeeperError

EPISODE: Final = re.compile(r"/episode/([^/]{1,64})/([0-9]{1,10})")
SINCE: Final = "since"
ROUTES: Final = "/, /report, /index.json, /episode/RUN/NUMBER"


class Routes:
    """Answers requests from a shelf, once they are let in."""

    def __init__(self, admission: Admission, shelf: Shelf) -> None:
        """Answers with what is on `shelf` to whom `admission` lets in."""
        self._admission, self._shelf = admission, shelf

    def __call__(self, method: str, target: str, headers: Headers) -> Answer:
        """The answer; whatever goes wrong is one too."""
        path, _, query = target.partition("?")
        as_page = is_for_people(path)
        try:
            refused = self._admission.check(method, target, headers)
            return refused if refused is not None else self._answer(path, query)
        except GamekeeperError as error:
            return error_answer(error, status=503, as_page=as_page)
        except Exception as error:  # a fault of ours ends one answer, never the server
            said = "".join(traceback.format_exception(error)[-3:])
            return refusal(
                500, "a fault of gamekeeper", where=path[:100], seen=said[-2_000:],
                mend="please report it", kind="Fault", as_page=as_page,
            )  # fmt: skip

    def _answer(self, path: str, query: str) -> Answer:
        if path in PAGES:
            return self._shelf.page(path)
        if path == "/index.json":
            return json_answer(self._shelf.index(_field(query, SINCE)))
        if path == "/favicon.ico":  # browsers ask for it by themselves
            return Answer(204, "image/x-icon", b"")
        if found := EPISODE.fullmatch(path):
            run, number = unquote(found[1]), int(found[2])
            return self._shelf.episode(run, number) or self._no_episode(run, number)
        return refusal(404, "there is no such address", expected=ROUTES, seen=path[:100])

    def _no_episode(self, run: str, number: int) -> Answer:
        book = self._shelf.books.get(run)
        if book is None:
            return refusal(
                404, "there is no such run here", expected=", ".join(self._shelf.books),
                seen=run[:64],
            )  # fmt: skip
        return refusal(
            404, f"the run has no episode {number}", where=str(book.path),
            expected=f"one of its {len(book.edition().entries)} episodes", seen=str(number),
        )  # fmt: skip


def _field(query: str, name: str) -> str:
    try:
        pairs: list[Any] = parse_qsl(query, max_num_fields=8)
    except ValueError:
        return ""
    return next((value for key, value in pairs if key == name), "")
