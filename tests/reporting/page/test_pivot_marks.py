"""Pivots of a document stand on their episode's timeline."""

from gamekeeper.diagnosis.pivot_result import CurvePoint, EpisodePivots, Pivot, Pivots
from gamekeeper.reporting.page.pivots_section import pivot_marks, pivots_of, success_curve


def document() -> dict[str, object]:
    """One episode with a fall by an action, and one by chance."""
    points = tuple(CurvePoint(t, n, 10, n / 10, n / 10) for t, n in ((0, 9), (4, 8), (5, 1)))
    pivots = (
        Pivot(4, points[1], points[2], 0.01, loss="action", agents=("picker_0",)),
        Pivot(2, points[0], points[1], 0.04, loss="draws"),
    )
    one = EpisodePivots(3, "team", 8, "falls", curve=points, pivots=pivots)
    return Pivots("runs/a", "full:0", (one,), (1, 4)).to_json()


def test_pivots_are_marks_and_a_curve() -> None:
    """The agent whose action would have kept it has the mark; an episode without any has none."""
    found = pivots_of(document(), 3)
    assert found is not None
    action, chance = pivot_marks(found)
    assert (action.turn, action.kind, action.agent) == (4, "pivot", "picker_0")
    assert action.text == "success falls from 80% to 10%"
    assert (chance.agent, chance.text) == (None, "success falls from 90% to 80%; chance lost it")
    assert success_curve(found)[2] == [5, 0.1, 0.1, 0.1]
    assert pivots_of(document(), 0) is None
    assert pivots_of(None, 3) is None
