"""Recorded runs are judged row by row, and nothing of them is executed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.auditing.recorded_evidence import failed_rows, outside_actions
from gamekeeper.cli.diagnose import outside_space
from gamekeeper.errors import EvidenceError
from tests.faults import environments


def recorded(name: str, out: Path, **options: object) -> str:
    """A run of a faulty environment."""
    gk.rollout(environments()[name].spec, episodes=40, seed=0, out=str(out), **options)
    return str(out)


@pytest.mark.parametrize("name", ["Rovers", "Traders"])
def test_sound_run_passes_and_names_what_needs_reruns(name: str, tmp_path: Path) -> None:
    """Checks of rows pass; the others weren't exercised, and say what exercises them."""
    found = gk.audit(recorded(name, tmp_path / "run"))
    assert found.failed == ()
    assert found.ok
    assert found.of("GK214").outcome == "passed"
    assert found.of("GK604").outcome == "not_exercised"
    assert "gamekeeper audit ENV" in found.of("GK604").reason


@pytest.mark.parametrize("id", ["GK214", "GK215", "GK401", "GK402"])
def test_run_fails_what_its_environment_fails(id: str, tmp_path: Path) -> None:
    """What one row decides fails in the evidence too, at a place in the run."""
    names = [name for name, each in environments().items() if id in each.checks]
    outcomes = []
    for name in names:
        verdict = gk.audit(recorded(name, tmp_path / name), select=(id,)).of(id)
        outcomes.append(verdict.outcome)
        if verdict.outcome == "failed":
            assert verdict.findings[0].where.startswith("episode ")
            assert verdict.reproduced is None
    assert "failed" in outcomes


def test_environment_of_a_run_is_not_opened(tmp_path: Path) -> None:
    """The file with the environment is gone, and its run is judged all the same."""
    file = tmp_path / "mine.py"
    file.write_text("from tests.faults.rovers import Rovers as make\n")
    gk.rollout(f"{file}:make", episodes=2, out=str(tmp_path / "run"))
    file.unlink()
    assert gk.audit(tmp_path / "run").of("GK214").outcome == "passed"


def test_run_of_digests_is_refused_with_the_way_out(tmp_path: Path) -> None:
    """Observations that aren't kept can't be judged."""
    run = recorded("Rovers", tmp_path / "run", level="digest")
    with pytest.raises(EvidenceError, match="--level full"):
        gk.audit(run)


class Moved(ParallelEnv):  # type: ignore[type-arg, misc]  # PettingZoo ships no types
    """Observation and reward are what was done: sound, and no better than its policies."""

    metadata = {"name": "moved_v0"}  # noqa: RUF012  # as PettingZoo has it
    possible_agents = ["a"]  # noqa: RUF012  # the same

    def observation_space(self, agent: str) -> Box:
        return Box(-1, 1, (1,), np.float32)

    action_space = observation_space

    def reset(self, seed: int | None = None, options: object = None) -> Any:
        self.agents, self.tick = ["a"], 0
        return {"a": np.zeros(1, np.float32)}, {"a": {}}

    def step(self, actions: Any) -> Any:
        self.tick += 1
        over = {"a": self.tick > 2}
        self.agents = [] if over["a"] else ["a"]
        action = actions["a"]
        return {"a": action}, {"a": float(action[0])}, over, {"a": False}, {"a": {}}


@pytest.mark.parametrize(("value", "seen"), [(np.nan, "NaN at [0]"), (2.0, "2.0 at [0]")])
def test_what_follows_an_action_out_of_its_space_is_not_judged(
    tmp_path: Path, value: float, seen: str
) -> None:
    """A policy's NaN is the policy's: it is counted, and its episode says nothing of the rules."""

    def policy(observation: Any, agent: str, info: Any, rng: Any) -> Any:
        return np.float32([value])

    evidence = gk.rollout(Moved, policies=policy, out=str(tmp_path / "run"), episodes=1)
    assert failed_rows(evidence) == ()
    found = gk.audit(tmp_path / "run", select=("GK214", "GK215", "GK401"))
    assert {each.outcome for each in found.verdicts} == {"not_exercised"}
    assert "out of its space" in found.of("GK215").reason
    ((agent, (count, of, first)),) = outside_actions(evidence).items()
    assert (agent, count, of) == ("a", 3, 3)
    assert first.startswith(f"episode 0, turn 0, action['a']: {seen}")
    shown = outside_space(tmp_path / "run", 80)  # what a diagnosis says of it
    assert "3 of 3. First at episode 0, turn 0" in shown
    assert "judged" not in shown


def test_what_a_run_does_not_keep_needs_reruns(tmp_path: Path) -> None:
    """Agents end in the run; that `agents` isn't kept is no word about its episodes."""
    gk.rollout("tictactoe", episodes=2, out=tmp_path / "run")
    found = gk.audit(str(tmp_path / "run"))
    for id in ("GK301", "GK302", "GK303"):
        assert found.of(id).outcome == "not_exercised"
        assert "gamekeeper audit ENV" in found.of(id).reason
