"""Debian's Chromium, driven by Playwright; a page that complains or asks for anything fails."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
OWN = ("file:", "data:", "blob:")


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """The browser, started once."""
    from playwright.sync_api import sync_playwright  # not installed for the ordinary tests

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium: Any, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Opens a text as a page; afterwards it must have said nothing and asked for nothing.

    Options are those of a browser's context; `expects`: words of complaints that belong to a test.
    """
    complaints: list[str] = []
    allowed: list[str] = []
    contexts = []

    def listen(page: Any) -> None:
        page.on("console", lambda message: complaints.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
        page.on(
            "request",
            lambda asked: asked.url.startswith(OWN) or complaints.append(f"asked {asked.url}"),
        )

    def open_text(text: str, *, address: str = "", expects: str = "", **options: Any) -> Any:
        context = chromium.new_context(**{"viewport": {"width": 1200, "height": 900}, **options})
        context.set_default_timeout(10_000)
        contexts.append(context)
        page = context.new_page()
        listen(page)
        allowed.extend([expects] if expects else [])
        file = tmp_path / f"page_{len(contexts)}.html"
        file.write_text(text, encoding="utf-8")
        page.goto(file.as_uri() + address)
        return page

    yield open_text
    for context in contexts:
        context.close()
    assert [text for text in complaints if not any(word in text for word in allowed)] == []
