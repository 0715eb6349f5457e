"""Two episodes beside each other: one cursor, and the place where they part."""

import copy
from typing import Any

import pytest

from tests.browser.episodes import map_of, page_of, parallel_episode
from tests.browser.waits import Open, expect, turn_of

pytestmark = pytest.mark.browser

HEX = "(r, g, b) => '#' + [r, g, b].map((part) => part.toString(16).padStart(2, '0')).join('')"
COLOURS_IN = f"""(selector) => [...document.querySelectorAll(selector)].map((canvas) => {{
    const ink = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    const found = new Set();
    for (let i = 0; i < ink.length; i += 4) found.add(({HEX})(...ink.slice(i, i + 3)));
    return [...found];
}})"""
LANE_COLOURS = f"""() => [...document.querySelectorAll('.lane-name i')].map((sign) =>
    ({HEX})(...getComputedStyle(sign).backgroundColor.match(/\\d+/g).map(Number)))"""


def base_and_counterfactual(turn: int = 33) -> tuple[Any, Any]:
    """An episode, and the same with one action replaced."""
    base = parallel_episode()
    counterfactual = copy.deepcopy(base)
    row = 4 * turn + 1
    counterfactual["rows"]["action"][row] = (base["rows"]["action"][row] + 1) % 5
    return base, {
        **counterfactual,
        "run": "a.counterfactual",
        "base": {"run": "a", "episode": 0},
        "change": "replace",
    }


def paired(
    open_page: Open, base: Any, counterfactual: Any, found: Any = None, **options: Any
) -> Any:
    """Both on show; `found`: their first difference as the page has it."""
    left = {"run": base["run"], "episode": base["episode"]}
    right = {"run": counterfactual["run"], "episode": counterfactual["episode"]}
    pair = {"left": left, "right": right, "text": "base and counterfactual", "divergence": found}
    page = open_page(page_of([base, counterfactual], pairs=[pair]), **options)
    page.wait_for_selector("#gk-player[data-turn]")
    page.get_by_label("Compare two episodes").select_option("base and counterfactual")
    expect(page.locator(".deck")).to_have_count(2)
    return page


def put_beside(page: Any, which: str) -> None:
    """A reader puts an episode beside the first one."""
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name=f"Beside {which}").click()
    expect(page.locator(".deck")).to_have_count(2)


def beside(open_page: Open, base: Any, counterfactual: Any) -> Any:
    """Both on show, put there by a reader: the page has not compared them."""
    page = open_page(page_of([base, counterfactual]))
    put_beside(page, "episode 0 of run a.counterfactual")
    return page


def test_pair_has_one_first_difference(open_page: Open) -> None:
    """What was compared when the page was made is told, is marked, and is where it begins.

    Not what the page holds of it: observations differ before actions do.
    """
    base, counterfactual = base_and_counterfactual()
    third = {"turn": 50, "kind": "divergence", "agent": None, "text": "from a third"}
    found = {"turn": 32, "agent": "carrier_0", "field": "obs", "values": ["0.1", "0.2"]}
    counterfactual["rows"]["reward"][4 * 40 + 1] = 5.0
    page = paired(open_page, {**base, "marks": [third]}, counterfactual, found)
    assert turn_of(page) == 32
    told = page.locator(".parted").inner_text()
    assert told == "First difference: turn 32, carrier_0, obs 0.1 against 0.2."
    gap = 5 - (base["rows"]["reward"][4 * 40 + 1] or 0)
    said = f"right less left: {gap:g} at the end; widest at turn 40, {gap:g}."
    expect(page.locator(".scrub-curve .note")).to_contain_text(said)
    assert page.locator(".jump-divergence").all_inner_texts() == [
        "◆ turn 32: first difference, carrier_0, obs differs"
    ]


def test_episodes_beside_each_other_begin_where_they_part(open_page: Open) -> None:
    """Of two that a reader put there the turn is found by checksums, the field by what is shown."""
    base, counterfactual = base_and_counterfactual()
    actions = [packed["rows"]["action"][4 * 33 + 1] for packed in (base, counterfactual)]
    page = beside(open_page, base, counterfactual)
    assert turn_of(page) == 33
    told = page.locator(".parted").inner_text()
    assert (
        told == f"First difference: turn 33, carrier_0, action {actions[0]} against {actions[1]}."
    )
    assert page.get_by_role("button", name="turn 33: first difference, carrier_0").count() == 1
    assert page.locator("td.differs").count() == 2
    assert (
        page.locator("article").nth(1).inner_text().count("A counterfactual of runs/a, episode 0")
        == 1
    )


def test_difference_that_a_page_does_not_hold_is_told(open_page: Open) -> None:
    """Where only an observation differs its turn is the first difference all the same."""
    base, counterfactual = base_and_counterfactual()
    base["rows"]["observed"] = [0] * len(base["rows"]["turn"])
    counterfactual["rows"]["observed"] = [
        int(turn == 20) for turn in counterfactual["rows"]["turn"]
    ]
    page = beside(open_page, base, counterfactual)
    assert turn_of(page) == 20
    assert "turn 20, in an observation" in page.locator(".parted").inner_text()


def test_comparison_has_an_address(open_page: Open) -> None:
    """The address of two episodes at a turn opens both, at that turn."""
    base, counterfactual = base_and_counterfactual()
    page = beside(open_page, base, counterfactual)
    page.locator(".scrub").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_url("**/*#play:a/0/34+a.counterfactual/0")
    page.reload()
    expect(page.locator(".deck h3")).to_have_text(
        ["Episode 0 · runs/a", "Episode 0 · runs/a.counterfactual"]
    )
    assert turn_of(page) == 34


def test_agent_has_one_colour_everywhere(open_page: Open) -> None:
    """In both maps, in the lanes and in the legend, whoever else is in the episode."""
    whole = parallel_episode()
    late = parallel_episode(agents=2, episode=1)  # those who stand last among the four
    late["agents"] = whole["agents"][2:]
    names = [member["name"] for member in whole["agents"]]
    episodes = [{**packed, "drawing": map_of(packed)} for packed in (whole, late)]
    chart = {
        "id": "returns",
        "kind": "line",
        "title": "Returns",
        "y": {"label": "return"},
        "x": {"label": "episode", "values": [0, 1]},
        "series": [{"name": name, "values": [0, 1]} for name in reversed(names)],
    }
    agents = tuple((member["name"], member["role"]) for member in whole["agents"])
    page = open_page(page_of(episodes, charts=[chart], agents=agents))
    put_beside(page, "episode 1 of run a")
    colours = page.evaluate("gamekeeper.colours().series.slice(0, 4)")
    drawn = page.evaluate(COLOURS_IN, ".drawing-map")
    assert [[colour in canvas for colour in colours] for canvas in drawn] == [
        [True] * 4,
        [False, False, True, True],
    ]
    assert page.evaluate(LANE_COLOURS) == [*colours, *colours[2:]]
    page.locator("#charts").scroll_into_view_if_needed()
    expect(page.locator(".chart-legend label")).to_have_count(4)
    legend = page.evaluate(COLOURS_IN, ".swatch")
    assert [next(c for c in colours if c in canvas) for canvas in legend] == colours[::-1]


def test_pair_has_one_cursor(open_page: Open) -> None:
    """Stepping moves both; what is the same there is not marked."""
    page = beside(open_page, *base_and_counterfactual())
    page.locator(".scrub").focus()
    page.keyboard.press("ArrowRight")
    assert turn_of(page) == 34
    captions = page.locator(".turn-table caption").all_inner_texts()
    assert captions == ["Turn 34 of 60: 4 agents acted"] * 2
    assert page.locator("td.differs").count() == 0


def test_pair_has_one_scale(open_page: Open) -> None:
    """A turn stands at the same place in both lanes, whatever the lengths and the zoom."""
    page = paired(open_page, parallel_episode(turns=60), parallel_episode(turns=20, episode=1))
    assert turn_of(page) == 0
    page.locator(".scrub").focus()
    page.keyboard.press("Shift+ArrowRight")
    for _ in range(2):
        assert turn_of(page) == 10
        places = page.evaluate(
            "[...document.querySelectorAll('.lanes-cursor')].map((line) => line.style.transform)"
        )
        assert places[0] == places[1]
        page.get_by_role("button", name="Show fewer turns").first.click()


def test_pair_without_difference_says_so(open_page: Open) -> None:
    """Equal episodes have no divergence, and the page says what was compared."""
    base, _ = base_and_counterfactual()
    page = paired(open_page, base, {**base, "episode": 1})
    assert page.locator(".parted").inner_text().startswith("No difference")
    expect(page.locator(".scrub-curve .note")).to_contain_text("right less left: 0 at the end")
    assert page.locator(".jump-divergence").count() == 0


def test_shorter_one_stays_at_its_end(open_page: Open) -> None:
    """Beyond its end an episode says that it is over, while the other goes on."""
    short = parallel_episode(turns=20, episode=1)
    page = paired(open_page, parallel_episode(turns=60), short)
    page.locator(".scrub").focus()
    page.keyboard.press("End")
    assert turn_of(page) == 60
    captions = page.locator(".turn-table caption").all_inner_texts()
    assert captions[1] == "This episode has no turn 60: its last is 20."
    assert page.locator(".deck.over").count() == 1


def test_button_puts_an_episode_beside(open_page: Open) -> None:
    """Any two episodes of the list stand beside each other; opening one leaves it alone."""
    page = open_page(page_of([parallel_episode(), parallel_episode(episode=1, seed=1)]))
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name="Beside episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(2)
    page.get_by_role("button", name="Play episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(1)
