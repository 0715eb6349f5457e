import pytest

from gamekeeper.reporting.check_text import by_family, check_text, checks_text, paragraphs

ABOUT = """Learners bootstrap past the end,
and credit the wrong action.

Bad:

```python
rewards = {agent: 1.0}

return rewards
```

Good:
    rewards = {}
"""
CARD = {
    "id": "GK402",
    "name": "rewards_stop",
    "claim": "An agent that has ended is paid nothing more.",
    "about": ABOUT,
    "needs": ["rollout"],
    "severity": "high",
    "confidence": 1.0,
    "fix": "pay 0",
    "api": None,
}


def test_docstrings_are_read_in_parts() -> None:
    """Prose in one line, headings, code without its fence, whether fenced or indented."""
    assert list(paragraphs(ABOUT)) == [
        ("text", "Learners bootstrap past the end, and credit the wrong action."),
        ("heading", "Bad:"),
        ("code", "rewards = {agent: 1.0}\n\nreturn rewards"),
        ("heading", "Good:"),
        ("code", "rewards = {}"),
    ]


def test_check_is_explained_on_a_terminal() -> None:
    """Claim, reason, examples, fix, severity, how to waive it."""
    text = check_text(CARD, width=80)
    assert text.splitlines()[0] == "GK402  An agent that has ended is paid nothing more."
    assert "\n      rewards = {agent: 1.0}\n" in text
    assert '[waivers] GK402 = "the reason"' in text


def test_checks_are_listed_by_family() -> None:
    """The first figure of an id says what it is about; third parties' are others."""
    cards = [CARD, {**CARD, "id": "GK101"}, {**CARD, "id": "ACME101"}]
    assert list(by_family(cards)) == ["others", "rosters and identity", "rewards"]
    assert "Rewards\n  GK402  high" in checks_text(cards, width=80)


@pytest.mark.parametrize("about", ["", "One line.", "```\nunclosed"])
def test_any_docstring_can_be_shown(about: str) -> None:
    """Also one of a third party, whatever its form."""
    assert "GK402" in check_text({**CARD, "about": about}, width=60)
