"""`gamekeeper view` in a browser: the token goes, a recording is followed until it is finalized."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.runs.recording import record
from gamekeeper.viewing.viewer import Viewer
from tests.browser.waits import expect
from tests.viewing.view.growing import Walk

pytestmark = pytest.mark.browser


@pytest.fixture
def env(tmp_path: Path) -> Iterator[Any]:
    """A walk without an end, recorded into `run`; twenty turns of it are played."""
    found = record(Walk(), tmp_path / "run")
    found.reset(seed=0)
    walk(found, 20)
    yield found
    found.close()


def walk(env: Any, turns: int) -> None:
    """Plays so many turns."""
    for _ in range(turns):
        env.step(dict.fromkeys(env.agents, 1))


def test_view_follows_a_recording_to_its_end(chromium: Any, env: Any, tmp_path: Path) -> None:
    """The list and the player go on as rows come; the address holds no token; nothing complains."""
    complaints: list[str] = []
    with Viewer([tmp_path / "run"]) as view:
        context = chromium.new_context(viewport={"width": 1200, "height": 900})
        page = context.new_page()
        page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
        page.on("response", lambda reply: reply.status < 400 or complaints.append(reply.url))
        page.goto(view.url)
        page.wait_for_url(f"http://127.0.0.1:{view.port}/")
        cookie = context.cookies()[0]
        assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
        expect(page.locator("#player")).to_contain_text("still recorded")
        walk(env, 30)
        expect(page.locator("#player")).to_contain_text("50 steps", timeout=30_000)
        env.close()
        expect(page.locator("#player")).not_to_contain_text("still recorded", timeout=30_000)
        page.get_by_role("link", name="Whole report").click()
        expect(page.locator("#agents")).to_contain_text("walker_1")
        context.close()
    assert complaints == []


def test_page_of_another_server_gets_nothing(chromium: Any, env: Any, tmp_path: Path) -> None:
    """Though the browser holds the cookie: neither a script nor an image nor a frame of its."""

    class Foreign(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>foreign</title>")

        def log_message(self, *given: Any) -> None:
            pass

    with (
        Viewer([tmp_path / "run"]) as view,
        ThreadingHTTPServer(("127.0.0.1", 0), Foreign) as other,
    ):
        threading.Thread(target=other.serve_forever, daemon=True).start()
        statuses: list[int] = []
        context = chromium.new_context()
        context.new_page().goto(view.url)
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{other.server_port}/")
        page.on("response", lambda reply: statuses.append(reply.status))
        asked = f"http://127.0.0.1:{view.port}/index.json"
        for mode in ("cors", "no-cors"):
            options = {"mode": mode, "credentials": "include"}
            script = "([url, options]) => fetch(url, options).then(r => r.text(), () => '')"
            assert page.evaluate(script, [asked, options]) == ""
        assert set(statuses) <= {403}
        context.close()
        other.shutdown()
