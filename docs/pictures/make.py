"""Takes the README's picture: the player of a real report, in light and in dark.

    python docs/pictures/make.py [--folder docs/pictures] [--turn 60]

Records an episode of `warehouse` in which `picker_1` is played by the lazy policy, writes its
report and photographs the player at one turn. It asks for Playwright, Pillow and a Chromium
(`--browser /usr/bin/chromium`); everything shown is what that report shows.
"""

from __future__ import annotations

import argparse
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from PIL import Image
from playwright.sync_api import sync_playwright

WIDTH: Final = 1100
HEIGHT: Final = 592
ARGUMENTS: Final = ["--no-sandbox", "--disable-gpu", "--no-first-run"]
COLOURS: Final = 96  # enough for flat colours and grey edges of letters
PATIENCE_MS: Final = 60_000


def report(folder: Path) -> Path:
    """The page of one recorded episode."""
    import gamekeeper as gk

    run = folder / "lazy-picker"
    gk.rollout(
        "warehouse", policies={"picker_1": "lazy", "*": "reference"}, episodes=1, seed=0, out=run
    )
    return gk.report(run, folder / "report.html")


def photograph(page: Any, address: str, turn: int) -> bytes:
    """The player at a turn, as PNG."""
    page.goto(address)
    page.locator("#gk-player canvas, #gk-player img").first.wait_for(timeout=PATIENCE_MS)
    page.locator("#gk-player input[type=range]").first.evaluate(
        "(slider, turn) => { slider.value = turn;"
        " slider.dispatchEvent(new Event('input', {bubbles: true})); }",
        turn,
    )
    page.wait_for_timeout(1500)  # a picture, no test: frames are decoded when they are looked at
    page.locator("#player").scroll_into_view_if_needed()
    box = page.locator("#player").bounding_box()
    return bytes(
        page.screenshot(
            full_page=True,
            clip={
                "x": box["x"] - 12,
                "y": box["y"] + page.evaluate("scrollY") - 8,
                "width": box["width"] + 24,
                "height": min(box["height"] + 12, HEIGHT),
            },
        )
    )


def small(png: bytes) -> Image.Image:
    """The picture with as many colours as it needs."""
    return Image.open(BytesIO(png)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)


def main() -> None:
    """Writes player-light.png and player-dark.png."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent)
    parser.add_argument("--turn", type=int, default=60)
    parser.add_argument("--browser", default="/usr/bin/chromium")
    parser.add_argument("--page", type=Path, help="a report that is there already")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        made = options.page or report(Path(folder))
        browser = playwright.chromium.launch(executable_path=options.browser, args=ARGUMENTS)
        for scheme in ("light", "dark"):
            page = browser.new_page(viewport={"width": WIDTH, "height": 900}, color_scheme=scheme)
            png = photograph(page, made.resolve().as_uri(), options.turn)
            path = options.folder / f"player-{scheme}.png"
            small(png).save(path, optimize=True)
        browser.close()


if __name__ == "__main__":
    main()
