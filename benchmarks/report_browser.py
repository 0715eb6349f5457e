"""How fast a report opens and scrubs in Chromium, as JSON lines.

Needs Playwright and Chromium (`make browser-test` sets both up):

    python benchmarks/report_browser.py report.html

`open_s`: from the request to the first turn on show, in a new context each time; `scrub_fps`:
frames a second while the slider is put on another turn each frame, as dragging does, 60 at most;
`work_ms`: processor time of the page for a frame of these, which a busy machine doesn't stretch as
much.
"""

import argparse
import json
import statistics
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
FRAMES = 300
# When the player first shows a turn, counted from the beginning of the navigation.
WATCH = """
new MutationObserver((changes, watch) => {
    if (document.querySelector('#gk-player[data-turn]')) {
        watch.disconnect();
        requestAnimationFrame(() => { window.shownAt = performance.now(); });
    }
}).observe(document, { subtree: true, attributes: true, attributeFilter: ['data-turn'] });
"""
# Sweeps the slider over the episode, a turn further each frame, there and back.
SCRUB = """(frames) => new Promise((done) => {
    const slider = document.querySelector('.scrub');
    const last = Number(slider.max);
    const times = [];
    let count = 0;
    const began = performance.now();
    const frame = () => {
        const way = (count * Math.max(1, Math.round(last / 120))) % (2 * last);
        slider.value = String(way > last ? 2 * last - way : way);
        slider.dispatchEvent(new Event('input'));
        requestAnimationFrame(() => {
            const channel = new MessageChannel();
            channel.port1.onmessage = () => {
                times.push(performance.now());
                if (++count < frames) frame();
                else done({ seconds: (performance.now() - began) / 1000, times });
            };
            channel.port2.postMessage(0);
        });
    };
    frame();
})"""


def main() -> None:
    """Opens a report a few times, then scrubs through its first episode and a pair."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("report", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--width", type=int, default=1400)
    given = parser.parse_args()
    address = given.report.resolve().as_uri()
    size = given.report.stat().st_size
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        opened = [_open_seconds(browser, address, given.width) for _ in range(given.repeats)]
        tell("report_open", bytes=size, open_s=statistics.median(opened), most_s=max(opened))
        page = page_of(browser, address, given.width)
        tell("report_scrub", **scrub(page))
        if _compare(page):
            tell("report_scrub_two", **scrub(page))
        browser.close()


def page_of(browser: Browser, address: str, width: int) -> Page:
    """A page whose player shows its first turn."""
    page = browser.new_context(viewport={"width": width, "height": 900}).new_page()
    page.add_init_script(WATCH)
    page.goto(address)
    page.wait_for_selector("#gk-player[data-turn]")
    page.wait_for_timeout(300)
    return page


def _open_seconds(browser: Browser, address: str, width: int) -> float:
    page = page_of(browser, address, width)
    shown = page.evaluate("window.shownAt") / 1000
    page.context.close()
    return float(shown)


def scrub(page: Page) -> dict[str, float]:
    """Frames a second over the sweep, the slowest hundredth, and the page's own work."""
    tools = page.context.new_cdp_session(page)
    tools.send("Performance.enable", {"timeDomain": "threadTicks"})
    before = _work(tools)
    found: dict[str, Any] = page.evaluate(SCRUB, FRAMES)
    after = _work(tools)
    gaps = [late - early for early, late in zip(found["times"], found["times"][1:], strict=False)]
    return {
        "scrub_fps": FRAMES / found["seconds"],
        "worst_frame_ms": sorted(gaps)[int(len(gaps) * 0.99) - 1],
        "work_ms": (after["TaskDuration"] - before["TaskDuration"]) * 1000 / FRAMES,
        "script_ms": (after["ScriptDuration"] - before["ScriptDuration"]) * 1000 / FRAMES,
        "layout_ms": (after["LayoutDuration"] - before["LayoutDuration"]) * 1000 / FRAMES,
    }


def _work(tools: Any) -> dict[str, float]:
    """What the page's own thread has worked so far, in seconds of processor time."""
    return {one["name"]: one["value"] for one in tools.send("Performance.getMetrics")["metrics"]}


def _compare(page: Page) -> bool:
    """Puts the last episode of the list beside the one on show, if there is another one."""
    page.locator(".episode-list > summary").click()
    buttons = page.locator(".episode-list button:text-is('Beside')")
    if buttons.count() < 2:
        return False
    buttons.last.click()
    page.wait_for_selector(".deck + .deck")
    page.locator(".episode-list > summary").click()
    page.wait_for_timeout(300)
    return True


def tell(figure: str, **values: float) -> None:
    """Prints a figure as a JSON line."""
    print(
        json.dumps({"figure": figure, **{name: round(value, 4) for name, value in values.items()}})
    )


if __name__ == "__main__":
    main()
