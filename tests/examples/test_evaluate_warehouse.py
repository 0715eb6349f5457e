"""examples/evaluate_warehouse.py."""

from __future__ import annotations

import pytest

from examples import evaluate_warehouse
from gamekeeper.evaluation.evaluator import evaluate
from gamekeeper.evaluation.spec_reader import read_file


def test_evaluate_warehouse_tells_who_is_above_whom(capsys: pytest.CaptureFixture[str]) -> None:
    """Two episodes are too few for intervals, and that is said."""
    evaluate_warehouse.main(2)
    out = capsys.readouterr().out
    assert "calm   reference" in out
    assert "late   mixed" in out
    assert "at least 50 episodes" in out


def test_evaluate_warehouse_takes_policies_by_role() -> None:
    """The mixed team is the cell of cross-play in which these two meet."""
    spec = read_file(evaluate_warehouse.SPEC)
    found = evaluate(spec, episodes=1)
    cells = {tuple(c["roles"].values()): c for c in found.crossplay["calm"]["cells"]}
    mixed = next(
        row
        for row in found.results
        if (row["environment"], row["policy"], row["scope"], row["metric"])
        == ("calm", "mixed", "team", "return")
    )
    assert cells["reference", "hasty"]["mean"] == pytest.approx(mixed["mean"]["value"])
