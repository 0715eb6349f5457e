"""The written rules of `reference` and `speaker_listener`; that they are mpe2's is elsewhere."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.tasks.particles.reference import COLORS, MARKS, WORDS, Reference
from gamekeeper.tasks.particles.speaker_listener import COLORS as SPOKEN
from gamekeeper.tasks.particles.speaker_listener import SpeakerListener

PLACES = [(1.0, 0.0), (0.0, 2.0), (-3.0, 0.0)]
LISTENER = [(4.0, 4.0), (0.0, 0.0)]


def world(kind: Any, agents: Any, goal: Any, **arguments: Any) -> Any:
    """Agents at rest at these places, three landmarks, these goals."""
    env = kind(debug=True, **arguments)
    env.reset(seed=0)
    s = env.memory.records
    s["x"][0], s["y"][0] = np.transpose(agents)
    s["mark_x"][0], s["mark_y"][0] = np.transpose(PLACES)
    s["goal"][0] = goal
    return env


def test_reference_goals_are_random() -> None:
    """R1: each of three landmarks is a goal of either agent."""
    env, goals = Reference(debug=True), set()
    for seed in range(60):
        env.reset(seed=seed)
        goals.add(tuple(env.memory.records["goal"][0].tolist()))
    assert len(goals) == MARKS**2


def test_reference_words_are_heard_after_the_tick() -> None:
    """R2, R3, R5: an action is word and move; the other hears the word, once."""
    env = world(Reference, [(0.0, 0.0), (0.0, 0.0)], (0, 2))
    seen = env.step({"agent_0": 7 * 5 + 2, "agent_1": 0})[0]
    assert seen["agent_1"][11:].tolist() == np.eye(WORDS)[7].tolist()
    assert seen["agent_0"][11:].tolist() == np.eye(WORDS)[0].tolist()
    assert seen["agent_0"][:2].tolist() == [0.5, 0.0]
    assert seen["agent_0"][8:11] == pytest.approx(COLORS[0])
    assert seen["agent_1"][8:11] == pytest.approx(COLORS[2])
    assert seen["agent_0"][2:8].tolist() == np.ravel(PLACES).tolist()
    seen = env.step({"agent_0": 3 * 5, "agent_1": 0})[0]
    assert seen["agent_1"][11:].tolist() == np.eye(WORDS)[3].tolist()


def test_reference_continuous_words_are_numbers() -> None:
    """R3: five numbers for the move, right minus left and up minus down; ten for the word."""
    env = world(Reference, [(0.0, 0.0), (0.0, 0.0)], (0, 0), continuous_actions=True)
    said = np.linspace(0.0, 0.9, 15).astype(np.float32)
    said[:5] = [1.0, 0.25, 0.75, 0.5, 0.0]
    seen = env.step({"agent_0": said, "agent_1": np.zeros(15, np.float32)})[0]
    assert seen["agent_1"][11:].tolist() == said[5:].tolist()
    assert seen["agent_0"][:2].tolist() == [0.25, -0.25]


def test_reference_pays_for_the_goal_that_an_agent_knows() -> None:
    """R4: how far the other is from it, by its part, and the mean of both."""
    env = world(Reference, [(0.0, 0.0), (4.0, 0.0)], (0, 1), local_ratio=0.25)
    _, rewards, *_ = env.step({"agent_0": 0, "agent_1": 0})
    assert rewards == pytest.approx({"agent_0": -2.5 * 0.75 - 0.75, "agent_1": -2.5 * 0.75 - 0.5})
    assert env.terms["agent_1"] == pytest.approx({"team": -1.875, "goal": -0.5})
    assert env.info("agent_0") == {"distance": 2.0}
    assert env.info("agent_1") == {"distance": 3.0}


@pytest.mark.parametrize("kind", [Reference, SpeakerListener])
def test_speakers_are_truncated(kind: Any) -> None:
    """R6, R5: both, after so many cycles."""
    env = kind(debug=True, max_cycles=2)
    env.reset(seed=0)
    ends = [env.step(dict.fromkeys(env.agents, 0))[3] for _ in range(2)]
    assert [set(end.values()) for end in ends] == [{False}, {True}]
    assert set(env.endings.values()) == {"horizon"}


def test_speaker_listener_agents_differ() -> None:
    """R1, R4: spaces and what is seen; the speaker never moves."""
    env = world(SpeakerListener, LISTENER, 1)
    assert [env.action_space(a).n for a in env.possible_agents] == [3, 5]
    seen = env.step({"speaker_0": 2, "listener_0": 4})[0]
    assert seen["speaker_0"] == pytest.approx(SPOKEN[1])
    assert seen["listener_0"][:2].tolist() == [0.0, 0.5]
    assert seen["listener_0"][2:8].tolist() == np.ravel(PLACES).tolist()
    assert seen["listener_0"][8:].tolist() == [0.0, 0.0, 1.0]
    for _ in range(3):
        env.step({"speaker_0": 1, "listener_0": 2})
    assert env.places()[0].tolist() == [4.0, 4.0]


def test_speaker_listener_words_may_be_numbers() -> None:
    """R2: as many as there are words."""
    env = world(SpeakerListener, LISTENER, 0, continuous_actions=True)
    said = np.array([0.5, 0.25, 1.0], np.float32)
    seen = env.step({"speaker_0": said, "listener_0": np.zeros(5, np.float32)})[0]
    assert seen["listener_0"][8:].tolist() == said.tolist()


def test_speaker_listener_pays_both_the_square() -> None:
    """R3: minus the square of how far the listener is from the goal."""
    env = world(SpeakerListener, LISTENER, 1)
    _, rewards, _, _, infos = env.step({"speaker_0": 0, "listener_0": 0})
    assert rewards == {"speaker_0": -4.0, "listener_0": -4.0}
    assert infos["listener_0"] == {"distance": 2.0}
