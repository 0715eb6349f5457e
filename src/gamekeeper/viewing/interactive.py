"""Playing on from the viewer's page: orders are checked, futures played, one kept as evidence.

Exists only in a viewer that was started as interactive. An order is a POST that holds the page's
own secret beside the cookie; the code of a run is run under the rules of a replay, in a process of
its own, one order at a time. The guard of imports belongs to one thread, so that all orders are
carried out in the thread that serves.
"""

import hmac
import json
import queue
import secrets
import shutil
import tempfile
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from gamekeeper.diagnosis.play_on import (
    MOST_FUTURES,
    BranchPoint,
    PlayOnOptions,
    check_consent,
    futures,
    offers,
    record_future,
)
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError
from gamekeeper.runs.files.folder import system_error
from gamekeeper.viewing.admission import Headers, Response, json_answer, refusal
from gamekeeper.viewing.viewer_runs import ServedRun

KEY_HEADER: Final = "X-Gamekeeper-Key"
PLACES: Final = ("/play-on/offers", "/play-on/futures", "/play-on/future", "/play-on/keep")
STOP: Final = "/play-on/stop"
PROGRESS: Final = "/play-on/progress.json"

Order = Mapping[str, Any]


class Interactive:
    """Plays on from turns of served runs, for pages that hold its key."""

    def __init__(self, served: dict[str, ServedRun], options: PlayOnOptions | None = None) -> None:
        """Checks that the code of every run may be run.

        Args:
            served: the viewer's runs by letter; futures are added to them.
            options: consent and limits.
        Raises:
            TrustError: a run names code that nobody allowed to run.
        """
        self.key = secrets.token_urlsafe(32)
        self._served, self._options = served, options or PlayOnOptions()
        for run in served.values():
            check_consent(run.path, self._options)
        self._busy = threading.Lock()
        self._orders: queue.SimpleQueue[tuple[str, Order, Future[dict[str, Any]]] | None]
        self._orders = queue.SimpleQueue()
        self._stop = threading.Event()
        self._progress: Mapping[str, Any] = {}
        self._folder = Path(tempfile.mkdtemp(prefix="gamekeeper-futures-"))
        self._shown: dict[str, tuple[str, bool]] = {}
        """By letter of a future: the letter of the run that it is of, and if it replays."""

    def on_page(self) -> dict[str, Any]:
        """Data that the page needs to give orders."""
        return {"key": self.key, "most": MOST_FUTURES}

    def close(self) -> None:
        """Stops what is played, and deletes futures that weren't kept."""
        self._stop.set()
        self._orders.put(None)
        shutil.rmtree(self._folder, ignore_errors=True)

    def work(self) -> None:
        """Carries out orders in this thread until `close`.

        Raises:
            KeyboardInterrupt: by Ctrl-C.
        """
        while (given := self._orders.get()) is not None:
            path, order, done = given
            try:
                done.set_result(self._carried_out(path, order))
            except Exception as error:  # the request that waits for it says what went wrong
                done.set_exception(error)
            except KeyboardInterrupt:
                done.set_exception(GamekeeperError("the viewer was closed"))
                raise

    def answer(self, path: str, headers: Headers, body: bytes) -> Response:
        """The answer to an order that the server admitted.

        Raises:
            GamekeeperError: the order can't be carried out.
        """
        keys = headers.get_all(KEY_HEADER) or ()
        if len(keys) != 1 or not hmac.compare_digest(keys[0].encode(), self.key.encode()):
            return refusal(
                403, "this needs the key of the page", where=path[:100], fix="load it again"
            )
        kinds = headers.get_all("Content-Type") or ()
        if list(kinds) != ["application/json"]:
            return refusal(
                415, "an order is JSON", expected="application/json", actual=str(kinds)[:100]
            )
        if path == STOP:
            self._stop.set()
            return json_answer({})
        if path not in PLACES:
            return refusal(
                404, "this address doesn't exist", expected=", ".join(PLACES), actual=path[:100]
            )
        order = _order(body)
        if not self._busy.acquire(blocking=False):
            return refusal(
                409,
                "something is being played already",
                fix="wait until it is done, or stop it",
                kind="Busy",
            )
        try:
            self._stop.clear()
            self._progress = {}
            done: Future[dict[str, Any]] = Future()
            self._orders.put((path, order, done))
            return json_answer(done.result())
        finally:
            self._busy.release()

    def progress(self) -> Response:
        """Answers how far the order in progress is: `{"played", "of"}`, or nothing."""
        return json_answer(dict(self._progress))

    def _carried_out(self, path: str, order: Order) -> dict[str, Any]:
        if path == "/play-on/keep":
            return self._keep(_text(order, "run"))
        run = self._run(_text(order, "run"))
        options = replace(self._options, stop=self._stop)
        if path == "/play-on/offers":
            offered = offers(run.path, _number(order, "episode"), options)
            return {"agents": {agent: asdict(each) for agent, each in offered.items()}}
        branch = BranchPoint(
            episode=_number(order, "episode"),
            turn=_number(order, "turn"),
            agent=_text(order, "agent"),
            action=order.get("action"),
            policy=None if order.get("policy") is None else _text(order, "policy"),
        )
        if path == "/play-on/futures":
            found = futures(
                run.path,
                branch,
                count=_number(order, "futures"),
                seed=_number(order, "seed"),
                options=options,
                on_message=self._take,
            )
            return found.to_json()
        number = order.get("number")
        return self._record(
            run, branch, None if number is None else _number(order, "number"), options
        )

    def _take(self, fields: dict[str, Any]) -> None:
        if "played" in fields:
            self._progress = fields

    def _record(
        self, run: ServedRun, branch: BranchPoint, number: int | None, options: PlayOnOptions
    ) -> dict[str, Any]:
        """Records one future and serves it; the one before that wasn't kept goes."""
        for letter in [each for each, (of, _) in self._shown.items() if of == run.key]:
            del self._served[letter], self._shown[letter]
            shutil.rmtree(self._folder / letter, ignore_errors=True)
        letter = f"{run.key}.future{secrets.token_hex(3)}"
        out = self._folder / letter
        replays = record_future(run.path, branch, out, number=number, options=options)
        self._served[letter] = ServedRun(letter, out, name=f"future of {run.key}: {branch}")
        self._shown[letter] = (run.key, replays)
        place = {"run": letter, "episode": 0, "turn": branch.turn}
        return {**place, "replays": replays, "text": str(branch)}

    def _keep(self, letter: str) -> dict[str, Any]:
        """Copies a future beside its run, where it stays.

        Raises:
            EvidenceError: there is no such future, or it doesn't replay.
            RunError: the folder can't be written.
        """
        if letter not in self._shown:
            raise EvidenceError(
                "no continuation with this letter was played",
                where="run",
                expected=", ".join(self._shown) or "a future that was played",
                actual=letter[:64],
                fix="play one first",
            )
        of, replays = self._shown[letter]
        if not replays:
            raise EvidenceError(
                "this future doesn't replay, so it is no evidence",
                where=letter,
                expected="draws of the environment that follow from its seed",
                actual="fresh draws from the turn on",
                fix="keep the future on the recorded draws",
            )
        beside = self._served[of].path.resolve()
        target = _free(beside.parent / f"{beside.name}-futures")
        try:
            shutil.copytree(self._served[letter].path, target)
        except OSError as error:
            raise system_error("keeping a future", target, error) from error
        del self._shown[letter]  # it stays on the page
        return {"run": letter, "folder": str(target)}

    def _run(self, letter: str) -> ServedRun:
        run = self._served.get(letter)
        if run is None:
            raise EvidenceError(
                "this viewer has no such run",
                where="run",
                expected=", ".join(self._served),
                actual=letter[:64],
                fix="choose one of these",
            )
        if run.edition().status == "open":
            raise RunError(
                "a run is played on once it is finalized",
                where=str(run.path),
                expected="finalized",
                actual="open",
                fix="wait for its end, or `gamekeeper recover` it",
            )
        return run


def _free(folder: Path) -> Path:
    """A numbered folder in another one that doesn't exist yet."""
    number = 1
    while (target := folder / f"future-{number}").exists():
        number += 1
    return target


def _order(data: bytes) -> Order:
    try:
        order = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise _not_so("an order", "a JSON object", str(error)) from error
    if not isinstance(order, dict):
        raise _not_so("an order", "a JSON object", type(order).__name__)
    return order


def _text(order: Order, name: str) -> str:
    value = order.get(name)
    if not isinstance(value, str):
        raise _not_so(name, "a text", repr(value))
    return value


def _number(order: Order, name: str) -> int:
    value = order.get(name)
    if type(value) is not int or not 0 <= value < 1 << 31:
        raise _not_so(name, "a whole number from 0 on", repr(value))
    return value


def _not_so(name: str, expected: str, actual: str) -> GamekeeperError:
    return GamekeeperError(
        "the order can't be read",
        where=name,
        expected=expected,
        actual=actual[:200],
        fix="send what the page sends",
    )
