"""The pages of `gamekeeper report` and `gamekeeper view`, of runs that were played."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.viewing.report_file import report
from tests.browser.test_surroundings import faults, faults_anywhere
from tests.browser.waits import Open, expect, turn_of

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Four episodes of the warehouse by its reference policy, and the same seeds at random."""
    folder = tmp_path_factory.mktemp("evidence")
    for name, policies in (("reference", "reference"), ("random", "random")):
        gk.rollout("warehouse", policies=policies, episodes=4, out=folder / name)
    return folder / "reference", folder / "random"


@pytest.fixture(scope="module")
def compared(runs: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of the first run beside the second."""
    file = report(runs[0], tmp_path_factory.mktemp("page") / "report.html", others=[runs[1]])
    return file.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def served(runs: tuple[Path, Path]) -> Iterator[str]:
    """The address of a `gamekeeper view` of the first run."""
    command = [sys.executable, "-m", "gamekeeper", "view", str(runs[0]), "--no-browser", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield json.loads(server.stdout.readline())["url"]
        server.terminate()


@pytest.mark.parametrize("width", [360, 1400])
def test_report_of_two_runs_plays_and_compares(open_page: Open, compared: str, width: int) -> None:
    """A real report is silent, fits, steps, and puts two runs beside each other where they part."""
    page = open_page(compared, viewport={"width": width, "height": 900})
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".scrub").focus()
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    assert turn_of(page) == int(page.locator(".scrub").get_attribute("max")) - 1
    page.get_by_label("Compare two episodes").select_option(index=1)
    expect(page.locator(".deck")).to_have_count(2)
    expect(page.locator(".parted")).to_contain_text("First difference: turn")
    assert page.evaluate("document.documentElement.scrollWidth") == width


def test_report_is_accessible(open_page: Open, compared: str) -> None:
    """axe-core finds nothing in a whole report of two runs, what is folded unfolded."""
    page = open_page(compared, bypass_csp=True)
    page.wait_for_selector("#gk-player[data-turn]")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert faults_anywhere(page) == []


def test_first_screen_answers_and_leads_to_the_turn(
    open_page: Open, runs: tuple[Path, Path], tmp_path: Path
) -> None:
    """Answers come first, then the player, both on the first screen; a link opens its turn."""
    file = report(runs[1], tmp_path / "report.html")
    page = open_page(file.read_text(encoding="utf-8"), viewport={"width": 1440, "height": 900})
    page.wait_for_selector("#gk-player[data-turn]")
    assert page.locator("#player").bounding_box()["y"] < 600
    link = page.locator(".answers div", has_text="Outcome").get_by_role("link")
    place = re.fullmatch(r"#play:a/(\d+)/(\d+)", link.get_attribute("href"))
    assert place is not None
    link.click()
    expect(page.locator(".deck h3")).to_contain_text(f"Episode {place[1]}")
    assert turn_of(page) == int(place[2])


def test_notebook_holds_a_player(open_page: Open, runs: tuple[Path, Path]) -> None:
    """The frame of `gk.player` plays one episode by itself, and asks for nothing."""
    shown = gk.player(gk.load(runs[0]), 2)
    assert "root digest" in shown.caption
    page = open_page(f"<!doctype html><html lang=en><title>n</title>{shown._repr_html_()}")
    frame = page.frame_locator("iframe")
    expect(frame.locator(".deck h3")).to_contain_text("Episode 2")
    frame.locator(".scrub").focus()
    page.keyboard.press("End")
    last = frame.locator(".scrub").get_attribute("max")
    expect(frame.locator(".where input")).to_have_value(str(last))
    page.wait_for_timeout(700)  # until the cursor has come to rest


def test_report_of_turns_is_accessible(open_page: Open, tmp_path: Path) -> None:
    """Nor in one of a game in turns, where an observation is drawn that nobody was given yet."""
    gk.rollout("handover", episodes=1, out=tmp_path / "run", env_kwargs={"reach": 3})
    file = report(tmp_path / "run", tmp_path / "report.html")
    page = open_page(file.read_text(encoding="utf-8"), address="#play:a/0/0", bypass_csp=True)
    page.wait_for_selector("#gk-player[data-turn]")
    expect(page.locator(".cells-part canvas").nth(2)).to_have_attribute(
        "aria-label", re.compile("nothing yet")
    )
    assert faults(page) == []


def test_report_fits_on_paper(open_page: Open, compared: str) -> None:
    """On a sheet's width no table is cut off, though all that was folded is open."""
    page = open_page(compared, viewport={"width": 760, "height": 1100})
    page.wait_for_selector("#gk-player[data-turn]")
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert turn_of(page) == 0
    assert page.locator("details:not([open])").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth") == 760


def test_view_is_accessible(chromium: Any, served: str) -> None:
    """axe-core finds nothing in either served page."""
    context = chromium.new_context(viewport={"width": 1200, "height": 900}, bypass_csp=True)
    page = context.new_page()
    page.goto(served)
    address, found = page.url.split("#")[0], []
    for path in ("", "report"):
        page.goto(address + path)
        page.wait_for_selector("#gk-player[data-turn]")
        found += faults_anywhere(page)
    context.close()
    assert found == []


def test_view_opens_any_episode(chromium: Any, served: str) -> None:
    """The served page asks for the episode that is opened, under its token, without complaint."""
    context = chromium.new_context(viewport={"width": 1200, "height": 900})
    page = context.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(served)
    page.wait_for_selector("#gk-player[data-turn]")
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name="Play episode 3 of run a").click()
    expect(page.locator(".deck h3")).to_contain_text("Episode 3")
    assert "token" not in page.url
    context.close()
    assert complaints == []
