"""Evidence as data frames of pandas and Polars."""

from __future__ import annotations

import sys

import pytest

import gamekeeper as gk
from gamekeeper.errors import DependencyError, EvidenceError


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_evidence_is_a_data_frame(package: str) -> None:
    """The rows of agents, or of another table, with their columns."""
    module = pytest.importorskip(package)
    evidence = gk.rollout("two_robot_line", episodes=1, seed=0, most_turns=4)
    made = evidence.to_pandas if package == "pandas" else evidence.to_polars
    frame = made()
    assert isinstance(frame, module.DataFrame)
    assert evidence.agent_steps["reward"].to_pylist()[0] == frame["reward"][0]
    assert (evidence.agent_steps.num_rows, evidence.agent_steps.column_names) == (
        len(frame),
        list(frame.columns),
    )
    assert len(made("episodes")) == 1
    with pytest.raises(EvidenceError, match="no such table"):
        made("steps")


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_missing_package_is_named(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says what to install."""
    evidence = gk.rollout("two_robot_line", episodes=1, seed=0, most_turns=2)
    if package == "pandas":

        class Table:
            def to_pandas(self) -> None:
                raise ImportError("no pandas")

        monkeypatch.setattr(type(evidence), "_table", lambda *_: Table())
    else:
        monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(DependencyError, match=f"pip install {package}"):
        evidence.to_pandas() if package == "pandas" else evidence.to_polars()
