"""What the docs tell a reader to type works as it stands; tutorials have a file of their own."""

from pathlib import Path

import pytest

from tests.surface.sources import ROOT
from tests.surface.typed_pages import TYPED, at_home, blocks_of, short, type_page

FOLDERS = ("", "how-to", "explanation", "tasks", "trainers")
PAGES = [
    ROOT / "README.md",
    *(page for x in FOLDERS for page in sorted((ROOT / "docs" / x).glob("*.md"))),
]
ELSEWHERE = {
    "docs/tutorials/write-a-task.md": "tests/cli/test_exercise.py",
    **{
        f"docs/how-to/{x}.md": "tests/cli/test_query.py"
        for x in ("query", "stale-evidence", "video")
    },
}
"""Pages whose blocks a test of their own runs."""
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))


@pytest.mark.parametrize("page", [p for p in PAGES if short(p) not in ELSEWHERE], ids=short)
def test_page_works_as_it_is_typed(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every block of the page runs, after those before it, and exits as it says."""
    type_page(page, at_home(tmp_path, monkeypatch))


@pytest.mark.parametrize("page", [*PAGES, *TUTORIALS], ids=short)
def test_page_hides_no_block_from_the_tests(page: Path) -> None:
    """A block has a kind that is run, or is output, or says why it isn't run."""
    kinds = {block.kind for block in blocks_of(page) if block.why_not is None}
    elsewhere = {"bash"} if short(page) in ELSEWHERE else set()
    assert kinds <= {"", *TYPED, *elsewhere}
    assert page.read_text(encoding="utf-8").count("\n```") == 2 * len(blocks_of(page))


def test_pages_that_are_run_elsewhere_are() -> None:
    """The test that runs a page names it."""
    for page, test in ELSEWHERE.items():
        assert Path(page).stem in (ROOT / test).read_text(encoding="utf-8")
