"""The pages of checks, which `make docs` writes: one of them, with a real audit."""

import ast

import pytest

from docs.check_pages import faulty_by_check, index_page, output_of, page
from gamekeeper.checks.check import checks
from gamekeeper.cli.explain import card_of
from gamekeeper.reporting.check_text import paragraphs

NOT_PYTHON = {
    "GK203",  # in words
    "GK235",  # leaves things out by "..."
    "GK243",  # a contract's TOML
    "GK407",  # lost its last line
}
CARD = card_of(checks()["GK402"])


def test_every_check_has_a_faulty_environment_for_its_page() -> None:
    """No page is without one."""
    assert sorted(faulty_by_check()) == sorted(checks())


def test_page_shows_the_environment_and_what_an_audit_says() -> None:
    """Markdown with fenced examples, the environment, and its finding."""
    text = page(CARD, source="class Faulty: ...", output=output_of("GK402"))
    assert text.startswith("# GK402: ")
    assert "```python\nclass Faulty: ...\n```" in text
    assert "$ gamekeeper audit tests.faults.rewards:PaidAfterEnd --select GK402\n" in text
    assert "\n  GK402  " in text.partition("## What the audit says")[2]


def test_a_contract_stands_above_its_audit() -> None:
    """A check of what is declared is shown with the declaration."""
    text = output_of("GK306")
    assert text.startswith("# contract.toml\n")
    assert 'order = "fixed"' in text
    assert "--select GK306 --contract contract.toml" in text


def test_index_links_every_check() -> None:
    """A row for each check, under its family."""
    text = index_page([CARD, {**CARD, "id": "GK101", "claim": "a|b"}])
    assert "## Rewards\n\n| check | severity | promise |" in text
    assert "| [GK402](GK402.md) | high |" in text
    assert "a\\|b" in text


@pytest.mark.parametrize("id", sorted(checks()))
def test_examples_can_be_read(id: str) -> None:
    """Every check has a bad and a good example; their code is Python."""
    about = checks()[id].about
    assert "Bad:" in about
    assert "Good:" in about
    if id not in NOT_PYTHON:
        for text in (text for kind, text in paragraphs(about) if kind == "code"):
            ast.parse(text)
