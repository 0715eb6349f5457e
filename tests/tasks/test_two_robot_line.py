import functools
from types import SimpleNamespace

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import max_cycles_test, parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils.conversions import parallel_to_aec

import gamekeeper.tasks  # noqa: F401  # registers the tasks
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import SpecError
from gamekeeper.interface.contract_draft import agent_specs, draft_contract
from gamekeeper.tasks.knobs import LABELS
from gamekeeper.tasks.two_robot_line import KNOBS, TwoRobotLine
from tests.tasks.disturbed import rows

HARD = dict.fromkeys(KNOBS, 0.5) | {"observation_delay": 1, "latency": 1, "slowness": 1}
HARD["held_out"] = 1.0


def after(*joint, **arguments):
    """The line after the joint actions of picker and carrier, and what the last step gave."""
    env = TwoRobotLine(**arguments)
    env.reset(seed=3)
    given = [env.step({"picker": p, "carrier": c}) for p, c in joint]
    return env, given[-1] if given else None


def test_line_conforms_to_pettingzoo():
    """PettingZoo's own tests pass on the registered task, and nothing warns."""
    make = functools.partial(pettingzoo.make, "parallel", "gamekeeper/two_robot_line-v0")
    parallel_api_test(make(), num_cycles=100)
    parallel_seed_test(make, num_cycles=50)
    env = TwoRobotLine()
    env.reset(seed=0)
    assert env.state_space.contains(env.state())


def test_line_starts_robots_at_its_ends():
    """R1: picker in cell 0, carrier in the last cell, whatever the seed; observed in the space."""
    for n in (2, 5, 9):
        env = TwoRobotLine(n=n)
        for seed in range(3):
            seen, infos = env.reset(seed=seed)
            assert [0, n - 1] == [int(seen[a][0]) for a in ("picker", "carrier")]
            assert [0, n - 1] == [infos[a]["position"] for a in ("picker", "carrier")]
            assert all(env.observation_space(a).contains(o) for a, o in seen.items())


@pytest.mark.parametrize(
    ("joint", "cells"),
    [([(1, 1)], [0, 4]), ([(0, 2)], [0, 4]), ([(2, 0)], [1, 3]), ([(2, 1), (0, 1)], [0, 4])],
)
def test_line_moves_both_at_once_and_stops_at_its_ends(joint, cells):
    """R2: one cell down, nowhere, one cell up, never off the line."""
    env, (_, rewards, terminated, truncated, _) = after(*joint)
    assert cells == env.state().tolist()
    assert rewards == {"picker": 0.0, "carrier": 0.0}
    assert not any([*terminated.values(), *truncated.values()])


@pytest.mark.parametrize("joint", [[(2, 0), (2, 0)], [(2, 1)] * 4])
def test_line_pays_and_ends_both_when_they_meet(joint):
    """R3: 1.0 each and terminated with the reason "met", with nobody left."""
    env, (_, rewards, terminated, truncated, _) = after(*joint)
    assert rewards == {"picker": 1.0, "carrier": 1.0}
    assert env.terms == {"picker": {"meeting": 1.0}, "carrier": {"meeting": 1.0}}
    assert env.endings == {"picker": "met", "carrier": "met"}
    assert all(terminated.values())
    assert not any(truncated.values())
    assert env.agents == []


def test_line_lets_robots_pass_each_other():
    """R4: who swaps cells hasn't met."""
    env, (_, rewards, terminated, _, _) = after((2, 1), (2, 0), (2, 0))
    assert env.state().tolist() == [3, 2]
    assert not any(terminated.values())
    assert rewards == {"picker": 0.0, "carrier": 0.0}


def test_line_truncates_at_its_horizon():
    """R5: both are truncated after the contract's 200 ticks, or those given."""
    assert rows(TwoRobotLine(), 0, "lazy")[-1][3:5] == (
        {"picker": False, "carrier": False},
        {"picker": True, "carrier": True},
    )
    assert len(rows(TwoRobotLine(), 0, "lazy")) == 201
    env, _ = after((1, 1), (1, 1), horizon=2)
    assert env.endings == {"picker": "horizon", "carrier": "horizon"}


@pytest.mark.parametrize("n", range(2, 12))
def test_line_reference_solves_every_length(n):
    """The reference policy meets on every line; the greedy one where the cells are odd."""
    assert rows(TwoRobotLine(n=n), 0)[-1][2] == {"picker": 1.0, "carrier": 1.0}
    met = rows(TwoRobotLine(n=n), 0, "greedy")[-1][2]["picker"] == 1.0
    assert met == (n % 2 == 1)


@pytest.mark.parametrize("n", [1, 0, -3, 2.0, True])
def test_line_refuses_to_be_too_short(n):
    """A line of less than two cells names its argument."""
    with pytest.raises(SpecError, match="2 or more"):
        TwoRobotLine(n=n)


def test_line_offers_the_knobs_that_its_contract_declares():
    """The contract names every knob with its label; at their ideals nothing is disturbed."""
    declared = TwoRobotLine().declared.knobs
    assert {name: LABELS[name] for name in KNOBS} == {n: k.label for n, k in declared.items()}
    ideal = TwoRobotLine(**{name: knob.ideal for name, knob in declared.items()})
    assert rows(TwoRobotLine(), 5) == rows(ideal, 5)
    with pytest.raises(SpecError, match="occlusion"):
        TwoRobotLine(occlusion=0.1)


@pytest.mark.parametrize("name", ["observation_noise", "observation_delay", "odometry_drift"])
def test_line_sensor_knob_changes_what_is_seen_alone(name):
    """Under the same actions the state stays as it was, and what is seen doesn't."""
    sound = rows(TwoRobotLine(n=9), 1, "lazy", 30)
    if name != "observation_noise":  # those who stand still see the same later, and don't drift
        sound = rows(TwoRobotLine(n=8), 1, "greedy", 20)
        faulty = rows(TwoRobotLine(n=8, **{name: {"picker": HARD[name]}}), 1, "greedy", 20)
    else:
        faulty = rows(TwoRobotLine(n=9, **{name: {"picker": HARD[name]}}), 1, "lazy", 30)
    assert [row[-1] for row in sound] == [row[-1] for row in faulty]
    for agent, is_same in (("picker", False), ("carrier", True)):
        seen = [[row[1][agent] for row in episode[1:]] for episode in (sound, faulty)]
        assert (seen[0] == seen[1]) is is_same


@pytest.mark.parametrize("name", ["actuator_slip", "actuator_dropout", "latency", "slowness"])
def test_line_motion_knob_changes_its_robot_alone(name):
    """The robot with the knob moves otherwise, the other as before, and what is seen is true."""
    sound = rows(TwoRobotLine(n=20), 1, "greedy", 6)
    faulty = rows(TwoRobotLine(n=20, **{name: {"carrier": HARD[name]}}), 1, "greedy", 6)
    assert [row[-1][0] for row in sound] == [row[-1][0] for row in faulty]
    assert [row[-1][1] for row in sound] != [row[-1][1] for row in faulty]
    assert all(row[1]["carrier"] == [row[-1][1]] for row in faulty[1:])


def test_line_held_out_starts_elsewhere():
    """In held-out layouts the robots start in any two cells that differ."""
    env = TwoRobotLine(held_out=1.0)
    starts = set()
    for seed in range(60):
        env.reset(seed=seed)
        starts.add(tuple(env.state().tolist()))
    assert len(starts) > 10
    assert all(a != b for a, b in starts)


def test_line_stays_in_its_spaces_under_all_knobs():
    """With everything wrong at once observations are still of their space, and seeds settle all."""
    env = TwoRobotLine(n=7, horizon=40, **HARD)
    seen, infos = env.reset(seed=4)
    while env.agents:
        actions = {a: env.policies["greedy"](seen[a], a, infos[a], None) for a in env.agents}
        seen, *_, infos = env.step(actions)
        assert all(env.observation_space(a).contains(o) for a, o in seen.items())
    assert rows(env, 9) == rows(TwoRobotLine(n=7, horizon=40, **HARD), 9)


def test_line_renders():
    """As text it shows both robots, and a star where they met; as an array a picture of cells."""
    env, _ = after(render_mode="ansi")
    assert env.render() == "p...c"
    env, _ = after((2, 0), (2, 0), render_mode="ansi")
    assert env.render() == "..*.."
    render_test(lambda **mode: parallel_to_aec(TwoRobotLine(**mode)), {})
    env, _ = after(render_mode="rgb_array")
    assert env.render().shape == (24, 120, 3)
    assert env.render().dtype == np.uint8
    assert after()[0].render() is None


def test_line_contract_fits_and_leaves_nothing_open():
    """The contract declares what the draft sees, and answers every question."""
    env = TwoRobotLine()
    drafted = draft_contract(env)
    assert (env.declared.name, env.declared.api) == (drafted.name, drafted.api)
    assert open_questions(env.declared, agent_specs(env, env.declared)) == ()


def test_line_ends_after_its_cycles():
    """PettingZoo's own test of time limits passes on a line too long to meet on."""

    def make(max_cycles):
        return TwoRobotLine(n=20, horizon=max_cycles)

    max_cycles_test(SimpleNamespace(parallel_env=make, env=lambda **n: parallel_to_aec(make(**n))))
