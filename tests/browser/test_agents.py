"""An agent is chosen everywhere; a scene is drawn; ghosts; the slider above the lanes."""

import itertools
from typing import Any

import pytest

from tests.browser.episodes import aec_episode, map_of, page_of, parallel_episode
from tests.browser.waits import Open, expect, turn_of

pytestmark = pytest.mark.browser

MIDDLES = """() => {
    const middle = (box) => box.left + box.width / 2;
    const slider = document.querySelector('.scrub');
    const box = slider.getBoundingClientRect();
    const thumb = box.left + 8 + (slider.value / slider.max) * (box.width - 16);
    return [thumb, middle(document.querySelector('.lanes-cursor').getBoundingClientRect())];
}"""
PICTURE = "document.querySelector('.drawing-map').toDataURL()"


def opened(open_page: Open, *episodes: Any, address: str = "", **options: Any) -> Any:
    """A page whose first episode is on show."""
    page = open_page(page_of(episodes), address=address, **options)
    page.wait_for_selector("#gk-player[data-turn]")
    return page


def with_scene() -> Any:
    """An episode of two agents on a grid of three by two cells, of which one is a wall."""
    packed = aec_episode()
    floor = {"columns": 3, "rows": 2, "values": {"1": "wall", "2": "dock"}}
    cells = {**floor, "base": [1, 0, 0, 0, 0, 0], "changes": [[5, 5, 2]]}
    scene = {"grid": True, "down": True, "size": [3, 2], "things": [], "links": []}
    names = [member["name"] for member in packed["agents"]]
    tracks = {name: [[0, k, 1], [4, k, 0]] for k, name in enumerate(names, start=1)}
    packed["drawing"] = {
        "kind": "map",
        "extent": [0, 2, 0, 1],
        "tracks": tracks,
        "scene": {**scene, "carries": {names[0]: [[0, 0], [6, 1]]}, "cells": [cells]},
    }
    for member in packed["agents"]:
        member["actions"] = ["stay", "north", "south"]
    return packed


def test_chosen_agent_stands_out_everywhere(open_page: Open) -> None:
    """A press on its lane chooses it, in the table and in the address too; another releases it."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/7")
    lane = page.get_by_role("button", name="picker_1")
    lane.click()
    expect(lane).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".turn-table tr.chosen th")).to_have_text("picker_1")
    page.wait_for_url("**#play:a/0/7@picker_1")
    page.get_by_label("only picker_1").check()
    expect(page.locator(".lane-name:not([hidden])")).to_have_count(1)
    page.wait_for_url("**#play:a/0/7@picker_1!")
    lane.click()
    expect(page.locator(".lane-name:not([hidden])")).to_have_count(4)
    lane.click()
    expect(lane).to_have_attribute("aria-pressed", "false")


def test_address_opens_an_agent_alone(open_page: Open) -> None:
    """A link leads to the turn, with the agent alone in lanes and table."""
    page = opened(open_page, parallel_episode(), address="#play:a/0/7@carrier_1!")
    assert turn_of(page) == 7
    expect(page.locator(".lane-name:not([hidden]) bdi")).to_have_text(["carrier_1"])
    expect(page.locator(".turn-table tbody tr:not([hidden]) th")).to_have_text(["carrier_1"])


def test_slider_stands_above_the_cursor_of_the_lanes(open_page: Open) -> None:
    """Its thumb is where the lanes' cursor is, on a phone too."""
    for width in (1300, 390):
        size = {"width": width, "height": 800}
        page = opened(open_page, parallel_episode(), address="#play:a/0/45", viewport=size)
        thumb, cursor = page.evaluate(MIDDLES)
        assert thumb == pytest.approx(cursor, abs=1.5)


def test_scene_is_drawn_turn_by_turn(open_page: Open) -> None:
    """Cells, bodies and what is carried change with the turn; the legend has the words."""
    packed = with_scene()
    packed["rows"]["action"] = [None] * len(packed["rows"]["turn"])  # they stand on the map, too
    page = opened(open_page, packed, address="#play:b/0/1")
    expect(page.locator(".legend")).to_contain_text("filled: wall · D: dock · square on an agent")
    pictures = [page.evaluate(PICTURE)]
    page.locator(".scrub").focus()
    for turn in range(2, 7):
        page.keyboard.press("ArrowRight")
        assert turn_of(page) == turn
        pictures.append(page.evaluate(PICTURE))
    is_other = [one != two for one, two in itertools.pairwise(pictures)]
    assert is_other == [False, False, True, True, True]


def test_actions_have_their_names(open_page: Open) -> None:
    """A declared name stands under the agent's name, in the table before its number."""
    page = opened(open_page, with_scene(), address="#play:b/0/2")
    expect(page.locator(".lane-name small").first).to_have_text("south")
    expect(page.locator(".turn-table tbody td").first).to_have_text("south (2)")


def test_other_episode_is_a_ghost_on_the_map(open_page: Open) -> None:
    """Of two episodes each map shows the other's agents as outlines, where they are elsewhere."""
    one, two = parallel_episode(turns=20), parallel_episode(turns=20, episode=1)
    one["drawing"] = map_of(one)
    two["drawing"] = map_of(two)
    track = two["drawing"]["tracks"]["picker_0"]
    two["drawing"]["tracks"]["picker_0"] = [[turn, 9 - x, y] for turn, x, y in track]
    page = opened(open_page, one, two, address="#play:a/0/3+a/1")
    ghost = page.evaluate(PICTURE)
    page.evaluate("gamekeeper.player.decks[0].drawing.ghost = null")
    page.evaluate("gamekeeper.player.decks[0].drawing.show(3)")
    assert ghost != page.evaluate(PICTURE)


def test_names_on_the_map_cover_neither_signs_nor_one_another(open_page: Open) -> None:
    """A name goes to a side that is free; without one it is left out."""
    page = opened(open_page, with_scene())
    close = [{"text": f"agent_{k}", "x": 50 + 12 * k, "y": 50, "wide": 40} for k in range(5)]
    named = page.evaluate(
        "labels => gamekeeper.placeNames(labels, { size: 5, width: 160, height: 100 })", close
    )
    signs = [
        {"left": each["x"] - 5, "right": each["x"] + 5, "top": 45, "bottom": 55} for each in close
    ]
    assert 2 <= len(named) < 5
    for one, other in itertools.combinations([*named, *signs], 2):
        apart = one["right"] <= other["left"] or other["right"] <= one["left"]
        assert apart or one["bottom"] <= other["top"] or other["bottom"] <= one["top"]


def test_signs_are_explained_beside_the_lanes(open_page: Open) -> None:
    """On a phone the bar stays low; signs, colours and roles that are there stand in a legend."""
    page = opened(open_page, parallel_episode(), viewport={"width": 390, "height": 844})
    assert page.evaluate("document.querySelector('.controls').offsetHeight") <= 150
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    legend = page.locator(".lanes-legend")
    expect(legend).to_be_visible()
    expect(legend).to_contain_text("label of a failure")
    expect(legend).to_contain_text("circle: picker")
    expect(legend).not_to_contain_text("error, or the recorder was killed")
    page.evaluate("document.querySelector('.lanes').scrollIntoView({ behavior: 'instant' })")
    top, bar = page.evaluate(
        "[document.querySelector('.lanes').getBoundingClientRect().top, "
        "document.querySelector('.controls').getBoundingClientRect().top]"
    )
    assert 0 <= top < bar
