"""Pictures of the tutorials: their reports as a browser shows them, light and dark.

Each page's blocks are typed in an empty folder, as the tests do it, and a part of the report that
they write is taken with Playwright and Chromium (`pip install playwright`; `CHROMIUM` names it):

    python docs/pictures/tutorials.py [PAGE...]
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src"), ""]

CHROMIUM: Final = os.environ.get("CHROMIUM", "/usr/bin/chromium")
TAKEN: Final = {
    "lazy-agent": ("lazy.html", "#play:a/1/18", ".deck", "tutorial-lazy"),
    "train-and-diagnose": ("field.html", "", "#causes figure", "tutorial-diagnosis"),
}
"""By page: its report, where that opens, which part is taken, and the picture."""


def typed(page: str) -> None:
    """Does in this folder what the page says."""
    from tests.surface.typed_pages import TYPED, blocks_of, run_block

    known: dict[str, Any] = {"__name__": "docs"}
    for block in blocks_of(ROOT / "docs" / "tutorials" / f"{page}.md"):
        if block.why_not is None and block.kind in TYPED:
            run_block(block, known)


def take(report: Path, place: str, part: str, picture: Path) -> None:
    """Saves what a browser shows of a report's part."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for scheme in ("light", "dark"):
            size = {"width": 1000, "height": 1600}
            page = browser.new_page(viewport=size, color_scheme=scheme)
            page.goto(report.resolve().as_uri() + place)
            page.locator(part).first.wait_for(state="visible")
            page.locator(part).first.screenshot(path=f"{picture}-{scheme}.png")
        browser.close()


def main(pages: list[str]) -> None:
    """Takes the pictures of these tutorials, or of all."""
    for page in pages or TAKEN:
        report, place, part, name = TAKEN[page]
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            typed(page)
            take(Path(report), place, part, Path(__file__).with_name(name))


if __name__ == "__main__":
    main(sys.argv[1:])
