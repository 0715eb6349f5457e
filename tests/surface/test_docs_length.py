"""The docs that are written by hand stay short enough to be read."""

import re

from tests.surface.sources import ROOT

MOST_WORDS = 58_500
"""Lowered with what is cut."""
PRINTED = re.compile(
    r"<!-- (written by|printed by)|^Tables that scripts print|^What scripts print|^Made by `python",
    re.M,
)
"""Start of a page that a script writes or prints."""
APART = re.compile(r"^```.*?^```$|<!-- bars: written.*?<!-- bars: end -->|<!--.*?-->", re.M | re.S)
"""Code, which tests run, the table of bars, which a script writes, and comments."""


def words_by_hand() -> dict[str, int]:
    """Number of words of each page; findings and the zoo not counted."""
    found = {}
    for page in sorted((ROOT / "docs").rglob("*.md")):
        name = str(page.relative_to(ROOT / "docs"))
        text = page.read_text(encoding="utf-8")
        is_apart = name.startswith(("findings/", "checks/", "zoo"))
        if not is_apart and not PRINTED.search(text[:1_000]):
            found[name] = len(APART.sub("", text).split())
    return found


def test_docs_are_short_enough() -> None:
    """Whatever is added takes the place of something."""
    words = words_by_hand()
    assert sum(words.values()) <= MOST_WORDS, max(words.items(), key=lambda item: item[1])
