"""Episodes of a page: packed until a budget is spent, with their marks and recorded frames."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from gamekeeper.reporting.diagnosis_text import restored_first
from gamekeeper.reporting.page.composition import Documents, Pair, ShownRun
from gamekeeper.reporting.page.episode_list import Budget, entries_of, packed_of
from gamekeeper.reporting.page.packed_episode import Mark, deflated
from gamekeeper.reporting.page.packed_values import data_url
from gamekeeper.reporting.page.player_drawing import Drawing
from gamekeeper.reporting.results_text import few
from gamekeeper.runs.files.folder import read_bounded

FRAME: Final = re.compile(r"(\d{6,9})-(\d{6,9})\.(png|txt)")
FRAME_BYTES: Final = 1 << 26
"""Largest file of one frame."""


class Pictures:
    """The recorded frames of a run, thinned out to fit."""

    def __init__(self, run: Path) -> None:
        self._files: dict[int, dict[int, Path]] = {}
        folder = run / "frames"
        if folder.is_symlink() or not folder.is_dir():
            return
        for path in sorted(folder.iterdir()):
            found = FRAME.fullmatch(path.name)
            if found is not None and path.is_file() and not path.is_symlink():
                self._files.setdefault(int(found[1]), {})[int(found[2])] = path

    def of(self, episode: int, most_bytes: int) -> Drawing | None:
        """The frames of an episode by turn; every k-th one where they don't all fit."""
        files = self._files.get(episode)
        if not files:
            return None
        size = sum(path.stat().st_size for path in files.values())
        step = max(1, -(-size // max(most_bytes, 1)))
        turns = sorted(files)[::step]
        if len(turns) < 2 <= len(files) and step > 1:
            return None
        is_text = files[turns[0]].suffix == ".txt"
        data = {turn: read_bounded(files[turn], FRAME_BYTES) for turn in turns}
        return Drawing(
            {
                turn: frame.decode(errors="replace") if is_text else data_url(frame)
                for turn, frame in data.items()
                if (files[turn].suffix == ".txt") is is_text
            },
            is_text=is_text,
        )


FRAMES_PART: Final = 6
"""An episode gets at most this part of the bytes that are left for frames."""
LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"
"""Keys of runs; a counterfactual's is longer."""


class Packer:
    """Packs episodes until the budget is spent; an episode's pair goes with it.

    `packed` holds them by run and number, deflated.
    """

    def __init__(
        self,
        runs: Sequence[ShownRun],
        pairs: Sequence[Pair],
        budget: Budget,
        frames: Budget,
        documents: Documents,
    ) -> None:
        """Begins without episodes.

        Args:
            runs: all runs and counterfactuals, the main one first.
            pairs: pairs of episodes that the player can show side by side.
            budget: of episodes.
            frames: of recorded frames.
            documents: about the main run, with first differences from counterfactuals.
        """
        self.packed: dict[tuple[str, int], bytes] = {}
        self._runs = {run.key: run for run in runs}
        self._pairs, self._budget, self._frames = pairs, budget, frames
        self._pictures = {run.key: Pictures(Path(run.path)) for run in runs}
        self._why: dict[tuple[str, int], tuple[str, ...]] = {}
        diagnosis = documents.diagnosis or {}
        self._counterfactuals = diagnosis.get("counterfactuals") or ()
        self._named = restored_first(diagnosis)
        self._pivots, self._main = documents.pivots, runs[0].key

    def has(self, pair: Pair) -> bool:
        """True if both episodes are on the page."""
        return pair.left in self.packed and pair.right in self.packed

    def fill(
        self, main: ShownRun, order: Sequence[tuple[int, tuple[str, ...]]]
    ) -> list[tuple[int, tuple[str, ...]]]:
        """Packs episodes of the main run and counterfactuals, and returns those that fit."""
        counterfactuals = [pair for pair in self._pairs if pair.left[0] != main.key]
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
            # One pair of counterfactuals after each episode, so that neither crowds out the other.
            if counterfactuals:
                pair = counterfactuals.pop(0)
                self._take(*pair.left, ("counterfactual",))
                self._take(*pair.right, ("counterfactual",))
        return taken

    def _take(self, key: str, number: int, why: tuple[str, ...], *, must: bool = False) -> bool:
        if (key, number) in self.packed:
            return True
        run = self._runs[key]
        frames = self._pictures[key].of(number, self._frames.left // FRAMES_PART)
        data = deflated(
            packed_of(
                run.evidence,
                number,
                run=key,
                labels=run.labels,
                roster=run.roster,
                marks=self._marks(key, number),
                frames=frames,
                has_failed=run.failed[run.figures.place(number)],
                condition=run.asked,
                pivots=self._pivots if key == self._main else None,
            )
        )
        # Pictures hardly deflate, and stand in the data as base64: they have a budget of their own.
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
                if where.turn is not None:
                    text = f"{pair.text}: {where.field}"
                    yield Mark(where.turn, "divergence", text, where.agent)
                if (key, number) == pair.right and pair.right[0] not in LETTERS:
                    yield Mark(0, "change", self._runs[key].name)
        yield from self._first_differences(number) if key == self._main else ()

    def _first_differences(self, number: int) -> Iterator[Mark]:
        """First differences of an episode from its counterfactuals; the one the answers name."""
        named = self._named or {}
        places: dict[tuple[int, str | None, str], list[str]] = {}
        for each in self._counterfactuals:
            if each["episode"] == number and each["turn"] is not None:
                place = int(each["turn"]), each["agent"], str(each["field"])
                names = places.setdefault(place, [])
                names.insert(0 if each is named else len(names), each["intervention"])
        of_answer = tuple(named.get(name) for name in ("turn", "agent", "field"))
        for place, names in places.items():
            turn, agent, field = place
            is_answer = number == named.get("episode") and place == of_answer
            text = f"{field} differs with {few(dict.fromkeys(names), most=1)}"
            yield Mark(turn, "since" if is_answer else "divergence", text, agent)

    def entries(self, run: ShownRun) -> Iterator[dict[str, Any]]:
        """Entries of the run's episodes; of counterfactuals only those that are on the page."""
        bases = {pair.right: pair for pair in self._pairs}
        is_counterfactual = run.key not in LETTERS
        for entry in entries_of(
            run.evidence, run=run.key, labels=run.labels, figures=run.figures, failed=run.failed
        ):
            place = (run.key, entry["episode"])
            if is_counterfactual and place not in self.packed:
                continue
            pair = bases.get(place)
            base = None if pair is None else {"run": pair.left[0], "episode": pair.left[1]}
            yield {
                **entry,
                "packed": place in self.packed,
                "why": list(self._why.get(place, ())),
                "base": base,
                "change": run.name if is_counterfactual and base else None,
            }
