"""The page says what they say: `python -m gamekeeper.cli._interventions docs/interventions.md`."""

from gamekeeper.cli._interventions import card_of, page
from gamekeeper.rollouts.intervention import interventions
from tests.surface.sources import ROOT


def test_page_of_changes_says_what_they_say() -> None:
    """Names, labels, strengths and docstrings are those of the source."""
    assert (ROOT / "docs" / "interventions.md").read_text(encoding="utf-8") == page()


def test_every_change_has_its_place_on_the_page() -> None:
    """No change is left out; perturbations have a section with their strengths."""
    text = page()
    for name, change in interventions().items():
        heading = f"### {name}\n" if card_of(change)["kind"] == "perturbation" else f"| `{name}("
        assert heading in text
