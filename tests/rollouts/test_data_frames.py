"""Evidence as data frames of pandas."""

import pytest

import gamekeeper as gk
from gamekeeper.errors import DependencyError, EvidenceError


def test_evidence_is_a_data_frame() -> None:
    """The rows of agents, or of another table, with their columns."""
    pandas = pytest.importorskip("pandas")
    evidence = gk.rollout("two_robot_line", episodes=1, seed=0, most_turns=4)
    frame = evidence.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert evidence.agent_steps["reward"].to_pylist()[0] == frame["reward"][0]
    assert (evidence.agent_steps.num_rows, evidence.agent_steps.column_names) == (
        len(frame),
        list(frame.columns),
    )
    assert len(evidence.to_pandas("episodes")) == 1
    with pytest.raises(EvidenceError, match="no such table"):
        evidence.to_pandas("steps")


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says what to install."""
    evidence = gk.rollout("two_robot_line", episodes=1, seed=0, most_turns=2)

    class Table:
        def to_pandas(self) -> None:
            raise ImportError("no pandas")

    monkeypatch.setattr(type(evidence), "agent_steps", Table())
    with pytest.raises(DependencyError, match="pip install pandas"):
        evidence.to_pandas()
