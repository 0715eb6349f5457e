"""Serves recorded runs to a browser on this machine, also while they are being recorded.

Requests are for a page, the index or an episode; no part of one is ever used as a file's name.
"""

from __future__ import annotations

import re
import secrets
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from gamekeeper.diagnosis.play_on import PlayOnOptions
from gamekeeper.errors import GamekeeperError
from gamekeeper.viewing.admission import (
    Admission,
    Headers,
    Response,
    error_answer,
    field_of,
    is_for_people,
    json_answer,
    refusal,
)
from gamekeeper.viewing.connections import Connections
from gamekeeper.viewing.interactive import PROGRESS, Interactive
from gamekeeper.viewing.report_packer import LETTERS
from gamekeeper.viewing.viewer_pages import episode_of, front_page, whole_page
from gamekeeper.viewing.viewer_runs import Edition, ServedRun

PAGES: Final[Mapping[str, Callable[[Sequence[Edition], Any], Response]]] = {
    "/": front_page,
    "/report": whole_page,
}


class ServedRuns:
    """Some runs, each under a letter.

    Raises:
        RunError: one of them isn't a run, or is damaged.
        GamekeeperError: there are more runs than letters.
    """

    def __init__(self, runs: Sequence[Path]) -> None:
        if len(runs) > len(LETTERS):
            raise GamekeeperError(
                "too many runs for one viewer",
                where="RUN",
                expected=f"at most {len(LETTERS)}",
                actual=str(len(runs)),
                fix="name fewer of them",
            )
        self.served = {key: ServedRun(key, run) for key, run in zip(LETTERS, runs, strict=False)}
        # Tells versions of an earlier server on the same port from this one's.
        self._birth = secrets.token_hex(4)

    def page(self, path: str, play_on: Mapping[str, Any] | None = None) -> Response:
        """A page of `PAGES`, without episodes: it requests them."""
        return PAGES[path]([run.edition() for run in list(self.served.values())], play_on)

    def index(self, since: str) -> dict[str, Any]:
        """All runs, and the entries of episodes that changed.

        Args:
            since: the `version` of an earlier index; empty, or any other text: all entries.
        """
        editions = [run.edition() for run in list(self.served.values())]
        known = self._numbers(since)
        return {
            "version": "-".join(
                [self._birth, *(f"{each.shown.key}:{each.number}" for each in editions)]
            ),
            "runs": [_run(edition) for edition in editions],
            "episodes": [
                entry
                for edition in editions
                for episode, entry in edition.entries.items()
                if edition.since[episode] > known.get(edition.shown.key, 0)
            ],
        }

    def episode(self, key: str, number: int) -> Response | None:
        """One episode as the player reads it; None if it doesn't exist."""
        run = self.served.get(key)
        edition = None if run is None else run.edition()
        if edition is None or number not in edition.entries:
            return None
        with edition.lock:
            return json_answer(episode_of(edition, number))

    def _numbers(self, version: str) -> dict[str, int]:
        """The numbers of editions in a version, by run; none where it isn't one of this server."""
        birth, *parts = version.split("-")
        pairs = [part.partition(":")[::2] for part in parts]
        is_ours = birth == self._birth and all(t.isascii() and t.isdigit() for _, t in pairs)
        return {key: int(text) for key, text in pairs} if is_ours else {}


def _run(edition: Edition) -> dict[str, Any]:
    return {
        **edition.shown.card.to_json(),
        "written_s": round(max(0.0, time.time() - edition.written), 1),
        "error": edition.error,
    }


EPISODE: Final = re.compile(r"/episode/([^/]{1,64})/([0-9]{1,10})")
SINCE: Final = "since"
ROUTES: Final = "/, /report, /index.json, /episode/RUN/NUMBER"


class Routes:
    """Answers admitted requests about runs."""

    def __init__(
        self, admission: Admission, runs: ServedRuns, interactive: Interactive | None = None
    ) -> None:
        """Answers requests about `runs` that `admission` admits.

        Args:
            interactive: carries out orders; None: there are none.
        """
        self._admission, self._runs, self._interactive = admission, runs, interactive

    def __call__(self, method: str, target: str, headers: Headers, body: bytes = b"") -> Response:
        """Returns the answer; a failure is one too."""
        path, _, query = target.partition("?")
        as_page = is_for_people(path)
        try:
            refused = self._admission.check(method, target, headers)
            if refused is not None:
                return refused
            if method == "POST" and self._interactive is not None:
                return self._interactive.answer(path, headers, body)
            return self._answer(path, query)
        except GamekeeperError as error:
            return error_answer(error, status=422 if method == "POST" else 503, as_page=as_page)
        except Exception as error:  # a fault of ours ends one answer, never the server
            text = "".join(traceback.format_exception(error)[-3:])
            return refusal(
                500,
                "a fault of gamekeeper",
                where=path[:100],
                actual=text[-2_000:],
                fix="please report it",
                kind="Fault",
                as_page=as_page,
            )

    def _answer(self, path: str, query: str) -> Response:
        if path in PAGES:
            known = None if self._interactive is None else self._interactive.on_page()
            return self._runs.page(path, known)
        if path == PROGRESS and self._interactive is not None:
            return self._interactive.progress()
        if path == "/index.json":
            return json_answer(self._runs.index(field_of(query, SINCE) or ""))
        if path == "/favicon.ico":  # browsers ask for it by themselves
            return Response(204, "image/x-icon", b"")
        if found := EPISODE.fullmatch(path):
            run, number = unquote(found[1]), int(found[2])
            return self._runs.episode(run, number) or self._no_episode(run, number)
        return refusal(404, "this address doesn't exist", expected=ROUTES, actual=path[:100])

    def _no_episode(self, run: str, number: int) -> Response:
        served = self._runs.served.get(run)
        if served is None:
            return refusal(
                404,
                "this viewer has no such run",
                expected=", ".join(self._runs.served),
                actual=run[:64],
            )
        return refusal(
            404,
            f"the run has no episode {number}",
            where=str(served.path),
            expected=f"one of its {len(served.edition().entries)} episodes",
            actual=str(number),
        )


TOKEN_BYTES: Final = 32


class Viewer:
    """Serves runs under `url`, from construction until `close`.

    As a context manager it answers in a thread of its own; `serve` answers in the caller's.
    """

    def __init__(
        self,
        runs: Sequence[str | PathLike[str]],
        *,
        port: int = 0,
        interactive: PlayOnOptions | None = None,
    ) -> None:
        """Reads the runs and takes the port.

        Args:
            runs: their folders; the first is `a` on the page, and so on.
            port: on 127.0.0.1; 0: a free one.
            interactive: pages may play on from a turn, with this consent and these limits; None:
                no code of a run is run.
        Raises:
            RunError: one of them isn't a run, or is damaged.
            TrustError: `interactive`, and a run names code that nobody allowed to run.
            GamekeeperError: the port is taken.
        """
        served = ServedRuns([Path(run) for run in runs])
        self._interactive: Interactive | None = None
        if interactive is not None:
            self._interactive = Interactive(served.served, interactive)
        try:
            self._connections = Connections(port)
        except OSError as error:
            raise GamekeeperError(
                f"port {port} can't be used: {error.strerror or error}",
                where="--port",
                fix="give another --port, or leave it out to get a free one",
            ) from error
        self.port: int = self._connections.server_port
        admission = Admission(
            self.port, secrets.token_urlsafe(TOKEN_BYTES), takes_orders=interactive is not None
        )
        self.url: str = admission.url
        self._connections.respond = Routes(admission, served, self._interactive)
        self._thread: threading.Thread | None = None

    def serve(self) -> None:
        """Answers until another thread closes it, or Ctrl-C; this thread carries out orders."""
        if self._interactive is None:
            self._connections.serve_forever()
            return
        answers = threading.Thread(target=self._connections.serve_forever, daemon=True)
        answers.start()
        try:
            self._interactive.work()
        finally:
            self._connections.shutdown()
            answers.join()

    def close(self) -> None:
        """Stops the server and frees the port."""
        if self._interactive is not None:
            self._interactive.close()
        if self._thread is not None:
            self._connections.shutdown()
            self._thread.join()
            self._thread = None
        self._connections.server_close()

    def __enter__(self) -> Viewer:
        self._thread = threading.Thread(target=self.serve, name="gamekeeper-view", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
