"""Episodes of a page: packed until a budget is spent, with their marks and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from gamekeeper.adapters.paging.pictures import Pictures
from gamekeeper.report.page.choose import Budget
from gamekeeper.report.page.compose import Documents, Pair, Shown
from gamekeeper.report.page.entries import entries_of, packed_of
from gamekeeper.report.page.pack import Mark, deflated

FRAMES_PART: Final = 6
"""An episode gets at most this part of what is left for pictures."""
LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"
"""Keys of runs; a twin's is longer."""


class Packer:
    """Packs episodes until the budget is spent; an episode's pair goes with it.

    `packed` holds them by run and number, deflated.
    """

    def __init__(
        self, runs: Sequence[Shown], pairs: Sequence[Pair], budget: Budget, frames: Budget,
        documents: Documents,
    ) -> None:  # fmt: skip
        """Nothing is packed yet.

        Args:
            runs: all runs and twins, the main one first.
            pairs: what is offered side by side.
            budget: of episodes.
            frames: of pictures.
            documents: about the main run; they say where its episodes part from twins.
        """
        self.packed: dict[tuple[str, int], bytes] = {}
        self._runs = {run.key: run for run in runs}
        self._pairs, self._budget, self._frames = pairs, budget, frames
        self._pictures = {run.key: Pictures(Path(run.path)) for run in runs}
        self._why: dict[tuple[str, int], tuple[str, ...]] = {}
        self._partings = (documents.diagnosis or {}).get("partings") or ()
        self._main = runs[0].key

    def has(self, pair: Pair) -> bool:
        """Both sides are on the page."""
        return pair.left in self.packed and pair.right in self.packed

    def fill(
        self, main: Shown, order: Sequence[tuple[int, tuple[str, ...]]]
    ) -> list[tuple[int, tuple[str, ...]]]:
        """Packs twins and episodes of the main run; those that were taken."""
        twins = [pair for pair in self._pairs if pair.left[0] != main.key]
        taken = []
        for number, why in order:
            is_named = "named" in why
            if self._budget.is_spent and not is_named:
                break
            if not self._take(main.key, number, why, must=is_named):
                continue
            taken.append((number, why))
            for pair in self._pairs:
                if pair.left == (main.key, number):
                    self._take(*pair.right, ("pair",))
            if twins:  # one pair of twins after each episode, so that neither crowds out the other
                pair = twins.pop(0)
                self._take(*pair.left, ("twin",))
                self._take(*pair.right, ("twin",))
        return taken

    def _take(self, key: str, number: int, why: tuple[str, ...], *, must: bool = False) -> bool:
        if (key, number) in self.packed:
            return True
        run = self._runs[key]
        frames = self._pictures[key].of(number, self._frames.left // FRAMES_PART)
        data = deflated(
            packed_of(
                run.evidence, number, run=key, labels=run.labels, seats=run.seats,
                marks=self._marks(key, number), frames=frames,
                has_failed=run.failed[run.figures.place(number)],
            )
        )  # fmt: skip
        pictures = 0 if frames is None else sum(map(len, frames.shown.values())) * 3 // 4
        size = max(len(data) - pictures, 0) * 4 // 3
        if not self._budget.take(size) and not must:
            return False
        self._frames.take(pictures)
        self.packed[key, number] = data
        self._why[key, number] = why
        return True

    def _marks(self, key: str, number: int) -> Iterator[Mark]:
        for pair in self._pairs:
            if (key, number) in (pair.left, pair.right) and pair.divergence is not None:
                where = pair.divergence
                yield Mark(where.turn or 0, "divergence", f"{pair.text}: {where.field}",
                           where.agent)  # fmt: skip
                if (key, number) == pair.right and pair.right[0] not in LETTERS:
                    yield Mark(0, "change", self._runs[key].name)
        for each in self._partings if key == self._main else ():
            if each["episode"] == number and each["turn"] is not None:
                text = f"parts from its twin under {each['remedy']}: {each['field']}"
                yield Mark(int(each["turn"]), "divergence", text, each["agent"])

    def entries(self, run: Shown) -> Iterator[dict[str, Any]]:
        """The run's episodes by numbers; of twins only those that are on the page."""
        bases = {pair.right: pair for pair in self._pairs}
        is_twin = run.key not in LETTERS
        for entry in entries_of(
            run.evidence, run=run.key, labels=run.labels, figures=run.figures, failed=run.failed
        ):
            place = (run.key, entry["episode"])
            if is_twin and place not in self.packed:
                continue
            pair = bases.get(place)
            base = None if pair is None else {"run": pair.left[0], "episode": pair.left[1]}
            yield {
                **entry,
                "packed": place in self.packed,
                "why": list(self._why.get(place, ())),
                "base": base,
                "change": run.name if is_twin and base else None,
            }
