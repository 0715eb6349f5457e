"""Playing on from a turn: many futures as a fan, one beside the recording, kept as evidence."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.plain_data import frozen
from gamekeeper.diagnosis.play_on import BranchPoint, FutureArm, Futures, Offered, PlayOnOptions
from gamekeeper.diagnosis.play_on_tasks import play_on_task
from gamekeeper.runs.worker_errors import error_of
from gamekeeper.viewing import interactive
from gamekeeper.viewing.viewer import Viewer
from tests.browser.test_surroundings import faults_anywhere
from tests.browser.waits import expect, turn_of
from tests.diagnosis.test_play_on import ordered, silent

pytestmark = pytest.mark.browser


def offers_here(run: Path, episode: int, options: Any) -> dict[str, Offered]:
    """As `offers`, without a process of its own."""
    known = {name: Offered(("random", "reference"), (0, 1, 2, 3), "Discrete(4)") for name in AGENTS}
    return {**known, "carrier": Offered(("random",), (), "Box(2,)")}


def futures_here(run: Path, branch: BranchPoint, *, count: int, **options: Any) -> Futures:
    """As `futures`, without a process of its own."""
    extra = {"numbers": list(range(count)), "budget": 9_999}
    answer = play_on_task(silent, kind="futures", **ordered(run, branch, **extra))
    arms = [FutureArm(**frozen(answer[arm])) for arm in ("as_recorded", "changed")]
    return Futures(branch, count, answer["steps"], *arms)


def future_here(run: Path, branch: BranchPoint, out: Path, *, number: Any, **options: Any) -> bool:
    """As `record_future`, without a process of its own."""
    answer = play_on_task(
        silent, kind="record", **ordered(run, branch, number=number, out=str(out))
    )
    if answer["error"] is not None:
        raise error_of(answer["error"])
    return bool(answer["replays"])


AGENTS = ("picker", "carrier")


@pytest.fixture
def page(chromium: Any, tmp_path: Path, monkeypatch: Any) -> Iterator[Any]:
    """An interactive view of two robots on a line, at turn 1; it must complain of nothing."""
    for name, here in (
        ("offers", offers_here),
        ("futures", futures_here),
        ("record_future", future_here),
    ):
        monkeypatch.setattr(interactive, name, here)
    gk.rollout("two_robot_line", policies="random", episodes=2, seed=1, out=tmp_path / "run")
    complaints: list[str] = []
    with Viewer([tmp_path / "run"], interactive=PlayOnOptions()) as view:
        context = chromium.new_context(viewport={"width": 1200, "height": 900}, bypass_csp=True)
        context.set_default_timeout(20_000)
        shown = context.new_page()
        shown.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
        shown.on("pageerror", lambda error: complaints.append(f"error: {error}"))
        shown.goto(view.url)
        shown.wait_for_url(f"http://127.0.0.1:{view.port}/")
        shown.goto(f"http://127.0.0.1:{view.port}/#play:a/0/1")
        shown.wait_for_selector("#gk-player[data-turn='1']")
        shown.locator(".play-on > summary").click()
        expect(shown.get_by_role("button", name="Play one")).to_be_enabled()
        yield shown
        context.close()
    assert [text for text in complaints if "422" not in text] == []


def test_futures_fan_out_and_one_is_kept(page: Any, tmp_path: Path) -> None:
    """Many: figures and a fan. One: beside the recording, and kept, where it replays."""
    panel = page.locator(".play-on")
    panel.get_by_label("What is changed").select_option("policy")
    panel.get_by_label("Agent").select_option("picker")
    panel.get_by_label("Policy").select_option("reference")
    panel.get_by_label("Number of futures").fill("6")
    panel.get_by_role("button", name="Play many").click()
    expect(panel.get_by_role("status")).to_contain_text("6 futures on fresh draws")
    expect(panel.locator("tbody th")).to_have_text(["all agents", "picker", "carrier", "failed"])
    expect(panel.get_by_role("img")).to_have_attribute(
        "aria-label", re.compile("^6 futures from turn 1")
    )
    assert faults_anywhere(page) == []
    panel.get_by_label("Which future").select_option("most")
    panel.get_by_role("button", name="Show it beside").click()
    expect(page.locator(".deck")).to_have_count(2)
    expect(panel.get_by_role("status")).to_contain_text("on fresh draws: all agents together get")
    panel.get_by_label("What is changed").select_option("action")
    panel.get_by_role("button", name="Play one").click()
    expect(panel.get_by_role("status")).to_contain_text("on the recorded draws")
    assert turn_of(page) == 1
    expect(page.locator(".parted")).to_contain_text("First difference: turn 1, picker, action")
    expect(page.get_by_role("button", name="right: change, picker, picker does")).to_be_visible()
    panel.get_by_role("button", name="Keep as evidence").click()
    expect(panel.get_by_role("status")).to_contain_text("Kept as")
    assert gk.replay(tmp_path / "run-futures" / "future-1").verified


def test_what_goes_wrong_stands_on_the_page(page: Any) -> None:
    """An action that is no JSON, and one that isn't in the space, with what would do."""
    panel = page.locator(".play-on")
    panel.get_by_label("Agent").select_option("carrier")
    for text, words in (("[0,", "no JSON"), ("[7, 7]", "can't do this at turn 1")):
        panel.get_by_label("Action, as JSON").fill(text)
        panel.get_by_role("button", name="Play one").click()
        expect(panel.get_by_role("alert")).to_contain_text(words)
        expect(panel.get_by_role("button", name="Play one")).to_be_enabled()
