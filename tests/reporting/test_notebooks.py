"""Results show themselves in notebooks, with every text escaped."""

from html.parser import HTMLParser
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.checks.verdict import Finding, Verdict
from gamekeeper.contract import Contract
from gamekeeper.diagnosis.pivot_result import Pivots
from gamekeeper.episodes.divergence import Divergence
from gamekeeper.runs.comparison import Replay
from gamekeeper.runs.standing import Against, Standing

HOSTILE = "<script>alert('x')</script>\u202e\"&"


class Elements(HTMLParser):
    """Collects what elements there are and what stands in them; an open one at the end is seen."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Notes an element; none of ours has attributes."""
        assert not attrs
        self.found.append(tag)
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Closes the one that was opened last."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Notes a text."""
        self.text += data


def elements(html: str) -> Elements:
    """What a browser would make of it."""
    parser = Elements()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return parser


def results() -> list[tuple[str, object]]:
    """Results with a hostile text in each, by name."""
    declared = Contract.from_json(
        {
            "name": HOSTILE,
            "api": "aec",
            "why": HOSTILE,
            "roles": {"picker": {"agents": HOSTILE, "symmetric": True}},
            "schedule": {"stages": [["picker"]], "horizon": 3},
        }
    )
    replay = Replay("run", False, None, "", None, HOSTILE)
    row = Standing(HOSTILE, HOSTILE, None, "stale", HOSTILE, HOSTILE)
    apart = Divergence(3, 7, HOSTILE, "reward", 1.0, HOSTILE)
    finding = Finding(HOSTILE, "1", HOSTILE, "f", HOSTILE)
    verdict = Verdict("GK402", HOSTILE, "failed", "high", findings=(finding,))
    return [
        ("contract", declared),
        ("replay", replay),
        ("against", Against("r", "e", (row,))),
        ("divergence", apart),
        ("finding", finding),
        ("verdict", verdict),
    ]


@pytest.mark.parametrize(("name", "result"), results())
def test_notebooks_show_results_as_text_alone(name: str, result: object) -> None:
    """No element comes from data, and nothing of it is lost."""
    seen = elements(result._repr_html_())  # type: ignore[attr-defined]  # what notebooks look for
    assert "script" not in seen.found
    assert HOSTILE in seen.text


def test_divergence_has_a_caption_with_its_place() -> None:
    """Episode, turn and agent, above the field and both values."""
    seen = elements(Divergence(3, 7, "picker_0", "reward", 1.0, 0.5)._repr_html_())
    assert "First difference, episode 3, turn 7, agent picker_0" in seen.text
    assert "caption" in seen.found


@pytest.mark.parametrize(
    "result",
    [
        Verdict("GK402", "A promise.", "not_exercised", "high", reason="no agent ended"),
        Pivots("run", "full:0", (), (0, 6)),
    ],
)
def test_notebooks_show_no_table_without_rows(result: Verdict | Pivots) -> None:
    """A sentence stands where a heading would stand alone."""
    seen = elements(result._repr_html_())
    assert "table" not in seen.found
    assert "no agent ended" in seen.text or "0 of 6 episodes failed" in seen.text


def test_programs_stand_in_notebooks_as_code() -> None:
    """Jupyter sets `code` in its fixed-width font; `pre` alone in that of its text."""
    program = "for agent in agents:\n    pass"
    seen = elements(Finding("w", "e", "a", "f", program)._repr_html_())
    assert seen.found[-2:] == ["pre", "code"]
    assert program in seen.text


def test_notebooks_show_every_public_result(tmp_path: Path) -> None:
    """Contract, draft, evidence and audit, as a user has them in hand."""
    evidence = gk.rollout("two_robot_line", episodes=1, out=tmp_path / "run")
    audit = gk.audit("two_robot_line", budget=100, select=("GK402",))
    for result in (evidence.contract, gk.draft_contract("two_robot_line"), evidence, audit):
        assert elements(result._repr_html_()).found
    card = elements(evidence.contract._repr_html_())
    assert card.found.count("caption") >= 4
    assert "two_robot_line_v0 (Parallel)" in card.text
