"""The first finished episode of a small run, replayed in a worker while recording goes on."""

import threading
from typing import Any, Final

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.workers import run_task
from gamekeeper.terminal import say

TASK: Final = "gamekeeper.runs.expanding:check_task"
SILENCE_S: Final = 60.0
"""Longest time without a turn of the replay."""
NOT_CHECKED: Final = "not checked"
LEVEL_FULL: Final = "This run can't be expanded; level full is needed (--level full)"
PASSED: Final = "passed"
DIVERGED: Final = "diverged"


def unchecked(why: str) -> dict[str, Any]:
    """Entry of a manifest: whether the run comes out again was not checked."""
    return {"outcome": NOT_CHECKED, "episode": None, "why": why}


class FirstCheck:
    """Replays one episode of a run that is being recorded, and says at once what came out.

    Args:
        episode: whose end is about to be written.
        advice: said where it comes out otherwise.
    Attributes:
        drew: global generators that the replay drew from; None: not known.
    """

    def __init__(self, path: str, episode: int, *, advice: str = LEVEL_FULL) -> None:
        self._path, self._episode, self._advice = path, episode, advice
        self.drew: list[str] | None = None
        self._found: dict[str, Any] = unchecked("it was interrupted")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="gamekeeper-check", daemon=True)
        self._thread.start()

    @property
    def is_done(self) -> bool:
        """True once the outcome is known."""
        return not self._thread.is_alive()

    def result(self, wait_s: float | None = None) -> dict[str, Any]:
        """Waits, and returns the outcome as it stands in the manifest.

        Args:
            wait_s: it is stopped after so many seconds; None: it has the time it takes.
        """
        try:
            self._thread.join(wait_s)
            if not self.is_done:
                self._stop.set()
                self._thread.join()
        except KeyboardInterrupt:
            self._stop.set()
            self._thread.join()
            raise
        return self._found

    def _run(self) -> None:
        try:
            arguments: Any = {"path": self._path, "episode": self._episode}
            outcome = run_task(TASK, arguments, silence_s=SILENCE_S, stop=self._stop)
        except GamekeeperError as error:  # no process can be started here
            self._found = unchecked(error.what)
            return
        if not isinstance(outcome.value, dict):
            self._found = unchecked(f"the replay {outcome.status}: {outcome.error}")
            return
        self.drew = outcome.value.pop("drew", None)
        self._found = {"episode": self._episode, **outcome.value}
        if self._found["outcome"] == DIVERGED:
            say(
                f"episode {self._episode} doesn't come out again when it is replayed: "
                f"{self._found['why']}\n{self._advice}"
            )
