"""Takes the pictures of real pages: an audit's finding, the player, the panel of playing on.

    python docs/pictures/make.py [--folder docs/pictures] [--turn 60]

Records an episode of `warehouse` in which `picker_1` is played by the lazy policy. Its report is
photographed at one turn; an interactive view of it lets the reference policy play that agent from
there on, in 64 futures. The finding is one of PettingZoo's knights_archers_zombies, from a report
of one episode with the audit. It asks for Playwright, Pillow, `pettingzoo[butterfly]` and a
Chromium (`--browser /usr/bin/chromium`).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any, Final

from PIL import Image
from playwright.sync_api import expect, sync_playwright

import gamekeeper as gk
from gamekeeper.diagnosis.play_on import PlayOnOptions
from gamekeeper.viewing.viewer import Viewer

SIZE: Final = {"width": 1100, "height": 1000}
HEIGHT: Final = 592
ARGUMENTS: Final = ["--no-sandbox", "--disable-gpu", "--no-first-run"]
COLOURS: Final = 200  # enough for flat colours and grey edges of letters
PATIENCE_MS: Final = 300_000
POLICIES: Final = {"picker_1": "lazy", "*": "reference"}
AUDITED: Final = "butterfly/knights_archers_zombies-v11"
NARROW: Final = {"width": 760, "height": 900}


def audited(folder: Path) -> str:
    """Address of a report of one episode with the audit that finds GK604."""
    audit = folder / "audit.json"
    found = gk.audit(AUDITED, select=("GK604",), budget=1_000)
    audit.write_text(json.dumps(found.to_json()), encoding="utf-8")
    gk.rollout(AUDITED, episodes=1, seed=0, out=folder / "knights")
    return gk.report(folder / "knights", folder / "knights.html", audit=audit).as_uri()


def finding(page: Any, address: str) -> bytes:
    """The card of the first failed check, as PNG."""
    page.goto(address)
    page.locator("#gk-player[data-turn]").wait_for(timeout=PATIENCE_MS)
    card = page.locator("#verdicts .card").first
    page.mouse.move(0, 0)
    return bytes(card.screenshot())


def player(page: Any, address: str, turn: int) -> bytes:
    """The player at a turn, as PNG."""
    page.goto(f"{address}#play:a/0/{turn}")
    page.locator(f"#gk-player[data-turn='{turn}']").wait_for(timeout=PATIENCE_MS)
    page.wait_for_timeout(1500)  # a picture, no test: frames are decoded when they are looked at
    page.evaluate("document.activeElement.blur()")
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


def panel(page: Any, view: Viewer, turn: int) -> bytes:
    """The panel of playing on once many futures have been played, as PNG."""
    page.goto(view.url)
    page.wait_for_url(f"http://127.0.0.1:{view.port}/")
    page.goto(f"{page.url}#play:a/0/{turn}@picker_1")
    found = page.locator(".play-on")
    found.locator("summary").first.click()
    expect(found.get_by_role("button", name="Play many")).to_be_enabled(timeout=PATIENCE_MS)
    found.get_by_label("What is changed").select_option("policy")
    found.get_by_role("button", name="Play many").click()
    expect(found.locator("tbody tr").first).to_be_visible(timeout=PATIENCE_MS)
    page.mouse.move(0, 0)
    page.evaluate("document.querySelector('.controls').style.position = 'static'")
    return bytes(found.screenshot())


def save(png: bytes, path: Path) -> None:
    """Writes the picture with as many colours as it needs."""
    picture = Image.open(BytesIO(png)).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def main() -> None:
    """Writes a light and a dark picture of the finding, the player and the panel."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent)
    parser.add_argument("--turn", type=int, default=60)
    parser.add_argument("--browser", default="/usr/bin/chromium")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        run = Path(folder) / "lazy-picker"
        gk.rollout("warehouse", policies=POLICIES, episodes=1, seed=0, out=run)
        address = gk.report(run, Path(folder) / "report.html").as_uri()
        knights = audited(Path(folder))
        browser = playwright.chromium.launch(executable_path=options.browser, args=ARGUMENTS)
        for scheme in ("light", "dark"):
            page = browser.new_page(viewport=NARROW, color_scheme=scheme)
            save(finding(page, knights), options.folder / f"finding-{scheme}.png")
            page = browser.new_page(viewport=SIZE, color_scheme=scheme)
            save(player(page, address, options.turn), options.folder / f"player-{scheme}.png")
            with Viewer([run], interactive=PlayOnOptions()) as view:
                save(panel(page, view, options.turn), options.folder / f"play-on-{scheme}.png")
        browser.close()


if __name__ == "__main__":
    main()
