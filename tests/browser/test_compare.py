"""Two episodes beside each other: one cursor, and the place where they part."""

import copy
from typing import Any

import pytest

from tests.browser.episodes import page_of, parallel_episode
from tests.browser.waits import Open, expect, turn_of

pytestmark = pytest.mark.browser


def base_and_twin(turn: int = 33) -> tuple[Any, Any]:
    """An episode, and the same with one action replaced."""
    base = parallel_episode()
    twin = copy.deepcopy(base)
    row = 4 * turn + 1
    twin["rows"]["action"][row] = (base["rows"]["action"][row] + 1) % 5
    return base, {**twin, "run": "a.twin", "base": {"run": "a", "episode": 0}, "change": "replace"}


def paired(open_page: Open, base: Any, twin: Any, **options: Any) -> Any:
    """Both on show."""
    left = {"run": base["run"], "episode": base["episode"]}
    right = {"run": twin["run"], "episode": twin["episode"]}
    pair = {"left": left, "right": right, "text": "base and twin", "turn": None}
    page = open_page(page_of([base, twin], pairs=[pair]), **options)
    page.wait_for_selector("#gk-player[data-turn]")
    page.get_by_label("Two episodes beside each other").select_option("base and twin")
    expect(page.locator(".deck")).to_have_count(2)
    return page


def test_pair_begins_where_it_parts(open_page: Open) -> None:
    """The first difference is told with both values, is marked, and is where the cursor begins."""
    base, twin = base_and_twin()
    actions = [packed["rows"]["action"][4 * 33 + 1] for packed in (base, twin)]
    page = paired(open_page, base, twin)
    assert turn_of(page) == 33
    told = page.locator(".parted").inner_text()
    assert (
        told == f"First difference: turn 33, carrier_0, action {actions[0]} against {actions[1]}."
    )
    assert page.get_by_role("button", name="33 divergence, carrier_0").count() == 1
    assert page.locator("td.differs").count() == 2
    assert page.locator("article").nth(1).inner_text().count("A twin of a, episode 0") == 1


def test_pair_has_one_cursor(open_page: Open) -> None:
    """Stepping moves both; what is the same there is not marked."""
    page = paired(open_page, *base_and_twin())
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
    base, _ = base_and_twin()
    page = paired(open_page, base, {**base, "episode": 1})
    assert page.locator(".parted").inner_text().startswith("No difference")
    assert page.locator(".jump-divergence").count() == 0


def test_shorter_one_stays_at_its_end(open_page: Open) -> None:
    """Beyond its end an episode says that it is over, while the other goes on."""
    short = parallel_episode(turns=20, episode=1)
    page = paired(open_page, parallel_episode(turns=60), short)
    page.locator(".scrub").focus()
    page.keyboard.press("End")
    assert turn_of(page) == 60
    captions = page.locator(".turn-table caption").all_inner_texts()
    assert captions[1] == "This episode ended at turn 20."
    assert page.locator(".deck.over").count() == 1


def test_button_puts_an_episode_beside(open_page: Open) -> None:
    """Any two episodes of the list stand beside each other; opening one leaves it alone."""
    page = open_page(page_of([parallel_episode(), parallel_episode(episode=1, seed=1)]))
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list summary").click()
    page.get_by_role("button", name="Beside episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(2)
    page.get_by_role("button", name="Play episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(1)
