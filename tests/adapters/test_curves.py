"""Evidence as curves: each agent's, each role's and the team's figures by name."""

from __future__ import annotations

import pytest

import gamekeeper as gk
from gamekeeper.adapters import curves


def test_figures_are_those_of_the_evidence() -> None:
    """Returns by agent, and the team's, which is their sum."""
    evidence = gk.rollout("two_robot_line", episodes=2, seed=0, most_turns=20)
    found = dict(curves.figures(evidence))
    parts = {a: part.to_json()["return_mean"] for a, part in evidence.summary.agents.items()}
    assert parts == {agent: found[f"{agent}/return"] for agent in parts}
    assert found["team/return"] == pytest.approx(sum(parts.values()))


def test_roles_of_several_agents_have_a_mean() -> None:
    """The mean over the agents of a role, beside each of them."""
    evidence = gk.rollout("warehouse", episodes=1, seed=0, most_turns=5, policies="random")
    found = dict(curves.figures(evidence))
    pickers = [v for name, v in found.items() if name.startswith("picker_") and "/return" in name]
    assert found["picker/return"] == pytest.approx(sum(pickers) / len(pickers))
