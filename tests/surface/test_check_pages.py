"""Pages of checks say what checks say: `python -m gamekeeper.cli._pages --changed docs/checks`."""

import pytest

from gamekeeper.cli._checks import specimens
from gamekeeper.cli._pages import INDEX, kept_output, pages, without_output
from tests.surface.sources import ROOT

FOLDER = ROOT / "docs" / "checks"
EXPECTED = pages({})


def test_every_check_has_its_page() -> None:
    """No check is without a page, no page without a check."""
    assert sorted(path.name for path in FOLDER.glob("*.md")) == sorted(EXPECTED)


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_page_says_what_the_check_says(name: str) -> None:
    """Claim, reason, examples, mend and severity are those of the source."""
    page = (FOLDER / name).read_text(encoding="utf-8")
    assert without_output(page) == without_output(EXPECTED[name])


@pytest.mark.parametrize("id", sorted(specimens()))
def test_page_shows_an_audit_that_finds_it(id: str) -> None:
    """What the audit says of the specimen names the check."""
    output = kept_output((FOLDER / f"{id}.md").read_text(encoding="utf-8"))
    assert output is not None
    assert f"\n  {id}  " in output
    assert INDEX not in output
