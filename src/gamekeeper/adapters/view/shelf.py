"""The runs of one server: their index, and their episodes as the player reads them."""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gamekeeper.adapters.view.answers import Answer, json_answer
from gamekeeper.adapters.view.book import Book, Edition
from gamekeeper.adapters.view.pages import episode_of, front_page, whole_page
from gamekeeper.errors import GamekeeperError

LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"
KEPT_BYTES: Final = 64 << 20
"""Of packed episodes that are kept for whoever asks again."""
PAGES: Final[Mapping[str, Callable[[Sequence[Edition]], Answer]]] = {
    "/": front_page,
    "/report": whole_page,
}


class Shelf:
    """Some runs, each under a letter.

    Args:
        runs: their folders.
    Raises:
        BundleError: one of them is no bundle, or is damaged.
        GamekeeperError: there are more than letters.
    """

    def __init__(self, runs: Sequence[Path]) -> None:
        if len(runs) > len(LETTERS):
            raise GamekeeperError(
                "too many runs to look at side by side",
                where="RUN", expected=f"at most {len(LETTERS)}", seen=str(len(runs)),
                mend="name fewer of them",
            )  # fmt: skip
        self.books = {key: Book(key, run) for key, run in zip(LETTERS, runs, strict=False)}
        # Another server's version, of an earlier start, says nothing of this one's.
        self._birth = secrets.token_hex(4)
        self._packed = Packed(KEPT_BYTES)
        self._pages: dict[str, tuple[str, Answer]] = {}
        self._printing = {path: threading.Lock() for path in PAGES}

    def page(self, path: str) -> Answer:
        """A page of `PAGES`, without any episode: it asks for them."""
        editions = [book.edition() for book in self.books.values()]
        version = self._version(editions)
        with self._printing[path]:  # whoever wants the other page doesn't wait for this one
            known = self._pages.get(path)
            if known is None or known[0] != version:
                known = self._pages[path] = version, PAGES[path](editions)
            return known[1]

    def index(self, since: str) -> dict[str, Any]:
        """All runs, and the lines of those episodes that changed.

        Args:
            since: the `version` of an earlier index; empty, or any other text: all lines.
        """
        editions = {key: book.edition() for key, book in self.books.items()}
        seen = self._numbers(since, len(editions))
        lines = [
            line
            for (_, edition), number in zip(editions.items(), seen, strict=True)
            for episode, line in edition.entries.items()
            if edition.since[episode] > number
        ]
        return {
            "version": self._version(list(editions.values())),
            "runs": [_run(edition) for edition in editions.values()],
            "episodes": lines,
        }

    def episode(self, key: str, number: int) -> Answer | None:
        """One episode as the player reads it; None where there is none."""
        book = self.books.get(key)
        edition = None if book is None else book.edition()
        if edition is None or number not in edition.entries:
            return None
        place = (key, number, edition.since[number])
        answer = self._packed.get(place)
        if answer is None:
            with edition.lock:
                answer = self._packed.get(place)  # another thread may have packed it meanwhile
                if answer is None:
                    answer = json_answer(episode_of(edition, number))
                    self._packed.put(place, answer)
        return answer

    def _version(self, editions: Sequence[Edition]) -> str:
        return "-".join([self._birth, *(str(edition.number) for edition in editions)])

    def _numbers(self, version: str, count: int) -> list[int]:
        """The editions that a version tells of; zeros where it isn't one of ours."""
        birth, *numbers = version.split("-")
        if birth != self._birth or len(numbers) != count:
            return [0] * count
        return [int(number) if number.isascii() and number.isdigit() else 0 for number in numbers]


def _run(edition: Edition) -> dict[str, Any]:
    return {
        **edition.shown.card.to_json(),
        "written_s": round(max(0.0, time.time() - edition.written), 1),
        "error": edition.error,
    }


class Packed:
    """Answers by what they are of, the least recently asked for forgotten beyond a size.

    Args:
        most_bytes: of all bodies together; what alone is larger isn't kept.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most, self._size = most_bytes, 0
        self._answers: OrderedDict[tuple[str, int, int], Answer] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, place: tuple[str, int, int]) -> Answer | None:
        """What is kept there."""
        with self._lock:
            if place in self._answers:
                self._answers.move_to_end(place)
            return self._answers.get(place)

    def put(self, place: tuple[str, int, int], answer: Answer) -> None:
        """Keeps an answer, and forgets others for it."""
        with self._lock:
            if len(answer.body) > self._most or place in self._answers:
                return
            self._answers[place] = answer
            self._size += len(answer.body)
            while self._size > self._most:
                _, gone = self._answers.popitem(last=False)
                self._size -= len(gone.body)
