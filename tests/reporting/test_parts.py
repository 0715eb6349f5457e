"""Figures of a run from some rows at a time are those of all rows at once."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.episodes import tables
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.reporting.page.episode_figures import failing, figures_of
from gamekeeper.reporting.text_columns import returns_by_episode
from gamekeeper.runs.recording import rollout


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


def _summary(evidence: Evidence) -> Any:
    summary = type(evidence).summary.func(evidence)  # anew, as the property keeps its first value
    return summary.to_json()


def _figures(evidence: Evidence) -> Any:
    figures = figures_of(evidence)
    names = ("agents", "present", "returns", "lengths", "terms", "terminated", "truncated")
    return [
        _summary(evidence),
        returns_by_episode(evidence),
        [getattr(figures, name) for name in names],
        failing(evidence, figures),
    ]


@pytest.mark.parametrize("folds", [1, 2])
def test_groups_are_folded_as_they_come(
    evidence: Evidence, folds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pairs that wait become one early or late, and come to the same."""
    whole = _summary(evidence)
    monkeypatch.setattr("gamekeeper.episodes.summary.FOLD", folds)
    monkeypatch.setattr(tables, "PART_ROWS", 3)

    assert whole == _summary(evidence)
