"""Text out of data stays text: markup, quotes, signs that turn the direction of writing."""

import copy
from typing import Any

import pytest

from tests.browser.episodes import page_of, parallel_episode
from tests.browser.waits import Open, expect, turn_of

pytestmark = pytest.mark.browser

MARKUP = "</script><img src=x onerror='window.caught=1'><script>window.caught=1</script>\"'`"
TURNED = "picker\u202efdp.exe\u2066\u200b"
NAMES = [MARKUP, TURNED, "__proto__", "constructor"]


def hostile_episode() -> Any:
    """An episode in which every text is hostile."""
    packed = copy.deepcopy(parallel_episode())
    for member, name in zip(packed["agents"], NAMES, strict=True):
        member.update(name=name, role=MARKUP)
    packed["values"] = [0, MARKUP, TURNED, {"__proto__": MARKUP}, [MARKUP], MARKUP, {MARKUP: 1}]
    packed["endings"] = {NAMES[0]: {"turn": 60, "how": "terminated", "reason": MARKUP}}
    packed["rows"]["terms"] = {MARKUP: packed["rows"]["reward"]}
    packed["rows"]["nonconforming"] = [5] * len(packed["rows"]["turn"])
    kinds = ["label", "failure", MARKUP]
    packed["marks"] = [{"turn": 9, "kind": k, "agent": MARKUP, "text": MARKUP} for k in kinds]
    packed["drawing_note"] = MARKUP
    return {**packed, "error": f"Traceback\n  {MARKUP}", "change": MARKUP, "end": MARKUP}


def chart(kind: str) -> Any:
    """A chart whose words are hostile."""
    line = {"name": MARKUP, "values": [1.0, 2.0]}
    forest = {"name": TURNED, "group": MARKUP, "value": 1.0, "low": 0.0, "high": 2.0}
    shape = {
        "line": {"x": {"label": MARKUP, "values": [0, 1]}, "y": {"label": MARKUP}},
        "bars": {"x": {"label": MARKUP, "names": [MARKUP, TURNED]}, "y": {"label": MARKUP}},
        "forest": {"x": {"label": MARKUP}, "rows": [{**forest, "p": 0.1, "text": MARKUP}]},
    }[kind]
    return {"id": kind, "kind": kind, "title": MARKUP, "note": MARKUP, "series": [line], **shape}


def test_hostile_text_is_shown_and_nothing_else(open_page: Open) -> None:
    """No element, no attribute and no code comes out of data, wherever the player shows it."""
    charts = [chart(kind) for kind in ("line", "bars", "forest")]
    page = open_page(page_of([hostile_episode(), parallel_episode(episode=1)], charts=charts))
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name="Beside episode 1 of run a").click()
    expect(page.locator(".deck")).to_have_count(2)
    page.locator("#charts").scroll_into_view_if_needed()
    expect(page.locator("#charts canvas").first).to_be_visible()
    assert turn_of(page) == 0
    assert page.evaluate("window.caught") is None
    assert page.locator("img, [onerror], [src]").count() == 0
    shown = page.locator("main").inner_text()
    assert shown.count("<img src=x onerror=") > 10
    names = page.locator(".turn-table").first.locator("tbody th").all_inner_texts()
    assert names[0] == MARKUP
    assert names[2:] == NAMES[2:]


def test_signs_that_turn_the_writing_are_named(open_page: Open) -> None:
    """A name that would be read backwards is shown with the code of the sign that turns it."""
    page = open_page(page_of([hostile_episode()]))
    page.wait_for_selector("#gk-player[data-turn]")
    name = page.locator(".turn-table tbody th").nth(1)
    assert name.inner_text() == "picker\\u202efdp.exe\\u2066\\u200b"
    assert name.locator("bdi").count() == 1


def test_policy_stops_code_that_is_not_the_pages_own(open_page: Open) -> None:
    """A script that got into the page all the same does not run; nor does a handler."""
    page = open_page(page_of([parallel_episode()]), expects="Content Security Policy")
    page.evaluate(
        """() => {
            const script = document.createElement('script');
            script.textContent = 'window.caught = 1';
            const button = document.createElement('button');
            button.setAttribute('onclick', 'window.caught = 2');
            document.body.append(script, button);
            button.click();
        }"""
    )
    assert page.evaluate("window.caught") is None
    with pytest.raises(Exception, match="fetch"):
        page.evaluate("fetch('data:text/plain,x')")
