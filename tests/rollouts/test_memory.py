"""Evidence in memory: the whole run, however long, and nothing that its environment still owns."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from gamekeeper.episodes import block
from gamekeeper.interface.recorded_env import capture_of, recorded_of
from gamekeeper.rollouts import memory
from gamekeeper.rollouts.memory import MemorySink
from tests.episodes.buffers import IDENTITY, Given, record


def env_of() -> Given:
    """One agent that sees the tick."""
    space = Box(-1, 9999, (1,), np.float32)
    return Given({"a": [np.array([t], np.float32) for t in range(700)]}, {"a": space})


@pytest.mark.parametrize(("most_turns", "block_bytes"), [(100, 1 << 20), (4096, 40)])
def test_long_runs_are_pressed_on_the_way(
    monkeypatch: pytest.MonkeyPatch, most_turns: int, block_bytes: int
) -> None:
    """The buffer stays short, batches stay small, and the evidence is the same."""
    whole = record(env_of(), 600)
    monkeypatch.setattr(memory, "MOST_TURNS", most_turns)
    monkeypatch.setattr(block, "BLOCK_BYTES", block_bytes)
    cut = record(env_of(), 600)
    assert whole.fingerprint == cut.fingerprint
    assert whole.agent_steps.equals(cut.agent_steps)
    assert cut.agent_steps.column("turn").num_chunks > 1


def test_frames_are_copies() -> None:
    """An environment may draw the next one into the same array."""
    sink = MemorySink()
    frame = np.zeros(3, np.uint8)
    sink.frame(0, 1, frame)
    frame[:] = 9
    sink.frame(0, 2, "text")
    assert sink.frames[0, 1].tolist() == [0, 0, 0]
    assert sink.frames[0, 2] == "text"


def test_evidence_can_be_taken_twice_and_has_each_episode_once() -> None:
    """What was handed over is gone from the sink."""
    sink = MemorySink()
    wrapped: Any = recorded_of(capture_of(Given({"a": [0]}, {"a": Discrete(2)}), sink=sink))
    for _ in range(2):
        wrapped.reset(seed=1)
        wrapped.step({"a": np.int64(0)})
        wrapped._capture.end_episode()
        assert sink.evidence(IDENTITY).episode_table.num_rows == 1
    assert sink.evidence(IDENTITY).episode_table.num_rows == 0


def test_manifest_says_what_was_declared() -> None:
    """Agents, spaces, level, terms, seed."""
    sink = MemorySink(terms=("delivery",))
    wrapped: Any = recorded_of(capture_of(Given({"a": [0]}, {"a": Discrete(2)}), sink=sink))
    wrapped.reset(seed=1)
    wrapped._capture.end_episode()
    manifest = sink.evidence(IDENTITY, run_seed=5).manifest
    assert manifest["agents"] == ["a"]
    assert manifest["terms"] == ["delivery"]
    assert (manifest["level"], manifest["seed"], manifest["contract"]) == ("full", 5, None)
    assert manifest["environment"] == IDENTITY
