"""Which episodes stand on a page: those that a reader asks for first, under a budget."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from gamekeeper.errors import EvidenceError
from gamekeeper.report.page.figures import Figures

BUDGET_BYTES: Final = 2_500_000
"""Of packed episodes on a page, in base64."""
MISSES: Final = 3
"""After as many that didn't fit nothing further is tried."""


def order_of(
    figures: Figures,
    *,
    failing: Sequence[bool | None],
    named: Iterable[int] = (),
    labelled: Iterable[int] = (),
    diverging: Iterable[int] = (),
) -> list[tuple[int, tuple[str, ...]]]:
    """All episodes in the order in which they are taken, each with the reasons for it.

    Named ones first, then those with labels or divergences, one that failed, the median and the
    best by the sum of all returns, the other failing ones; then the rest, spread over the run.

    Args:
        figures: of the run.
        failing: by episode.
        named: numbers of episodes that were asked for.
        labelled: of those with labels.
        diverging: of those that part from another.
    Raises:
        EvidenceError: a named episode isn't in the run.
    """
    numbers = [int(header["episode"]) for header in figures.headers]
    known = set(numbers)
    named = list(dict.fromkeys(named))
    for each in named:
        if each not in known:
            raise EvidenceError(
                f"the run has no episode {each}",
                where="episodes",
                expected=f"one of {len(numbers)} episodes",
                seen=str(each),
            )
    failed = [number for number, bad in zip(numbers, failing, strict=True) if bad]
    median, best = _middle_and_best(figures, numbers)
    reasons: dict[int, list[str]] = {}
    for why, group in (
        ("named", named), ("label", labelled), ("divergence", diverging), ("failing", failed[:1]),
        ("median", median), ("best", best), ("failing", failed[1:]), ("", _spread(numbers)),
    ):  # fmt: skip
        for number in group:
            if number in known:
                told = reasons.setdefault(number, [])
                told += [why] if why and why not in told else []
    return [(number, tuple(told)) for number, told in reasons.items()]


def _middle_and_best(figures: Figures, numbers: Sequence[int]) -> tuple[list[int], list[int]]:
    team = np.where(np.isfinite(figures.team), figures.team, -np.inf)
    if not len(team):
        return [], []
    by_team = np.argsort(team, kind="stable")
    return [numbers[int(by_team[(len(team) - 1) // 2])]], [numbers[int(by_team[-1])]]


def _spread(numbers: Sequence[int]) -> list[int]:
    """The first, the last, the one between them, and so on: wherever it stops, it is even."""
    if not numbers:
        return []
    found = [0, len(numbers) - 1]
    gaps = [(0, len(numbers) - 1)]
    while gaps:
        low, high = gaps.pop(0)
        middle = (low + high) // 2
        if high - low > 1:
            found.append(middle)
            gaps += [(low, middle), (middle, high)]
    return [numbers[place] for place in dict.fromkeys(found)]


class Budget:
    """Bytes that may still be spent; what doesn't fit isn't taken, and soon nothing is tried."""

    def __init__(self, size_bytes: int) -> None:
        """So many are left."""
        self.left = size_bytes
        self.misses = 0

    @property
    def is_spent(self) -> bool:
        """Nothing further is worth a try."""
        return self.left <= 0 or self.misses >= MISSES

    def take(self, size_bytes: int) -> bool:
        """Spends so many bytes if they are left."""
        if size_bytes > self.left:
            self.misses += 1
            return False
        self.left -= size_bytes
        return True


def chosen_text(taken: Sequence[tuple[int, tuple[str, ...]]], every: int, *, run: str) -> str:
    """In words, which episodes are on the page and where the others are.

    Args:
        taken: numbers with their reasons.
        every: episodes of the run.
        run: its folder as it was named.
    """
    if len(taken) == every:
        return "All episodes are on this page."
    told = [f"{number} ({', '.join(why)})" if why else str(number) for number, why in sorted(taken)]
    return (
        f"{len(taken)} of {every} episodes are on this page, as many as its budget of data holds: "
        f"{', '.join(told) or 'none'}. `gamekeeper view {run}` shows all of them; "
        "`--episode N` puts one on the page, `--budget` holds more."
    )
