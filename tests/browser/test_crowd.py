"""Many agents and many turns: only what is in sight is made and drawn."""

import re
from typing import Any

import pytest

from tests.browser.episodes import page_of, parallel_episode
from tests.browser.waits import Open, expect, turn_of

LANES = "gamekeeper.player.decks[0].lanes"

pytestmark = pytest.mark.browser

# Counts what is drawn on canvases from now on.
COUNT = """() => {
    window.drawn = 0;
    const ink = CanvasRenderingContext2D.prototype;
    for (const name of ['fillRect', 'fillText', 'stroke']) {
        const real = ink[name];
        ink[name] = function (...given) { window.drawn++; return real.apply(this, given); };
    }
}"""
# Puts the slider on a turn, as a reader's dragging does.
DRAG = """(turn) => {
    const slider = document.querySelector('.scrub');
    slider.value = String(turn);
    slider.dispatchEvent(new Event('input'));
}"""


def unfolded(open_page: Open) -> Any:
    """A page of 300 agents, a lane each."""
    page = open_page(page_of([parallel_episode(agents=300, turns=40)]))
    page.wait_for_selector("#gk-player[data-turn]")
    page.get_by_role("button", name="One lane for others").click()
    return page


def test_others_of_a_crowd_are_one_lane_and_one_row(open_page: Open) -> None:
    """Sixteen outliers have a lane and a row each; a press on the others gives each its own."""
    page = open_page(page_of([parallel_episode(agents=300, turns=40)]))
    page.wait_for_selector("#gk-player[data-turn]")
    names = page.locator(".lane-name:not([hidden]) bdi")
    expect(names).to_have_count(17)
    expect(names.last).to_have_text("others (284)")
    row = page.locator(".turn-table tbody tr:not([hidden])").last
    expect(row.locator("th")).to_have_text("others (284)")
    expect(row.locator("td").nth(0)).to_have_text(re.compile(r"\d+ acted"))
    expect(row.locator("td").nth(1)).to_have_text(re.compile(r".+ to .+"))
    names.last.click()
    expect(page.locator(".turn .pager")).to_contain_text("1 to 40 of 300")


def test_a_role_folds_into_one_lane(open_page: Open) -> None:
    """Its agents become one lane and one row; a chosen one keeps its own; a press unfolds them."""
    page = open_page(page_of([parallel_episode(agents=8)]), address="#play:a/0/7@picker_1")
    page.wait_for_selector("#gk-player[data-turn]")
    names = page.locator(".lane-name:not([hidden]) bdi")
    expect(names).to_have_count(8)
    page.get_by_role("button", name="One lane for picker").click()
    expect(names.last).to_have_text("picker (3)")
    assert "picker_1" in names.all_inner_texts()
    rows = page.locator(".turn-table tbody tr:not([hidden]) th")
    expect(rows).to_have_text(names.all_inner_texts())
    names.last.click()
    expect(names).to_have_count(8)


def test_crowd_has_nodes_for_those_in_sight_only(open_page: Open) -> None:
    """Of hundreds of agents only those in sight have a name and a row."""
    page = unfolded(open_page)
    assert turn_of(page) == 13
    assert 10 < page.locator(".lane-name").count() < 40
    assert page.locator(".turn-table tbody tr").count() == 40
    page.get_by_role("button", name="Later agents").click()
    expect(page.locator(".turn .pager")).to_contain_text("41 to 80 of 300")
    first = page.locator(".turn-table tbody th").first
    assert first.inner_text() == page.evaluate(f"{LANES}.order[40].name")


def test_crowd_scrolls_to_the_last_lane(open_page: Open) -> None:
    """Scrolling the lanes shows the names of those who come in sight."""
    page = unfolded(open_page)
    page.locator(".lanes-scroll").evaluate("(lanes) => { lanes.scrollTop = lanes.scrollHeight; }")
    assert turn_of(page) == 13
    names = page.locator(".lane-name:not([hidden])").all_inner_texts()
    last = page.evaluate(f"{LANES}.order.at(-1).name")
    assert names[-1] == last


def test_outliers_of_a_crowd_come_first(open_page: Open) -> None:
    """Among fifty agents and more the first lane is that of the return furthest from the others."""
    packed = parallel_episode(agents=60, turns=20)
    packed["rows"]["reward"][60 * 3 + 41] = 500.0
    page = open_page(page_of([packed]))
    page.wait_for_selector("#gk-player[data-turn]")
    expect(page.locator(".lane-name bdi").first).to_have_text(packed["agents"][41]["name"])


def test_scrubbing_draws_nothing_in_the_lanes(open_page: Open) -> None:
    """While all turns are in sight, moving the cursor draws no lane anew."""
    page = open_page(page_of([parallel_episode(agents=40, turns=3_000)]))
    page.wait_for_selector("#gk-player[data-turn]")
    assert turn_of(page) == 1000
    page.evaluate(COUNT)
    for turn in (10, 2_000, 2_999):
        page.evaluate(DRAG, turn)
        assert turn_of(page) == turn
    assert page.evaluate("window.drawn") == 0
    expect(page.locator(".turn-table caption")).to_contain_text("Turn 2999 of")  # at rest


def test_long_lanes_are_drawn_by_pixels(open_page: Open) -> None:
    """A lane of 30,000 turns costs about as many strokes as it has pixels, from afar and near."""
    page = open_page(page_of([parallel_episode(agents=2, turns=30_000)]), address="#play:a/0/29000")
    page.wait_for_selector("#gk-player[data-turn]")
    assert turn_of(page) == 29_000
    width = page.locator(".lanes-canvas").bounding_box()["width"]
    page.evaluate(COUNT)
    for name in ("Show fewer turns", "Show fewer turns", "Show all turns"):
        page.evaluate("window.drawn = 0")
        page.get_by_role("button", name=name).click()
        assert turn_of(page) == 29_000
        assert 0 < page.evaluate("window.drawn") < 2 * 6 * width
