"""The texts that are kept say what is so: their links lead somewhere, their commands exist."""

import re
from pathlib import Path

import pytest

from gamekeeper.checks.check import checks
from tests.surface.sources import ROOT, kept_files

TEXTS = sorted(path for path in kept_files() if path.suffix == ".md")
NOTES = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
NOTE_LINES = 40
MOST_ENTRIES = 12
MADE = {ROOT / "docs" / "checks" / f"{name}.md" for name in ("index", *checks())}
"""Pages that git doesn't keep."""
LINK = re.compile(r"\[[^\]]*\]\(([^)\s#]+)[^)]*\)")


def short(path: Path) -> str:
    """A path as it stands in the repository, for the names of tests."""
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("text", TEXTS, ids=short)
def test_links_lead_somewhere(text: Path) -> None:
    """Every relative link of a page is a file or folder that is there, or that `make docs` adds."""
    links = [x for x in LINK.findall(text.read_text(encoding="utf-8")) if "://" not in x]
    targets = {x: text.parent / x for x in links}
    assert [x for x, to in targets.items() if not to.exists() and to.resolve() not in MADE] == []


@pytest.mark.parametrize("note", NOTES, ids=short)
def test_decision_note_is_whole_and_short(note: Path) -> None:
    """A decision note names context, decision, consequences and what was measured, on one page."""
    text = note.read_text(encoding="utf-8")
    sections = re.findall(r"^## (.+)$", text, flags=re.M)
    assert sections == ["Context", "Decision", "Consequences", "Measured"]
    assert len(text.splitlines()) <= NOTE_LINES


def test_decision_notes_are_listed() -> None:
    """Every note stands on the page of the project, and no two have one number."""
    index = (ROOT / "docs" / "project.md").read_text(encoding="utf-8")
    assert [n.name for n in NOTES if f"decisions/{n.name}" not in index] == []
    assert len({n.name[:4] for n in NOTES}) == len(NOTES)


def test_every_page_is_listed() -> None:
    """Every page stands on one of the side bar's entries, or in a folder that one of them lists."""
    docs = ROOT / "docs"
    index = (docs / "index.md").read_text(encoding="utf-8").partition("## All pages")[2]
    entries = re.findall(r"^- \[[^\]]+\]\(([\w./-]+)\)", index, flags=re.M)
    assert len(entries) <= MOST_ENTRIES
    texts = index + "".join((docs / each).read_text(encoding="utf-8") for each in entries)
    pages = {str(page.relative_to(docs)) for page in TEXTS if page.is_relative_to(docs)}
    listed = {x for x in pages if f"]({x})" in texts or x.startswith("findings/")}
    assert pages - listed == {"index.md"}


def test_commands_of_make_exist() -> None:
    """Every `make target` that a page names is a target of the Makefile."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, flags=re.M))
    named = {
        x for t in TEXTS for x in re.findall(r"(?:`|^)make ([a-z-]+)", t.read_text("utf-8"), re.M)
    }
    assert named - targets == set()


def test_every_target_is_explained() -> None:
    """`make help` tells of every target that a person types."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.search(r"^\.PHONY: (.+)$", makefile, flags=re.M)
    assert phony is not None
    told = set(re.findall(r'@echo "make ([a-z-]+)', makefile))
    steps_of_check = {"format-check", "lint", "types", "slow-test", "all-test"}
    assert set(phony[1].split()) - told == steps_of_check | {"help", "moved"}
