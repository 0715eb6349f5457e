"""The page as a server shows it: episodes are asked for, and a recording that grows is followed."""

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from tests.browser.episodes import entry_of, page_of, parallel_episode, summed
from tests.browser.waits import expect, turn_of

pytestmark = pytest.mark.browser


class Shown:
    """What the server has: one run whose only episode is still recorded."""

    def __init__(self) -> None:
        self.episode = summed({**parallel_episode(turns=100), "end": "open", "marks": []})
        self.next: dict[str, Any] | None = None
        self.status = "open"
        self.page = page_of([self.episode], is_view=True)
        self.asked: list[str] = []

    def answer(self, path: str) -> tuple[int, str, Any]:
        """Status, kind and text for a path."""
        self.asked.append(path)
        if path == "/":
            return 200, "text/html; charset=utf-8", self.page
        every = [self.episode, *filter(None, [self.next])]
        if path in ("/episode/a/0", "/episode/a/1")[: len(every)]:
            return 200, "application/json", json.dumps(every[int(path[-1])])
        if path.startswith("/index.json?since="):
            run = {"key": "a", "name": "runs/a", "status": self.status, "episodes": len(every)}
            news = {"version": "1", "runs": [run], "episodes": [*map(entry_of, every)]}
            return 200, "application/json", json.dumps(news)
        error = {"what": "no such <b>episode</b>", "where": path, "fix": "ask for another"}
        return 404, "application/json", json.dumps({"error": error})


@pytest.fixture
def shown(chromium: Any) -> Iterator[tuple[Shown, Any]]:
    """A server of the page, and a browser's page on it."""
    things = Shown()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            status, kind, text = things.answer(self.path)
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, *given: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    context = chromium.new_context(viewport={"width": 1200, "height": 900})
    page = context.new_page()
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    yield things, page
    context.close()
    server.shutdown()
    server.server_close()


def grow(things: Shown, turns: int, end: str, *, status: str | None = None) -> None:
    """The recording goes on."""
    things.episode = summed({**parallel_episode(turns=turns), "end": end, "marks": []})
    things.status = status or ("open" if end == "open" else "finalized")


def test_served_page_asks_for_its_episode(shown: tuple[Shown, Any]) -> None:
    """The episode is fetched, not held in the page, and opens where its recording is."""
    things, page = shown
    page.wait_for_selector("#gk-player[data-turn]")
    assert turn_of(page) == 100
    assert "/episode/a/0" in things.asked
    expect(page.locator(".deck-facts")).to_contain_text("still recorded")
    assert page.locator(".episode-list tbody tr").count() == 1


def test_served_page_plays_what_is_chosen_in_sight(shown: tuple[Shown, Any]) -> None:
    """The list is one line above the player; a thumbnail in it brings the player into sight."""
    things, page = shown
    things.next = summed({**parallel_episode(turns=30, episode=1), "marks": []})
    page.reload()
    page.wait_for_selector("#gk-player[data-turn]")
    assert page.locator(".deck-world").bounding_box()["y"] < 600
    page.set_viewport_size({"width": 1200, "height": 500})
    page.locator(".episode-list > summary").click()
    page.get_by_role("button", name="Play: Episode 1").click()
    expect(page.locator(".deck-top h3")).to_contain_text("Episode 1")
    assert 0 <= page.locator(".jumps").bounding_box()["y"] < 100


def test_served_page_follows_a_recording(shown: tuple[Shown, Any]) -> None:
    """The cursor goes to the end of what grew, until the reader goes back or asks for it again."""
    things, page = shown
    page.wait_for_selector("#gk-player[data-turn]")
    grow(things, 150, "open")
    expect(page.locator(".where input")).to_have_value("150", timeout=20_000)
    page.locator(".scrub").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_label("follow the recording")).not_to_be_checked()
    page.get_by_role("button", name="Show fewer turns").click()
    grow(things, 200, "open")
    expect(page.locator(".until")).to_have_text(" / 200", timeout=20_000)
    expect(page.locator(".where input")).to_have_value("149")
    assert page.evaluate("gamekeeper.player.decks[0].lanes.zoom") == 2
    page.get_by_label("follow the recording").check()
    grow(things, 300, "ended")
    expect(page.locator(".where input")).to_have_value("300", timeout=20_000)
    expect(page.locator(".following")).to_be_hidden()


def test_served_page_follows_into_the_next_episode(shown: tuple[Shown, Any]) -> None:
    """Where an episode ends that was followed, the one recorded after it is on show."""
    things, page = shown
    page.wait_for_selector("#gk-player[data-turn]")
    things.next = summed({**parallel_episode(turns=30, episode=1), "end": "open", "marks": []})
    grow(things, 150, "ended", status="open")
    expect(page.locator(".deck-top h3")).to_contain_text("Episode 1", timeout=20_000)
    assert turn_of(page) == 30


def test_served_page_tells_what_the_server_complains_of(shown: tuple[Shown, Any]) -> None:
    """An episode that cannot be had is told in the server's words, as text."""
    _, page = shown
    page.wait_for_selector("#gk-player[data-turn]")
    page.evaluate("gamekeeper.player.open([{run: 'a', episode: 7}])")
    trouble = page.get_by_role("alert")
    expect(trouble).to_contain_text("no such <b>episode</b>; /episode/a/7; ask for another")
