"""Worlds of ours and of mpe2 in the same state, played with the same actions."""

from typing import Any

import numpy as np
from mpe2 import simple_reference_v3, simple_speaker_listener_v4, simple_spread_v3, simple_tag_v3

from gamekeeper.tasks.particles.reference import Reference
from gamekeeper.tasks.particles.speaker_listener import SpeakerListener
from gamekeeper.tasks.particles.spread import Spread
from gamekeeper.tasks.particles.tag import Tag

PAIRS = {
    "spread": (Spread, simple_spread_v3),
    "tag": (Tag, simple_tag_v3),
    "reference": (Reference, simple_reference_v3),
    "speaker_listener": (SpeakerListener, simple_speaker_listener_v4),
}


def put(records: Any, world: Any) -> None:
    """Our record says what mpe2's world says."""
    for i, agent in enumerate(world.agents):
        records["x"][0, i], records["y"][0, i] = agent.state.p_pos
        records["vx"][0, i], records["vy"][0, i] = agent.state.p_vel
    for k, mark in enumerate(world.landmarks):
        records["mark_x"][0, k], records["mark_y"][0, k] = mark.state.p_pos
    if "goal" in records.dtype.names:
        goals = [world.landmarks.index(a.goal_b) for a in world.agents if a._goal_b is not None]
        records["goal"][0] = goals if records["goal"].ndim > 1 else goals[0]


def differences(
    name: str, *, steps: int, seed: int, debug: bool, crowd: float = 1.0, **arguments: Any
) -> tuple[float, float]:
    """The largest difference of observations and states, and of rewards, in so many steps.

    Rosters and flags must be equal; an AssertionError says which aren't.

    Args:
        name: of our task.
        steps: ticks, of as many episodes as they take.
        seed: of places and actions.
        debug: ours are played in plain Python.
        crowd: agents begin that much nearer to each other, so that they touch.
        **arguments: of both.
    """
    ours_class, module = PAIRS[name]
    theirs = module.parallel_env(**arguments)
    ours = ours_class(**arguments, debug=debug)
    rng = np.random.default_rng(seed)
    for i, agent in enumerate(ours.possible_agents):
        theirs.action_space(agent).seed(seed * 100 + i)
    seen_off = paid_off = 0.0
    played = 0
    theirs.reset(seed=seed)
    while played < steps:
        theirs.reset()
        ours.reset(seed=int(rng.integers(1 << 30)))
        world = theirs.unwrapped.world
        for agent in world.agents:
            agent.state.p_pos = agent.state.p_pos * crowd
        put(ours.memory.records, world)
        while theirs.agents:
            assert theirs.agents == ours.agents
            actions = {a: theirs.action_space(a).sample() for a in theirs.agents}
            told, given = theirs.step(actions), ours.step(actions)
            played += 1
            assert (told[2], told[3]) == (given[2], given[3])
            assert list(told[0]) == list(given[0])
            for agent, seen in told[0].items():
                assert seen.dtype == given[0][agent].dtype
                seen_off = max(seen_off, _off(seen, given[0][agent]))
                paid_off = max(paid_off, abs(told[1][agent] - given[1][agent]))
            seen_off = max(seen_off, _off(theirs.state(), ours.state()))
    return seen_off, paid_off


def _off(one: Any, other: Any) -> float:
    assert one.shape == other.shape
    return float(np.abs(one.astype(float) - other).max())
