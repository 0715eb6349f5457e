"""The example with a centralised critic: what it credits, counts and prints."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk

pytestmark = pytest.mark.trainer


def test_quick_run_prints_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A few steps; the line has what every example's line has."""
    pytest.importorskip("torch")
    from examples import mappo_warehouse as example

    monkeypatch.setattr("sys.argv", ["mappo_warehouse.py", "--quick", "--seed", "3"])
    assert example.main() == 0
    (line,) = capsys.readouterr().out.splitlines()
    told = json.loads(line)
    assert (told["example"], told["task"], told["seed"]) == ("mappo_warehouse", "warehouse", 3)
    assert {"trainer", "steps", "seconds", "measure", "result", "wanted", "reached"} <= set(told)


def test_play_learns_what_was_paid_and_from_whom_it_was_seen() -> None:
    """Steps follow one another: a robot that lives on goes on where it stood, with the state."""
    torch = pytest.importorskip("torch")
    from examples import mappo_warehouse as example

    args = replace(example.Args(), copies=4, length=12)
    learner = example.Mappo(args, 0)
    own, given, _, live, _, _, _, paid, goes_on, after = learner.play()
    assert own.shape[:3] == given.shape[:3] == (12, 4, 3)
    torch.testing.assert_close(given[..., -own.shape[-1] :], own)
    assert live.all()
    assert goes_on.all()
    assert after.shape == (4, 3)
    assert paid.shape == (12, 4, 3)


def test_deliveries_are_those_that_evidence_tells() -> None:
    """A recorded episode, played again in a batch: as many as the carrier was paid for."""
    pytest.importorskip("torch")
    from examples import mappo_warehouse as example

    evidence = gk.rollout(
        "warehouse", policies="reference", episodes=1, seed=0, env_kwargs=example.KWARGS
    )
    rows = [row for row in evidence.agent_steps.to_pylist() if row["agent"] == "carrier_0"]
    turns = [t.actions for t in evidence.episodes[0].turns if any(t.actions.values())]

    class Recorded:
        """Does what was done."""

        def __init__(self) -> None:
            self.left = iter(turns)

        def act(self, batch: Any) -> np.ndarray:
            did = next(self.left)
            return np.array([[did[agent] for agent in batch.kernel.agents]])

    robots: Any = Recorded()
    paid = sum(row["reward.delivery"] or 0.0 for row in rows)
    assert example.deliveries(robots, 1, seed=0).tolist() == [paid] == [4.0]
