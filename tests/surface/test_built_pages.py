"""The pages as `make docs` has built them: what the Python interface's page shows and indexes."""

import json
import re
from types import ModuleType

import pytest
from sphinx.util.inventory import InventoryFile

import gamekeeper
from tests.surface.sources import ROOT

pytestmark = pytest.mark.docs
BUILT = ROOT / "build" / "docs"


@pytest.fixture(scope="module")
def page() -> str:
    """The page of the Python interface, as a browser gets it."""
    return (BUILT / "reference" / "api.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def indexed() -> set[str]:
    """Every Python name in the inventory that other projects' pages link through."""
    entries = InventoryFile.loads((BUILT / "objects.inv").read_bytes(), uri="").data
    return {name for kind in entries if kind.startswith("py:") for name in entries[kind]}


@pytest.mark.parametrize("name", gamekeeper.__all__)
def test_a_public_name_has_a_signature_and_an_entry(
    page: str, indexed: set[str], name: str
) -> None:
    """Each public name can be linked to; a function or class shows its signature, a module none."""
    assert f"gamekeeper.{name}" in indexed
    module = type(getattr(gamekeeper, name)) is ModuleType
    heading = rf'<dt class="sig sig-object py" id="gamekeeper\.{name}">'
    assert module or re.search(heading, page)


def test_every_directive_became_a_node(indexed: set[str]) -> None:
    """Each name that the page's source documents stands in the inventory."""
    source = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    asked = set(re.findall(r"^\.\. (?:auto\w+|py:module):: (\S+)$", source, flags=re.M))
    assert asked
    assert asked <= indexed


def test_a_public_name_shows_its_own_words(page: str) -> None:
    """Each docstring's first words stand under its signature."""
    text = re.sub(r"<[^>]+>", "", page)
    for name in ("record", "audit", "Evidence", "TurnEnv"):
        first = " ".join((getattr(gamekeeper, name).__doc__ or "").split()[:3])
        assert first
        assert first in text, name


def test_no_directive_is_left_as_text(page: str) -> None:
    """Nothing of the markup that documents names is shown to the reader."""
    assert "py:function" not in page
    assert ":module: gamekeeper" not in page


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("custom environment", "own-environment"),
        ("vector environment", "vector"),
        ("wrapper", "wrappers"),
    ],
)
def test_search_finds_by_title(words: str, found: str) -> None:
    """A page about what was searched for comes first: its title has the words, and half as many.

    Source: `performSearch` in Sphinx's searchtools.js, the score of a title.
    """
    text = (BUILT / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    pages = [
        index["docnames"][page]
        for title, places in index["alltitles"].items()
        if words in title.lower() and 2 * len(words) >= len(title)
        for page, _ in places
    ]
    assert found in pages
    assert "score + 100" in (BUILT / "_static" / "language_data.js").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["index", "learn", "report", "plots", "how-to/view"])
def test_pictures_are_dark_on_a_dark_page(name: str) -> None:
    """Each picture of a page or a plot that is shown in the light has one for the dark."""
    text = (BUILT / f"{name}.html").read_text(encoding="utf-8")
    found = {
        scheme: re.findall(rf'<img[^>]*class="only-{scheme}"[^>]*/([\w-]+)-{scheme}\.png"', text)
        for scheme in ("light", "dark")
    }
    assert found["light"]
    assert found["light"] == found["dark"]
    assert len(re.findall(r"/[\w-]+\.png", text)) == 2 * len(found["light"])
