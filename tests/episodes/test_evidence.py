"""One run has one fingerprint; anything that happened otherwise has another."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box
from hypothesis import given, settings
from hypothesis import strategies as st

import gamekeeper as gk
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import EvidenceError
from tests.episodes.buffers import Given, record

SPACE = Box(-9, 9, (2,), np.float32)
STEADY = np.array([1, 2], np.float32)


def env_of(**changes: Any) -> Given:
    """An environment of two agents with everything that a fingerprint covers."""
    parts: dict[str, Any] = {
        "observations": {"a": [STEADY], "b": [STEADY]},
        "infos": {"a": [{"x": 1, "wall": 0.1}]},
        "rewards": [0.0, 1.0],
        "states": [np.array([1.0])],
        "spaces": {"a": SPACE, "b": SPACE},
        "actions": None,
    } | changes
    observations, spaces = parts.pop("observations"), parts.pop("spaces")
    return Given(observations, spaces, **parts)


def test_same_run_has_the_same_fingerprint() -> None:
    """Twice in one process."""
    first, second = (record(env_of(), 5, episodes=2) for _ in range(2))
    assert first.fingerprint == second.fingerprint
    assert len(first.fingerprint.removeprefix("full:")) == 64


CHANGES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "seed": ({}, {"seed": 2}),
    "no seed": ({}, {"seed": None}),
    "options": ({}, {"options": {"a": 1}}),
    "empty options": ({}, {"options": {}}),
    "action": ({}, {"actions": [np.int64(1), np.int64(2)]}),
    "type of actions": ({}, {"actions": [np.int64(1), 1]}),
    "reward": ({"rewards": [0.0, 1.0 + 2**-52]}, {}),
    "sign of zero": ({"rewards": [-0.0, 1.0]}, {}),
    "observation": ({"observations": {"a": [STEADY], "b": [STEADY + 1]}}, {}),
    "sign of zero seen": ({"observations": {"a": [STEADY * -0.0], "b": [STEADY]}}, {}),
    "whose": (
        {"observations": {"a": [STEADY], "c": [STEADY]}, "spaces": {"a": SPACE, "c": SPACE}},
        {},
    ),
    "type of an observation": ({"observations": {"a": [[1.0, 2.0]], "b": [STEADY]}}, {}),
    "state": ({"states": [np.array([2.0])]}, {}),
    "no state": ({"states": None}, {}),
    "space": ({"spaces": {"a": SPACE, "b": Box(-8, 9, (2,), np.float32)}}, {}),
}


@pytest.mark.parametrize("name", CHANGES)
def test_whatever_happens_otherwise_changes_the_fingerprint(name: str) -> None:
    """Each by itself."""
    changes, settings_ = CHANGES[name]
    base = record(env_of(), 3)
    other = record(env_of(**changes), 3, **settings_)
    assert base.fingerprint != other.fingerprint


def test_zeros_of_both_signs_differ_as_observations() -> None:
    """-0.0 is kept."""
    zero = np.zeros(2, np.float32)
    prints = {
        record(env_of(observations={"a": [z], "b": [zero]}), 2).fingerprint for z in (zero, -zero)
    }
    assert len(prints) == 2


def test_payloads_of_nan_do_not_count() -> None:
    """One NaN, wherever it stands: seen, paid, in a state."""
    quiet, other = np.array([0x7FC00000, 0x7FC00001], np.uint32).view(np.float32)
    wide = np.array([0x7FF8 << 48, 0xFFF8 << 48 | 1], np.uint64).view(np.float64)
    assert np.isnan(wide).all()
    prints = {
        record(
            env_of(
                observations={"a": [np.array([seen, 1], np.float32)], "b": [STEADY]},
                rewards=[float(paid)],
                states=[np.array([paid])],
            ),
            3,
        ).fingerprint
        for seen, paid in zip((quiet, other), wide, strict=True)
    }
    assert len(prints) == 1


def test_infos_have_a_fingerprint_of_their_own() -> None:
    """Volatile fields are left out of it; no info is in the run's."""
    base = record(env_of(), 3, volatile=("wall",))
    other = record(env_of(infos={"a": [{"x": 1, "wall": 9.9}]}), 3, volatile=("wall",))
    changed = record(env_of(infos={"a": [{"x": 2, "wall": 0.1}]}), 3, volatile=("wall",))
    assert base.fingerprint == other.fingerprint == changed.fingerprint
    key = "info_fingerprint"
    assert base.manifest[key] == other.manifest[key] != changed.manifest[key]
    assert base.manifest[key] != record(env_of(), 3).manifest[key]


def test_other_agents_groups_change_no_row_of_ours() -> None:
    """With another space beside it an agent's columns are called otherwise; its digests stay."""
    alone = record(Given({"a_0": [STEADY]}, {"a_0": SPACE}), 3)
    wide = Box(0, 1, (3,), np.float32)
    both = record(
        Given({"a_0": [STEADY], "b_0": [np.zeros(3, np.float32)]}, {"a_0": SPACE, "b_0": wide}), 3
    )
    assert "obs" in alone.agent_steps.schema.names
    assert "obs@a" in both.agent_steps.schema.names
    ours = [turn.digests[0] for turn in both.episode(0).turns]
    assert [turn.digests[0] for turn in alone.episode(0).turns] == ours


@settings(max_examples=20)
@given(st.permutations(["a_0", "b_0", "c_0"]))
def test_order_in_which_agents_are_announced_does_not_count(order: list[str]) -> None:
    """Rows are sorted; columns are tagged; spaces are named."""
    spaces = {"a_0": SPACE, "b_0": Box(0, 1, (3,), np.float32), "c_0": SPACE}
    values = {"a_0": [STEADY], "b_0": [np.zeros(3, np.float32)], "c_0": [STEADY]}

    class Announced(Given):
        def reset(self, seed: Any = None, options: Any = None) -> Any:
            out = super().reset(seed, options)
            self.agents = sorted(self.agents)
            return out

    def printed(names: list[str]) -> str:
        evidence = record(
            Announced({n: values[n] for n in names}, {n: spaces[n] for n in names}), 3
        )
        return str(evidence.episode_table["fingerprint"].to_pylist())

    assert printed(order) == printed(["a_0", "b_0", "c_0"])


SCRIPT = """
import sys
sys.path[:0] = {paths!r}
from tests.episodes.test_evidence import env_of
from tests.episodes.buffers import record
evidence = record(env_of(infos={{"a": [{{"s": {{"x", "y", "z"}}, "d": {{"k": 1, "j": 2}}}}]}}), 3)
print(evidence.fingerprint, evidence.manifest["info_fingerprint"])
"""


def test_fingerprints_are_equal_under_two_hash_seeds() -> None:
    """In processes of their own."""
    root = str(Path(__file__).parents[2])
    paths = [root, *[path for path in sys.path if path]]
    found = {
        subprocess.run(
            [sys.executable, "-c", SCRIPT.format(paths=paths)],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
            text=True,
            timeout=60,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1
    assert len(found.pop().split()) == 2


def test_evidence_says_what_it_holds() -> None:
    """Tables, episodes, spaces, text, HTML and JSON."""
    evidence = record(env_of(), 3, episodes=2)
    assert isinstance(evidence, Evidence)
    assert evidence.episode_table.num_rows == 2
    assert evidence.agent_steps.num_rows == 2 * 2 * 4
    assert evidence.states is not None
    assert evidence.states.num_rows == 8
    assert evidence.timings is not None
    assert evidence.timings.num_rows == 6
    assert [episode.episode for episode in evidence.episodes] == [0, 1]
    assert evidence.spaces["a"].observation.space == SPACE  # type: ignore[union-attr]
    assert evidence.contract.name is None
    assert "2 episodes of given_v0 (in memory)" in str(evidence)
    assert evidence._repr_html_().startswith("<table>")
    assert evidence.to_json()["fingerprint"] == evidence.fingerprint
    with pytest.raises(EvidenceError, match="no episode 2"):
        evidence.episode(2)


@pytest.mark.parametrize("ticks", [0, 1])
def test_short_runs_are_evidence_too(ticks: int) -> None:
    """A reset without a step; no episode at all."""
    evidence = record(env_of(), ticks)
    assert evidence.episode_table["turns"].to_pylist() == [ticks]
    empty = record(env_of(), 1, episodes=0)
    assert empty.agent_steps.num_rows == empty.episode_table.num_rows == 0
    assert len(empty.fingerprint.removeprefix("full:")) == 64
    assert str(empty)


@pytest.mark.parametrize("spec", ["two_robot_line", "tictactoe"])
def test_timings_say_when_agents_observed_and_acted(spec: str) -> None:
    """A turn's observations are there once the step before is over; its actions come after."""
    evidence = gk.rollout(spec, episodes=2, seed=0)
    frame = evidence.to_pandas("timings")
    for _, episode in frame.groupby("episode"):
        observed, acted, wall = (
            episode[name].to_numpy() for name in ("observed_ns", "acted_ns", "wall_ns")
        )
        assert observed[0] == 0
        assert (acted >= observed).all()
        assert (acted[:-1] + wall[:-1] == observed[1:]).all()
