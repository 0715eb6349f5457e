"""Wide and narrow, light and dark, on paper, without script, for those who listen."""

import re
from typing import Any

import pytest

from tests.browser.episodes import map_of, page_of, parallel_episode
from tests.browser.waits import Open, expect, turn_of

pytestmark = pytest.mark.browser

LINE = {
    "id": "returns",
    "kind": "line",
    "title": "Returns by episode",
    "x": {"label": "episode", "values": list(range(6))},
    "y": {"label": "return"},
    "series": [
        {"name": "picker_0", "values": [1, 2, None, 4, 5, 6], "low": [0] * 6, "high": [7] * 6},
        {"name": "carrier_0", "values": [3, 2, 1, 2, 3, 4]},
    ],
    "marks": [{"x": 3, "text": "policy 2"}],
}
FOREST = {
    "id": "effects",
    "kind": "forest",
    "title": "Effects against the unchanged rerun",
    "x": {"label": "failures"},
    "zero": 0,
    "rows": [
        {"name": "perception", "group": "picker_0", "value": 0.2, "low": 0.1, "high": 0.3},
        {"name": "energy", "group": "picker_0", "value": None, "text": "not tested"},
    ],
}
MATRIX = {
    "id": "influence",
    "kind": "matrix",
    "title": "Influence",
    "row_label": "from",
    "column_label": "on",
    "rows": ["picker_0", "carrier_0"],
    "columns": ["picker_0", "carrier_0"],
    "values": [[None, 0.9], [0.5, 0.1]],
    "low": 0,
    "high": 1,
}
BARS = {
    "id": "terms",
    "kind": "bars",
    "title": "Terms",
    "x": {"label": "agent", "names": ["picker_0", "carrier_0"]},
    "y": {"label": "reward"},
    "series": [{"name": "delivery", "values": [3, 2]}, {"name": "collision", "values": [-1, None]}],
}
CHARTS = [LINE, FOREST, MATRIX, BARS]


def whole_page(**options: Any) -> str:
    """Everything that the player and the charts draw."""
    packed = parallel_episode()
    packed["drawing"] = map_of(packed)
    other = parallel_episode(episode=1, seed=1)
    return page_of([packed, other], charts=CHARTS, **options)


CONTRAST = "color-contrast"
"""The rule that takes four fifths of the time, and the only one that a scheme decides."""


def faults(page: Any, **options: Any) -> list[str]:
    """What axe-core finds, however serious, as `rule: where`."""
    from axe_playwright_python.sync_playwright import Axe  # not there for the ordinary tests

    found = (
        Axe().run(page, options={"resultTypes": ["violations"], **options}).response["violations"]
    )
    return [f"{rule['id']}: {node['target']}" for rule in found for node in rule["nodes"]]


def faults_anywhere(page: Any) -> list[str]:
    """As `faults`, on three widths, in the light and in the dark; the page is loaded once.

    Colours are judged in both schemes on one width, and on the narrowest, where parts may overlap.
    """
    plain = {"rules": {CONTRAST: {"enabled": False}}}
    found = []
    for scheme, width, options in (
        ("light", 1440, {}),
        ("light", 1024, plain),
        ("light", 390, {}),
        ("dark", 1440, {"runOnly": [CONTRAST]}),
    ):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": 900})
        found += [f"{scheme}, {width}: {fault}" for fault in faults(page, **options)]
    return found


def test_page_is_accessible(open_page: Open) -> None:
    """axe-core finds nothing, with two episodes, the list and all charts on show."""
    page = open_page(whole_page(), bypass_csp=True)
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name="Beside episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(2)
    page.locator("#charts").scroll_into_view_if_needed()
    expect(page.locator("#charts canvas").first).to_be_visible()
    found = faults_anywhere(page)
    for scheme, width in (("light", 1024), ("dark", 1024), ("dark", 390)):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": 900})
        found += [f"{scheme}, {width}: {fault}" for fault in faults(page, runOnly=[CONTRAST])]
    assert found == []


@pytest.mark.parametrize("width", [360, 800, 1400])
def test_page_fits_its_width(open_page: Open, width: int) -> None:
    """Nothing is wider than the page; what is wide scrolls in its own place."""
    page = open_page(whole_page(), viewport={"width": width, "height": 900})
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name="Beside episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(2)
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_every_control_is_reached_by_tab(open_page: Open) -> None:
    """The tab key alone reaches the slider, and where it stands is seen."""
    page = open_page(page_of([parallel_episode()]), address="#main")
    page.wait_for_selector("#gk-player[data-turn]")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.className") == "scrub":
            break
    assert page.evaluate("document.activeElement.className") == "scrub"
    style = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert style == "solid"


def test_touch_scrubs(open_page: Open) -> None:
    """A tap on the lanes chooses a turn on a phone."""
    size = {"width": 360, "height": 740}
    page = open_page(whole_page(), address="#play:a/0/0", has_touch=True, viewport=size)
    page.wait_for_selector("#gk-player[data-turn]")
    lanes = page.locator(".lanes-canvas")
    lanes.evaluate("lanes => lanes.scrollIntoView({ block: 'center', behavior: 'instant' })")
    box = lanes.bounding_box()
    page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + 10)
    assert turn_of(page) == 30


def test_page_without_script_tells_the_numbers(open_page: Open) -> None:
    """Without script the episodes stand in a table, and charts as their numbers."""
    page = open_page(whole_page(), java_script_enabled=False)
    assert page.locator("#gk-player").is_hidden()
    assert page.locator(".static-episodes tbody tr").count() == 2
    assert page.locator("noscript").inner_text().startswith("The player needs JavaScript")
    page.locator("#charts summary").first.click()
    assert page.locator("#charts table").first.locator("tbody tr").count() == 6


def test_paper_has_numbers_and_nothing_to_press(open_page: Open) -> None:
    """In print the controls are gone and the tables are whole."""
    page = open_page(whole_page())
    page.wait_for_selector("#gk-player[data-turn]")
    page.emulate_media(media="print")
    assert page.locator(".controls").is_hidden()
    assert page.locator(".static-episodes").is_visible()
    assert page.pdf()[:5] == b"%PDF-"


def test_paper_is_light(open_page: Open) -> None:
    """What is printed from a dark screen is drawn in the colours of paper."""
    page = open_page(whole_page(), color_scheme="dark")
    page.wait_for_selector("#gk-player[data-turn]")
    assert page.evaluate("gamekeeper.colours().ground") == "#14181c"
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("gamekeeper.colours().ground") == "#ffffff"
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate("gamekeeper.colours().ground") == "#14181c"


def test_chart_hides_a_line_by_keyboard(open_page: Open) -> None:
    """A line of a chart is switched off in its legend, by space."""
    page = open_page(whole_page())
    box = page.get_by_role("checkbox", name="carrier_0")
    box.scroll_into_view_if_needed()
    picture = "document.querySelector('[data-chart=returns] .uplot canvas').toDataURL()"
    before = page.evaluate(picture)
    box.focus()
    page.keyboard.press("Space")
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    assert not box.is_checked()
    assert page.evaluate(picture) != before


def test_dark_changes_the_drawing(open_page: Open) -> None:
    """Canvases are drawn again when the system changes to dark."""
    page = open_page(whole_page(), color_scheme="light")
    page.wait_for_selector("#gk-player[data-turn]")
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    picture = "document.querySelector('.lanes-canvas').toDataURL()"
    light = page.evaluate(picture)
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"(light) => {picture} !== light", arg=light)  # fails after its time


def test_copy_takes_the_snippet(open_page: Open) -> None:
    """A snippet's button copies its text, or selects it where a page may not copy."""
    html = page_of([parallel_episode()])
    box = '<pre id="one">gamekeeper replay runs/a</pre><button data-copy="one">Copy</button>'
    page = open_page(html.replace("</main>", f"{box}</main>"))
    page.get_by_role("button", name="Copy").click()
    expect(page.locator("[data-copy]")).to_have_text(re.compile("Copied|Selected"))
