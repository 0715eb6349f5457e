"""The written rules of `tag`; that they are mpe2's is in test_particles_mpe2."""

import math
from typing import Any

import numpy as np
import pytest

from gamekeeper.tasks.particles.tag import ADVERSARY, GOOD, STAGES, Tag

HUNTER, PREY = "adversary_0", "agent_0"


def tag(*places: tuple[float, float], hunters: int = 1, marks: Any = (), **arguments: Any) -> Tag:
    """Adversaries, then prey, at rest at these places, obstacles at those."""
    env = Tag(
        num_adversaries=hunters,
        num_good=len(places) - hunters,
        num_obstacles=len(marks),
        debug=True,
        **arguments,
    )
    env.reset(seed=0)
    s = env.memory.records
    s["x"][0], s["y"][0] = np.transpose(places)
    if marks:
        s["mark_x"][0], s["mark_y"][0] = np.transpose(marks)
    return env


def tick(env: Tag, action: int = 0) -> Any:
    """One tick in which all do the same."""
    return env.step(dict.fromkeys(env.agents, action))


def test_tag_has_adversaries_first() -> None:
    """R1: by their names; obstacles don't lie at the rim."""
    env = Tag(num_good=2, num_adversaries=2, num_obstacles=40, debug=True)
    assert env.possible_agents == ["adversary_0", "adversary_1", "agent_0", "agent_1"]
    env.reset(seed=1)
    assert (np.abs(env.places()[4:]) <= 0.9).all()


def test_tag_speeds_are_cut() -> None:
    """R2: prey is stronger and faster; nobody is faster than it may be."""
    env = tag((-3.0, 0.0), (3.0, 0.0))
    tick(env, 2)
    vx = env.memory.records["vx"][0]
    assert vx.tolist() == pytest.approx([0.1 * ADVERSARY[1], 0.1 * GOOD[1]])
    for _ in range(20):
        tick(env, 2)
    assert vx.tolist() == pytest.approx([ADVERSARY[2], GOOD[2]])


@pytest.mark.parametrize("stage", range(3))
def test_tag_prey_is_slower_at_first_stages(stage: int) -> None:
    """R2: force and top speed of prey are cut by the stage; adversaries are as ever."""
    env = tag((-3.0, 0.0), (3.0, 0.0), curriculum=True, curriculum_stage=stage)
    tick(env, 4)
    vy = env.memory.records["vy"][0].tolist()
    assert vy == pytest.approx([0.1 * ADVERSARY[1], 0.1 * GOOD[1] * STAGES[stage]])


def test_tag_obstacles_push_and_stay() -> None:
    """R2: who stands in an obstacle is pushed off it."""
    env = tag((0.1, 0.0), (3.0, 0.0), marks=[(0.0, 0.0)])
    tick(env)
    assert env.memory.records["vx"][0, 0] > 0
    assert env.places()[2].tolist() == [0.0, 0.0]


def test_tag_pays_catches_to_all_adversaries() -> None:
    """R3: ten for each overlap to each adversary, and minus ten to the prey that is overlapped."""
    env = tag((0.0, 0.0), (0.0, 0.1), (0.5, 0.5), (0.0, 0.05), (-0.5, -0.5), hunters=3)
    _, rewards, *_ = tick(env)
    assert list(rewards.values()) == [20.0, 20.0, 20.0, -20.0, 0.0]
    assert env.terms["adversary_2"] == {"catch": 20.0}
    assert env.info("agent_0") == {"collisions": 2}
    assert env.info("adversary_2") == {"collisions": 0}


@pytest.mark.parametrize(
    ("far", "price"),
    [(0.5, 0.0), (0.95, 0.5), (-0.95, 0.5), (1.0, 1.0), (1.5, math.e), (-9.0, 10.0)],
)
def test_tag_prey_pays_for_being_far_out(far: float, price: float) -> None:
    """R4: on each axis by itself; adversaries may go where they like."""
    env = tag((3.0, 3.0), (far, 0.0))
    _, rewards, *_ = tick(env)
    assert rewards == pytest.approx({HUNTER: 0.0, PREY: -price})
    env = tag((3.0, 3.0), (far, far))
    assert tick(env)[1][PREY] == pytest.approx(-2 * price)


def test_tag_shows_velocities_of_prey() -> None:
    """R5: places of all, velocities of other prey alone."""
    env = tag((0.0, 0.0), (2.0, 0.0), (0.0, 4.0), marks=[(0.0, -2.0)])
    seen = tick(env, 2)[0]
    assert seen[HUNTER].tolist() == pytest.approx(
        [0.3, 0, 0, 0, 0, -2, 2, 0, 0, 4, 0.4, 0, 0.4, 0], abs=1e-6
    )
    assert seen[PREY].tolist() == pytest.approx(
        [0.4, 0, 2, 0, -2, -2, -2, 0, -2, 4, 0.4, 0], abs=1e-6
    )


def test_tag_shows_the_nearest_where_few_are_shown() -> None:
    """R5: velocities go with the agents that are shown, zeros for adversaries; all of a shape."""
    env = tag((0.0, 0.0), (2.0, 0.0), (0.0, 4.0), num_agent_neighbors=2, hunters=2)
    seen = tick(env, 2)[0]
    assert {observation.shape for observation in seen.values()} == {(12,)}
    assert seen[HUNTER].tolist() == pytest.approx(
        [0.3, 0, 0, 0, 2, 0, 0, 4, 0, 0, 0.4, 0], abs=1e-6
    )


def test_tag_ends_when_all_prey_is_caught() -> None:
    """R6, R7: at once where it is asked for, else after its cycles."""
    env = tag((0.0, 0.0), (0.0, 0.05), terminate_on_success=True)
    assert tick(env)[2] == {HUNTER: True, PREY: True}
    assert env.endings[PREY] == "caught"
    env = tag((0.0, 0.0), (0.0, 0.05), (5.0, 5.0), terminate_on_success=True)
    assert not any(tick(env)[2].values())
    env = tag((0.0, 0.0), (0.0, 0.05), max_cycles=1, terminate_on_success=True)
    assert tick(env)[3] == {HUNTER: True, PREY: True}
    assert env.endings[HUNTER] == "horizon"


def test_tag_policies_chase_and_flee() -> None:
    """Adversaries of the reference catch lazy prey; fleeing prey is caught less."""
    caught = {}
    for prey in ("lazy", "reference"):
        env, total = Tag(debug=True, max_cycles=50), 0.0
        for seed in range(8):
            seen, infos = env.reset(seed=seed)
            while env.agents:
                policy = {a: env.policies["reference" if a != PREY else prey] for a in env.agents}
                rng = np.random.default_rng(0)
                actions = {a: act(seen[a], a, infos[a], rng) for a, act in policy.items()}
                seen, rewards, _, _, infos = env.step(actions)
                total += rewards[HUNTER]
        caught[prey] = total
    assert caught["lazy"] > 200
    assert caught["reference"] < caught["lazy"] / 2
