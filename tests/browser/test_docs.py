"""Pages of the documentation as `make docs` has built them, in a browser."""

from typing import Any

import pytest

from tests.browser.test_surroundings import faults_anywhere
from tests.surface.sources import ROOT

pytestmark = pytest.mark.docs
BUILT = ROOT / "build" / "docs"


@pytest.mark.parametrize("name", ["index", "report", "tutorials/start"])
def test_built_page_is_accessible(chromium: Any, name: str) -> None:
    """axe-core finds nothing on three widths, in the light and in the dark; nothing is too wide."""
    context = chromium.new_context(bypass_csp=True)
    page = context.new_page()
    page.goto((BUILT / f"{name}.html").as_uri())
    found = faults_anywhere(page)
    page.set_viewport_size({"width": 390, "height": 900})
    wide = page.evaluate("document.documentElement.scrollWidth")
    context.close()
    assert (found, wide) == ([], 390)


@pytest.mark.parametrize(
    ("words", "first"),
    [
        ("custom environment", "own-environment.html"),
        ("vector environment", "vector.html"),
        ("wrapper", "wrappers.html"),
    ],
)
def test_search_finds_the_page_of_its_subject(chromium: Any, words: str, first: str) -> None:
    """The built pages' own search has the page that a reader looks for first."""
    page = chromium.new_page()
    page.goto(f"{(BUILT / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
    found = page.locator("#search-results ul.search > li > a").first
    found.wait_for()
    page.wait_for_function("/finished/.test(document.querySelector('#search-results').innerText)")
    address = found.get_attribute("href")
    page.close()
    assert address == first
