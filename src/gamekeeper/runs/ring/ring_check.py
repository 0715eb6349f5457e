"""Check that single episodes of a run come out again without the others, while it is recorded."""

from collections.abc import Sequence
from typing import Any, Final

from gamekeeper.episodes.buffer import EpisodeEnd, EpisodeStart
from gamekeeper.interface.openings import Openings
from gamekeeper.runs.first_check import DIVERGED, PASSED, FirstCheck, unchecked

WAIT_S: Final = 10.0
"""Longest time that closing waits for a check."""
SEEDED: Final = 8
"""Episodes after which a seeded one is checked, where each reset had a seed."""
ADVICE: Final = (
    "Episodes of this run are not expandable: level full is needed, or seed_resets=True where it "
    "was the missing seed"
)


class RingCheck:
    """Replays two episodes of a flight recorder in a worker each, one after the other.

    The first that ended by itself; then one whose reset had no seed, or, if each has one, a later
    one, so that what an environment keeps over its resets is noticed too.

    Args:
        openings: learns which of the global generators the environment draws from.
    """

    def __init__(self, path: str, openings: Openings) -> None:
        self._path, self._openings = path, openings
        self._checks: list[FirstCheck] = []
        self._unseeded: set[int] = set()
        self._ended = 0

    def take(self, starts: Sequence[EpisodeStart], ends: Sequence[EpisodeEnd]) -> None:
        """Looks at episodes that are on the disk, and begins a check where one is due."""
        if len(self._checks) == 2:
            return
        self._unseeded.update(start.episode for start in starts if start.seed is None)
        for end in ends:
            is_unseeded = end.episode in self._unseeded
            self._unseeded.discard(end.episode)
            if end.end != "ended":
                continue
            self._ended += 1
            is_due = not self._checks or (
                (is_unseeded or self._ended >= SEEDED) and self._checks[0].is_done
            )
            if is_due and len(self._checks) < 2:
                self._checks.append(FirstCheck(self._path, end.episode, advice=ADVICE))
        self._learn()

    def _learn(self) -> None:
        """Leaves out global generators that no check saw drawn from."""
        done = [check for check in self._checks if check.is_done and check.drew is not None]
        if done:
            drawn = {name for check in done for name in check.drew or ()}
            self._openings.drawn = tuple(sorted(drawn))

    def result(self) -> dict[str, Any]:
        """Waits a while, and returns the entry `checked` of the manifest.

        It is of the first check that diverged, else of the last that passed.
        """
        found = [check.result(WAIT_S) for check in self._checks]
        for outcome in (DIVERGED, PASSED):
            for each in found if outcome == DIVERGED else found[::-1]:
                if each["outcome"] == outcome:
                    return each
        return found[0] if found else unchecked("it was over before an episode could be checked")
