"""Waiting for what a page shows; under its policy nothing else may wait than these."""

import re
from collections.abc import Callable
from typing import Any

Open = Callable[..., Any]


def expect(located: Any) -> Any:
    """Playwright's assertions, which wait; nothing else may, under the page's policy."""
    from playwright.sync_api import expect as assertions  # not there for the ordinary tests

    return assertions(located)


def expect_turn(page: Any, pattern: str) -> None:
    """Waits until the turn on show matches."""
    expect(page.locator("#gk-player")).to_have_attribute("data-turn", re.compile(f"^({pattern})$"))


def turn_of(page: Any) -> int:
    """The turn on show, once the next frame is drawn."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    return int(page.locator("#gk-player").get_attribute("data-turn"))
