"""The player steps, plays, jumps and points, by keyboard and by mouse."""

import base64
from typing import Any

import pytest

from tests.browser.episodes import aec_episode, map_of, page_of, parallel_episode
from tests.browser.waits import Open, expect, expect_turn, turn_of

pytestmark = pytest.mark.browser

PIXEL = """([x, y]) => {
    const ink = document.querySelector('.cells-part canvas').getContext('2d');
    return [...ink.getImageData(x, y, 1, 1).data];
}"""


def opened(open_page: Open, *episodes: Any, address: str = "", **options: Any) -> Any:
    """A page whose first episode is on show."""
    page = open_page(page_of(episodes), address=address, **options)
    page.wait_for_selector("#gk-player[data-turn]")
    return page


def test_player_begins_where_it_failed(open_page: Open) -> None:
    """The first episode opens at its failure; without one, at its beginning."""
    assert turn_of(opened(open_page, parallel_episode())) == 20
    assert turn_of(opened(open_page, aec_episode())) == 0


def test_player_begins_where_it_broke_off(open_page: Open) -> None:
    """An error at the last turn is where it opens; so is the last turn that a killed run kept."""
    mark = {"turn": 11, "kind": "error", "agent": None, "text": "ValueError: no"}
    failed = {**aec_episode(), "end": "failed", "error": "ValueError: no", "marks": [mark]}
    assert turn_of(opened(open_page, failed)) == 11
    page = opened(open_page, {**aec_episode(), "end": "open"})
    assert turn_of(page) == 11
    assert "no end: still recorded, or killed" in page.locator(".deck-facts").inner_text()


def test_agents_that_act_together_have_no_order(open_page: Open) -> None:
    """A tick's actions are those of a dictionary: no place among them is shown."""
    page = opened(open_page, parallel_episode())
    heads = page.locator(".turn-table thead th").all_inner_texts()
    assert heads[:3] == ["agent", "action", "reward"]
    assert "order" not in heads


@pytest.mark.parametrize(
    ("keys", "turn"),
    [
        (["ArrowRight"], 1),
        (["ArrowRight", "ArrowRight", "ArrowLeft"], 1),
        (["Shift+ArrowRight"], 10),
        (["End"], 60),
        (["End", "Shift+ArrowLeft"], 50),
        (["End", "Home"], 0),
        (["ArrowLeft"], 0),
        (["]"], 20),
        (["]", "]"], 30),
        (["End", "["], 30),
    ],
)
def test_player_obeys_keys(open_page: Open, keys: list[str], turn: int) -> None:
    """Arrows step a turn, with Shift ten; Home, End and the brackets jump; the ends hold."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/0")
    page.locator(".scrub").focus()
    for key in keys:
        page.keyboard.press(key)
    assert turn_of(page) == turn
    assert page.locator(".scrub").input_value() == str(turn)
    assert page.locator(".turn-table caption").inner_text().startswith(f"Turn {turn} of 60")


def test_space_plays_and_stops(open_page: Open) -> None:
    """Space plays at the speed that was set, and stops again."""
    page = opened(open_page, parallel_episode(turns=5000), address="#play:a/0/0")
    page.locator(".scrub").focus()
    for _ in range(4):
        page.keyboard.press("+")
    page.keyboard.press(" ")
    expect_turn(page, r"[2-9]\d|\d{3,}")
    page.keyboard.press(" ")
    stopped = turn_of(page)
    assert page.get_by_role("button", name="Play (space)").count() == 1
    assert turn_of(page) == stopped


def test_play_ends_at_the_last_turn(open_page: Open) -> None:
    """Playing stops by itself at the end, and begins anew from there."""
    page = opened(open_page, aec_episode(), address="#play:b/0/10")
    page.get_by_role("button", name="Play (space)").click()
    expect_turn(page, "11")
    for _ in range(3):
        page.get_by_role("button", name="Slower").click()
    page.get_by_role("button", name="Play (space)").click()
    expect_turn(page, r"\d|10")


def test_turn_is_typed(open_page: Open) -> None:
    """A number puts the cursor on its turn; one past the end on the last."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/0")
    number = page.get_by_label("Go to turn")
    number.fill("42")
    assert turn_of(page) == 42
    number.fill("99")
    assert (turn_of(page), number.input_value()) == (60, "60")


def test_jump_goes_to_its_mark(open_page: Open) -> None:
    """A mark's button puts the cursor on its turn."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/0")
    page.get_by_role("button", name="turn 30: label, perception").click()
    assert turn_of(page) == 30


def test_pointing_at_lanes_chooses_a_turn(open_page: Open) -> None:
    """A press in the lanes, and dragging from there, put the cursor below the pointer."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/0")
    box = page.locator(".lanes-canvas").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 20)
    page.mouse.down()
    assert turn_of(page) == 30
    page.mouse.move(box["x"] + box["width"] - 1, box["y"] + 20)
    assert turn_of(page) == 60
    page.mouse.up()


def test_table_tells_what_stands_under_the_cursor(open_page: Open) -> None:
    """Each agent's row holds its action, reward, mask and info of exactly this turn."""
    packed = parallel_episode()
    page = opened(open_page, packed, address="#play:a/0/7")
    cells = page.locator(".turn-table tbody tr").first.locator("th, td").all_inner_texts()
    first = 7 * 4
    rows = packed["rows"]
    paid, action = rows["reward"][first], rows["action"][first]
    shown = [text.replace("\N{MINUS SIGN}", "-") for text in cells]
    assert shown[:2] == ["picker_0", f"{action} ·" if action == 0 else str(action)]
    assert float(shown[2]) == paid
    assert shown[5:] == ["no", "4 of 5: 0, 1, 3, 4", '{"position":[1,2]}']
    assert float(shown[4]) == pytest.approx(sum(rows["reward"][: first + 1 : 4]), abs=1e-4)


def test_slider_says_the_turn(open_page: Open) -> None:
    """The slider has its value in words; a cursor at rest is read out and stands in the address."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/7")
    page.locator(".scrub").focus()
    page.keyboard.press("ArrowRight")
    assert turn_of(page) == 8
    assert page.locator(".scrub").get_attribute("aria-valuetext") == "turn 8 of 60"
    page.wait_for_url("**#play:a/0/8")
    expect(page.locator("#gk-player > [role=status]")).to_contain_text("Turn 8 of 60")


def test_list_filters_and_opens(open_page: Open) -> None:
    """The list finds episodes by words, and opens the one that is asked for."""
    episodes = [parallel_episode(episode=k, seed=k, turns=30) for k in range(30)]
    page = opened(open_page, *episodes)
    page.locator(".episode-list > summary").click()
    assert page.locator(".episode-list tbody tr").count() == 12
    page.locator(".episode-list input").fill("seed 27")
    assert page.locator(".episode-list tbody tr").count() == 1
    page.get_by_role("button", name="Play episode 27 of run a").click()
    expect(page.locator(".deck h3")).to_contain_text("Episode 27")


def test_list_sorts_by_a_column(open_page: Open) -> None:
    """A heading sorts by its numbers, the largest first; pressed again, the smallest first."""
    episodes = [parallel_episode(episode=k, seed=k, turns=10 + 7 * k % 11) for k in range(9)]
    page = opened(open_page, *episodes)
    page.locator(".episode-list > summary").click()
    heading = page.get_by_role("columnheader", name="steps")
    shown = page.locator(".episode-list tbody tr td:nth-child(5)")
    turns = sorted(packed["turns"] for packed in episodes)
    heading.get_by_role("button").click()
    assert [int(text) for text in shown.all_inner_texts()] == turns[::-1]
    assert heading.get_attribute("aria-sort") == "descending"
    heading.get_by_role("button").click()
    assert [int(text) for text in shown.all_inner_texts()] == turns


def test_drawing_follows_the_cursor(open_page: Open) -> None:
    """A map draws another picture at another turn, and says in words where everybody is."""
    packed = parallel_episode(turns=20)
    packed["drawing"] = map_of(packed)
    page = opened(open_page, packed, address="#play:a/0/0")
    picture = "document.querySelector('.drawing-map').toDataURL()"
    before = page.evaluate(picture)
    page.locator(".scrub").focus()
    page.keyboard.press("Shift+ArrowRight")
    assert turn_of(page) == 10
    assert page.evaluate(picture) != before
    words = page.locator(".drawing-map").get_attribute("aria-label")
    assert words.startswith("Map at turn 10: picker_0 at 0, 2")


def test_cells_show_the_array_of_the_turn(open_page: Open) -> None:
    """The darkest and the lightest cell are the lowest and the highest number of that turn."""
    packed = aec_episode()
    values = base64.b64encode(bytes([0, 255, 0, 0, 0, 0, 0, 255])).decode()
    part = {"name": "state", "shape": [2, 2], "low": 0.0, "high": 1.0}
    packed["drawing"] = {"kind": "cells", "parts": [{**part, "turns": [0, 5], "values": values}]}
    page = opened(open_page, packed, address="#play:b/0/4", expects="willReadFrequently")
    assert page.evaluate(PIXEL, [1, 0]) == [254, 232, 56, 255]
    page.locator(".scrub").focus()
    page.keyboard.press("ArrowRight")
    assert turn_of(page) == 5
    assert page.evaluate(PIXEL, [1, 0]) == [0, 34, 78, 255]
    assert page.evaluate(PIXEL, [1, 1]) == [254, 232, 56, 255]
