"""Takes the picture of playing on: the panel of an interactive view, after 64 futures.

    python docs/pictures/play_on.py [--folder docs/pictures] [--turn 60]

Records the episode of `make.py`, in which `picker_1` is lazy, serves it, and lets the reference
policy play that agent from a turn on. It asks for what `make.py` asks for.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any, Final

from make import ARGUMENTS, small
from playwright.sync_api import expect, sync_playwright

import gamekeeper as gk
from gamekeeper.diagnosis.play_on import PlayOnOptions
from gamekeeper.viewing.viewer import Viewer

WIDTH: Final = 1100
PATIENCE_MS: Final = 300_000


def photograph(page: Any, view: Viewer, turn: int) -> bytes:
    """The panel once many futures have been played, as PNG."""
    page.goto(view.url)
    page.wait_for_url(f"http://127.0.0.1:{view.port}/")
    page.goto(f"{page.url}#play:a/0/{turn}@picker_1")
    panel = page.locator(".play-on")
    panel.locator("summary").first.click()
    expect(panel.get_by_role("button", name="Play many")).to_be_enabled(timeout=PATIENCE_MS)
    panel.get_by_label("What is changed").select_option("policy")
    panel.get_by_role("button", name="Play many").click()
    expect(panel.locator("tbody tr").first).to_be_visible(timeout=PATIENCE_MS)
    page.mouse.move(0, 0)
    return bytes(panel.screenshot())


def main() -> None:
    """Writes play-on.png."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent)
    parser.add_argument("--turn", type=int, default=60)
    parser.add_argument("--browser", default="/usr/bin/chromium")
    options = parser.parse_args()
    policies = {"picker_1": "lazy", "*": "reference"}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        run = Path(folder) / "lazy-picker"
        gk.rollout("warehouse", policies=policies, episodes=1, seed=0, out=run)
        browser = playwright.chromium.launch(executable_path=options.browser, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": WIDTH, "height": 1000}, color_scheme="light")
        with Viewer([run], interactive=PlayOnOptions()) as view:
            png = photograph(page, view, options.turn)
        browser.close()
    small(png).save(options.folder / "play-on.png", optimize=True)


if __name__ == "__main__":
    main()
