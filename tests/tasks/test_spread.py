"""The written rules of `spread`; that they are mpe2's is in test_particles_mpe2."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.tasks.particles.spread import COVERED, SIZE, Spread

FAR = [(-5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)]


def spread(*places: tuple[float, float], marks: Any = None, **arguments: Any) -> Spread:
    """Agents at rest at these places, landmarks at those, or far away."""
    n = len(places)
    env = Spread(N=n, debug=True, **arguments)
    env.reset(seed=0)
    s = env.memory.records
    s["x"][0], s["y"][0] = np.transpose(places)
    s["mark_x"][0], s["mark_y"][0] = np.transpose(FAR[:n] if marks is None else marks)
    return env


def tick(env: Spread, *actions: int) -> Any:
    """One tick; nothing is done where nothing is said."""
    chosen = actions or (0,) * len(env.agents)
    return env.step(dict(zip(env.agents, chosen, strict=True)))


def test_spread_begins_at_rest_within_the_square() -> None:
    """R1: places in [-1, 1], other ones for each seed; nobody moves."""
    env, seen = Spread(debug=True), set()
    for seed in range(10):
        env.reset(seed=seed)
        s = env.memory.records[0]
        for name in ("x", "y", "mark_x", "mark_y"):
            assert (np.abs(s[name]) <= 1.0).all()
        assert not s["vx"].any()
        assert not s["vy"].any()
        seen.add(s["x"].tobytes())
    assert len(seen) == 10


@pytest.mark.parametrize(
    ("action", "way"), [(0, (0, 0)), (1, (-1, 0)), (2, (1, 0)), (3, (0, -1)), (4, (0, 1))]
)
def test_spread_moves_push(action: int, way: tuple[int, int]) -> None:
    """R2: a move gives a velocity of 0.5, which moves the agent in the next tick, then less."""
    env = spread((0.0, 0.0))
    tick(env, action)
    assert env.places()[0].tolist() == [0.0, 0.0]
    tick(env)
    assert env.places()[0].tolist() == pytest.approx([0.05 * way[0], 0.05 * way[1]])
    s = env.memory.records[0]
    assert [s["vx"][0], s["vy"][0]] == pytest.approx([0.375 * way[0], 0.375 * way[1]])


def test_spread_agents_push_each_other_and_no_landmark() -> None:
    """R2: who overlaps is pushed apart; a landmark underneath does nothing."""
    env = spread((-0.1, 0.0), (0.1, 0.0), marks=[(-0.1, 0.01), (9.0, 9.0)])
    tick(env)
    vx, vy = env.memory.records["vx"][0], env.memory.records["vy"][0]
    assert vx[0] < 0 < vx[1]
    assert vx[0] == -vx[1]
    assert not vy.any()


def test_spread_pays_for_landmarks_and_overlaps() -> None:
    """R3, R4: all pay for what is far, those who overlap for it, by their parts."""
    places, marks = [(0.0, 0.0), (0.1, 0.0), (3.0, 4.0)], [(0.0, 0.0), (3.0, 4.0), (3.0, 7.0)]
    env = spread(*places, marks=marks, local_ratio=0.25)
    _, rewards, *_ = tick(env)
    assert list(rewards.values()) == pytest.approx([-2.25 - 0.25, -2.25 - 0.25, -2.25])
    assert env.terms["agent_0"] == pytest.approx({"cover": -2.25, "collision": -0.25})
    assert [env.info(a) for a in env.agents] == [
        {"collisions": 1, "uncovered": 1},
        {"collisions": 1, "uncovered": 1},
        {"collisions": 0, "uncovered": 1},
    ]


def test_spread_forgives_overlaps_at_the_first_stage() -> None:
    """R4: at stage 0 of a curriculum only landmarks count, at stage 1 all does."""
    for stage, paid in ((0, 0.0), (1, -0.5)):
        env = spread((0.0, 0.0), (2 * SIZE - 0.01, 0.0), curriculum=True, curriculum_stage=stage)
        tick(env)
        assert env.terms["agent_0"].get("collision", 0.0) == paid


def test_spread_shows_all_from_where_one_stands() -> None:
    """R5: velocity, place, landmarks, others, and two zeros for each other's silence."""
    env = spread((0.5, 0.0), (-0.5, 0.25), marks=[(1.0, 1.0), (0.0, -1.0)])
    seen = tick(env)[0]["agent_1"]
    expected = [0, 0, -0.5, 0.25, 1.5, 0.75, 0.5, -1.25, 1.0, -0.25, 0, 0]
    assert seen.tolist() == pytest.approx(expected)


def test_spread_shows_the_nearest_where_few_are_shown() -> None:
    """R5: the nearest first, the lower number of two as near, zeros where there are no more."""
    env = spread(
        (0.0, 0.0),
        (2.0, 0.0),
        (0.0, 1.0),
        num_agent_neighbors=1,
        num_landmark_neighbors=4,
        marks=[(0.0, -3.0), (3.0, 0.0), (0.0, -2.0)],
    )
    seen = tick(env)[0]["agent_0"]
    marks = [0, -2, 0, -3, 3, 0, 0, 0]
    assert seen.tolist() == pytest.approx([0, 0, 0, 0, *marks, 0, 1, 0, 0], abs=1e-6)


def test_spread_truncates_at_its_cycles() -> None:
    """R6: everybody, for the reason "horizon", having seen the last state."""
    env = spread((0.0, 0.0), max_cycles=2)
    assert not any(tick(env)[3].values())
    seen, _, terminated, truncated, _ = tick(env)
    assert truncated == {"agent_0": True}
    assert terminated == {"agent_0": False}
    assert env.endings == {"agent_0": "horizon"}
    assert seen["agent_0"].shape == (6,)


@pytest.mark.parametrize("is_asked", [True, False])
def test_spread_ends_when_all_is_covered(is_asked: bool) -> None:
    """R7: where it is asked for, and not in the last tick, which truncates."""
    for cycles, ends in ((9, is_asked), (1, False)):
        near = [(0.0, COVERED - 0.01)]
        env = spread((0.0, 0.0), marks=near, terminate_on_success=is_asked, max_cycles=cycles)
        _, _, terminated, truncated, _ = tick(env)
        assert terminated == {"agent_0": ends}
        assert truncated == {"agent_0": cycles == 1}
        if ends:
            assert env.endings == {"agent_0": "covered"}
