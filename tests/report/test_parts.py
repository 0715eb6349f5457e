"""Figures of a run from some rows at a time are those of all rows at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gamekeeper.core import tables
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.summary import summarise
from gamekeeper.record.recording import rollout
from gamekeeper.report.page.failing import failing
from gamekeeper.report.page.figures import figures_of
from gamekeeper.report.sparkline import returns_by_episode


@pytest.fixture(scope="module", params=["warehouse", "spread", "connect_four"])
def evidence(request: pytest.FixtureRequest) -> Evidence:
    """Some episodes with roles, terms, noops and infos; with floats; of turns."""
    return rollout(request.param, episodes=3, seed=5, most_turns=40)


@pytest.mark.parametrize("rows", [1, 7, 100])
def test_figures_do_not_depend_on_parts(
    evidence: Evidence, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last digit, wherever a part ends."""
    whole = _figures(evidence)
    monkeypatch.setattr(tables, "PART_ROWS", rows)
    apart = _figures(evidence)

    np.testing.assert_equal(apart, whole)


def _figures(evidence: Evidence) -> Any:
    figures = figures_of(evidence)
    names = ("agents", "present", "returns", "lengths", "terms", "terminated", "truncated")
    return [
        summarise(evidence).to_json(),
        returns_by_episode(evidence),
        [getattr(figures, name) for name in names],
        failing(evidence, figures),
    ]


@pytest.mark.parametrize("folds", [1, 2])
def test_groups_are_folded_as_they_come(
    evidence: Evidence, folds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pairs that wait become one early or late, and come to the same."""
    whole = summarise(evidence).to_json()
    monkeypatch.setattr("gamekeeper.core.tally.FOLD", folds)
    monkeypatch.setattr(tables, "PART_ROWS", 3)

    assert whole == summarise(evidence).to_json()
