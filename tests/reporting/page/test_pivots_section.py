"""The section of pivots: the curve of each failed episode, and links to the turns it fell."""

import json
from pathlib import Path
from typing import Any

import gamekeeper as gk
from gamekeeper.reporting.page.pivots_section import pivots_section
from gamekeeper.runs.files.notes import annotate
from gamekeeper.viewing.report_documents import documents_of


def point(turn: int, share: float) -> dict[str, Any]:
    """A point of a curve."""
    hits = round(100 * share)
    low, high = max(share - 0.1, 0.0), min(share + 0.1, 1.0)
    return {"turn": turn, "successes": hits, "n": 100, "low": low, "high": high, "share": share}


def episode(number: int, turn: int, **more: Any) -> dict[str, Any]:
    """A failed episode with one pivot."""
    tried = {
        "agent": "a_0",
        "action": "1",
        "source": "legal",
        "successes": 9,
        "n": 10,
        "share": 0.9,
    }
    before, after = point(turn, 0.9), point(turn + 1, 0.1)
    pivot = {"turn": turn, "before": before, "after": after, "p": 0.001, "loss": "action"}
    pivot |= {"agents": ["a_0"], "tried": [{**tried, "keeps": True}]}
    found = {"episode": number, "question": "falls", "turns": 9, "not_tried": []}
    return {**found, "curve": [point(0, 0.9), before, after], "pivots": [pivot], **more}


def test_pivots_stand_as_a_curve_and_as_links_into_the_player() -> None:
    """One chart an episode with its marks; every pivot is a row that opens its turn."""
    last = episode(4, 5, question="last action", curve=[], not_tried=["turns 0 to 4"])
    section = pivots_section({"episodes": [episode(2, 3), last]}, key="a")
    assert section is not None
    block, left = section.blocks
    (chart,) = block.charts
    assert (chart["id"], chart["x"]["values"]) == ("pivots-2", [0, 3, 4])
    assert chart["series"][0]["values"] == [0.9, 0.9, 0.1]
    assert chart["marks"] == [{"x": 3, "text": "turn 3"}]
    rows = block.tables[0].rows
    assert [row[1].link for row in rows] == ["a/2/3", "a/4/5"]
    assert [row[2].text for row in rows] == ["90% (90 of 100; 80% to 100%)", "-"]
    assert "a_0 would have kept it by action 1" in rows[0][5].text
    assert (left.title, left.folded) == ("Not tried: 1", True)
    assert left.notes == ("Episode 4: turns 0 to 4.",)
    assert pivots_section(None, key="a") is pivots_section({"episodes": []}, key="a") is None


def test_a_report_has_the_pivots_of_several_calls(tmp_path: Path) -> None:
    """Those of other episodes are added; the last word on an episode holds."""
    run, page = tmp_path / "run", tmp_path / "page.html"
    gk.rollout("two_robot_line", episodes=2, out=run)
    for one in (episode(0, 3), episode(1, 4), episode(0, 2)):
        document = {"conditions": {"team": "return < 1"}, "episodes": [one]}
        annotate(run, {"kind": "pivots", "by": "a test", "document": document})
    found = documents_of(run).pivots
    assert found is not None
    assert [each["pivots"][0]["turn"] for each in found["episodes"]] == [2, 4]
    gk.report(run, page)
    text = page.read_text()
    assert json.dumps("pivots-0") in text
    assert text.index('id="pivots"') > text.index('id="player"')
