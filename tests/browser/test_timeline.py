"""A range of turns has its totals; pivots and the curve of success stand under the slider."""

from typing import Any

import pytest

from tests.browser.episodes import page_of, parallel_episode
from tests.browser.waits import Open, expect, expect_turn, turn_of

pytestmark = pytest.mark.browser


def opened(open_page: Open, *episodes: Any, address: str = "", **options: Any) -> Any:
    """A page whose first episode is on show."""
    page = open_page(page_of(episodes), address=address, **options)
    page.wait_for_selector("#gk-player[data-turn]")
    return page


def paid(packed: Any, agent: int, turns: range) -> float:
    """Sum of an agent's rewards over turns."""
    rows = packed["rows"]
    every = zip(rows["turn"], rows["agent"], rows["reward"], strict=True)
    return round(sum(x or 0 for turn, who, x in every if who == agent and turn in turns), 6)


def test_range_has_its_totals(open_page: Open) -> None:
    """R begins it at the cursor, the cursor is its other end, and a link leads back to it."""
    packed = parallel_episode()
    page = opened(open_page, packed, address="#play:a/0/10")
    page.locator(".scrub").press("r")
    page.locator(".scrub").press("Shift+ArrowRight")
    expect_turn(page, "20")
    expect(page.locator(".range-table caption")).to_have_text("Totals of turns 10 to 20")
    cells = page.locator(".range-table tbody tr").first.locator("td").all_inner_texts()
    assert (cells[0], float(cells[3].replace("\u2212", "-"))) == (
        "11",
        paid(packed, 0, range(10, 21)),
    )
    page.wait_for_url("**#play:a/0/20~10")
    expect(page.locator(".lanes-range")).to_be_visible()
    page.get_by_role("button", name="Range").click()
    expect(page.locator(".range-totals")).to_be_hidden()
    page.wait_for_url("**#play:a/0/20")
    again = opened(open_page, packed, address="#play:a/0/8~5@picker_0")
    expect(again.locator(".range-table caption")).to_have_text("Totals of turns 5 to 8")


def test_range_is_brushed_along_the_turns(open_page: Open) -> None:
    """A drag along the ruler is a range; a press on the lanes moves its other end only."""
    page = opened(open_page, parallel_episode())
    page.locator(".lanes-ruler").scroll_into_view_if_needed()
    box = page.locator(".lanes-ruler").bounding_box()
    per = box["width"] / 61
    page.mouse.move(box["x"] + 10.5 * per, box["y"] + 22)
    page.mouse.down()
    page.mouse.move(box["x"] + 15.5 * per, box["y"] + 22)
    page.mouse.move(box["x"] + 30.5 * per, box["y"] + 22)
    page.mouse.up()
    assert turn_of(page) == 30
    expect(page.locator(".range-table caption")).to_have_text("Totals of turns 10 to 30")
    shade = page.locator(".lanes-range").bounding_box()
    assert shade["width"] == pytest.approx(21 * per, abs=2)


def test_gallery_sorts_and_groups_episodes_and_opens_one(open_page: Open) -> None:
    """A line for each episode, the lowest return first, one press from the player; or by groups."""
    episodes = [parallel_episode(episode=k, seed=k, turns=12 if k == 3 else 60) for k in range(5)]
    page = opened(open_page, *episodes)
    page.locator(".episode-list > summary").click()
    expect(page.locator(".tile")).to_have_count(5)
    expect(page.locator(".tile .act-bar")).to_have_count(10)
    page.get_by_label("Sort by").select_option("behaviour")
    expect(page.locator(".gallery h4").filter(has_text="12 steps")).to_contain_text("1 episode ·")
    expect(page.locator(".tile")).to_have_count(5)
    page.get_by_label("Sort by").select_option("worst")
    team = [sum(x or 0 for x in each["rows"]["reward"]) for each in episodes]
    worst = team.index(min(team))
    expect(page.locator(".tile").first).to_contain_text(f"{worst}:")
    page.locator(".tile").first.click()
    page.wait_for_url(f"**#play:a/{worst}/*")


def test_pivots_stand_on_the_timeline(open_page: Open) -> None:
    """A mark that can be jumped to, and the curve with its fall, said for those who don't see."""
    mark = {
        "turn": 23,
        "kind": "pivot",
        "agent": "picker_0",
        "text": "success falls from 80% to 10%",
    }
    curve = [[0, 0.9, 0.7, 1.0], [23, 0.8, 0.6, 0.95], [24, 0.1, 0.0, 0.3], [60, 0.0, 0.0, 0.2]]
    packed = {**parallel_episode(), "curve": curve}
    packed["marks"] = [*packed["marks"], mark]
    page = opened(open_page, packed)
    page.get_by_role("button", name="lost here, picker_0, success falls").click()
    assert turn_of(page) == 23
    label = page.locator(".scrub-curve canvas").get_attribute("aria-label")
    assert "90 % from turn 0" in label
    assert "turn 23: success falls from 80% to 10%" in label
    bare = opened(open_page, parallel_episode())
    expect(bare.locator(".scrub-curve")).to_be_hidden()
