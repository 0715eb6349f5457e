"""Reference pages say what the code says: `python -m docs.reference_pages`."""

import inspect
import re

import pytest

import gamekeeper
from docs.reference_pages import pages
from gamekeeper import errors
from gamekeeper.cli._app import commands
from gamekeeper.cli.list import intervention_card
from gamekeeper.rollouts.intervention import interventions
from tests.surface.sources import ROOT

DOCS = ROOT / "docs"
API = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(pages()))
def test_page_is_the_one_that_is_written(name: str) -> None:
    """Commands, options, errors and interventions are those of the source."""
    assert (DOCS / name).read_text(encoding="utf-8") == pages()[name]


def test_every_command_has_its_section() -> None:
    """No command is left out, none stands there that isn't one."""
    headings = re.findall(r"^## (\S+)$", pages()["reference/commands.md"], flags=re.M)
    assert headings == [name for name, _ in commands()]


def test_every_error_has_its_row() -> None:
    """Each class of the tree of errors has a row."""
    kinds = [
        name
        for name, thing in vars(errors).items()
        if inspect.isclass(thing) and issubclass(thing, errors.GamekeeperError)
    ]
    assert [name for name in kinds if f"`gk.{name}` |" not in pages()["reference/errors.md"]] == []


def test_every_intervention_has_its_place_on_the_page() -> None:
    """No intervention is left out; perturbations have a section with their strengths."""
    text = pages()["interventions.md"]
    for name, each in interventions().items():
        is_graded = intervention_card(each)["kind"] == "perturbation"
        assert (f"### {name}\n" if is_graded else f"| `{name}(") in text


def test_every_public_name_is_documented() -> None:
    """Every name of `gamekeeper.__all__` has its directive on the page of the API."""
    named = set(re.findall(r"^\.\. (?:auto|py:)\w+:: gamekeeper\.(\w+)$", API, flags=re.M))
    assert set(gamekeeper.__all__) - named == set()


def test_every_documented_name_is_there() -> None:
    """Every directive on the page of the API names something that can be imported."""
    for path in re.findall(r"^\.\. (?:auto|py:)\w+:: (gamekeeper[\w.]*)$", API, flags=re.M):
        thing: object = gamekeeper
        for part in path.split(".")[1:]:
            thing = getattr(thing, part, None) or __import__(
                path.rpartition(".")[0], fromlist=[part]
            )
        assert thing is not None, path
