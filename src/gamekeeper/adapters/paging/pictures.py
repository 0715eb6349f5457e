"""Recorded frames of a run, as a page shows them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from gamekeeper.record.files.folder import read_bounded
from gamekeeper.report.page.drawing import Film
from gamekeeper.report.page.png import data_url

FRAME: Final = re.compile(r"(\d{6,9})-(\d{6,9})\.(png|txt)")
FRAME_BYTES: Final = 1 << 26
"""Of one picture."""


class Pictures:
    """The recorded frames of a run, thinned out to fit."""

    def __init__(self, run: Path) -> None:
        """Looks which there are."""
        self._files: dict[int, dict[int, Path]] = {}
        folder = run / "frames"
        if folder.is_symlink() or not folder.is_dir():
            return
        for path in sorted(folder.iterdir()):
            found = FRAME.fullmatch(path.name)
            if found is not None and path.is_file() and not path.is_symlink():
                self._files.setdefault(int(found[1]), {})[int(found[2])] = path

    def of(self, episode: int, most_bytes: int) -> Film | None:
        """What was rendered by turn; every k-th picture where they don't all fit."""
        files = self._files.get(episode)
        if not files:
            return None
        size = sum(path.stat().st_size for path in files.values())
        step = max(1, -(-size // max(most_bytes, 1)))
        turns = sorted(files)[::step]
        if len(turns) < 2 <= len(files) and step > 1:
            return None
        is_text = files[turns[0]].suffix == ".txt"
        kept = {turn: read_bounded(files[turn], FRAME_BYTES) for turn in turns}
        return Film(
            {
                turn: data.decode(errors="replace") if is_text else data_url(data)
                for turn, data in kept.items()
                if (files[turn].suffix == ".txt") is is_text
            },
            is_text=is_text,
        )
