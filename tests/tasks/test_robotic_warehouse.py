import functools

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import gamekeeper.tasks  # noqa: F401  # registers the tasks
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import ActionError, SpecError
from gamekeeper.interface.contract_draft import agent_specs
from gamekeeper.kernels.batch import Batch
from gamekeeper.tasks.robotic_warehouse.robotic_warehouse import (
    RoboticWarehouse,
    robotic_warehouse_kernel,
)
from gamekeeper.tasks.robotic_warehouse.robotic_warehouse_floor import OWN, SENSED

NOOP, FORWARD, LEFT, RIGHT, TOGGLE = range(5)
ARROWS = {"^": 0, "v": 1, "<": 2, ">": 3, "A": 0, "V": 1, "L": 2, "R": 3}
OPEN = "\n".join(["......"] * 5 + ["g.x.xx"])


def scene(*rows, layout=OPEN, wanted=(), **arguments):
    """A warehouse that looks like these rows, as `ansi` has them; robots are numbered in order.

    `wanted`: (x, y) of carried shelves that are requested.
    """
    robots = [
        (x, y, letter)
        for y, row in enumerate(rows)
        for x, letter in enumerate(row)
        if letter in ARROWS
    ]
    told = {"request_queue_size": 1, **arguments}
    env = RoboticWarehouse(
        layout=layout, n_agents=len(robots), render_mode="ansi", debug=True, **told
    )
    env.reset(seed=1)
    s, t = env.memory.records[0], env.tables[0]
    width = len(rows[0])
    for name in ("codes", "robots"):
        s[name][:] = 0
    for y, row in enumerate(rows):
        for x, letter in enumerate(row):
            stands = 5 * ".xX".find(letter) if letter in "xX" else 0
            carried = 5 + 5 * ((x, y) in wanted) if letter in "AVLR" else 0
            s["codes"][t["cells"][y * width + x]] = max(stands, carried)
    for i, (x, y, letter) in enumerate(robots):
        cell = t["cells"][y * width + x]
        s["robots"][cell], s["codes"][cell] = i + 1, s["codes"][cell] + 1 + ARROWS[letter]
        s["cell"][i] = s["to"][i] = cell
        s["facing"][i], s["load"][i] = ARROWS[letter], letter in "AVLR"
    return env


def after(env, *joint):
    """The floor after the joint actions, one digit a robot, and what the last step gave."""
    for actions in joint:
        given = env.step({f"robot_{i}": int(action) for i, action in enumerate(actions)})
    return env.render().split("\n"), given


def alike(rows, *, layout=OPEN):
    """The rows as `ansi` shows them: an empty cell by what belongs there."""
    floor = layout.replace("x", "_").split("\n")
    return [
        "".join(kind if letter == "." else letter for letter, kind in zip(row, kinds, strict=True))
        for row, kinds in zip(rows, floor, strict=True)
    ]


EMPTY = ["......"] * 4


def moved(rows, actions, expected):
    """Whether the first rows of the open floor look like this after one tick."""
    given = [*rows, *["......"] * (6 - len(rows))]
    wanted = [*expected, *["......"] * (6 - len(expected))]
    return after(scene(*given), actions)[0] == alike(wanted)


def test_robotic_warehouse_conforms_to_pettingzoo():
    """PettingZoo's own tests pass on the registered task, and its contract leaves nothing open."""
    make = functools.partial(
        pettingzoo.make, "parallel", "gamekeeper/robotic_warehouse-v0", debug=True
    )
    parallel_api_test(make(), num_cycles=60)
    parallel_seed_test(make, num_cycles=30)
    env = RoboticWarehouse(debug=True)
    env.reset(seed=0)
    assert env.state_space.contains(env.state())
    assert open_questions(env.declared, agent_specs(env, env.declared)) == ()


def test_robotic_warehouse_begins_with_shelves_in_their_places():
    """R1: every place has its shelf, robots stand apart, so many shelves are requested."""
    for seed in range(5):
        env = RoboticWarehouse(layout="small", n_agents=7, request_queue_size=3, debug=True)
        env.reset(seed=seed)
        robots, facing, loads, shelves = env.state()
        assert list(range(1, 8)) == sorted(robots[robots > 0])
        assert (shelves > 0).sum() == len(env.tables[0]["homes"])
        assert (shelves == 2).sum() == 3
        assert loads.sum() == 0
        assert ((facing > 0) == (robots > 0)).all()


@pytest.mark.parametrize(
    ("robot", "actions", "expected"),
    [("^", "2", "<"), ("^", "3", ">"), ("<", "2", "v"), ("v", "3", "<"), (">", "23", ">")],
)
def test_robotic_warehouse_turns(robot, actions, expected):
    """R3: 2 turns left, 3 turns right, 0 does nothing."""
    env = scene("......", f"..{robot}...", *EMPTY)
    assert alike(["......", f"..{expected}...", *EMPTY]) == after(env, "0", *actions)[0]


def test_robotic_warehouse_takes_and_puts_shelves_down_in_places():
    """R3: a shelf is taken, carried, not put down on a highway, and put down in a place."""
    env = scene(*EMPTY, "..v...", "..x...")
    steps = ["1", "4", "3", "1", "4", "1", "1", "4", "2", "1"]
    shown = [after(env, step)[0][5] for step in steps]
    assert shown[:2] == ["g.v.__", "g.V.__"]
    assert shown[3:6] == ["gL_.__", "gL_.__", "L._.__"]
    env = scene(*EMPTY, "......", "...Rx.")
    assert after(env, "1")[0][5] == "g._Rx_"  # R4: a shelf stands there
    env = scene(*EMPTY, "......", "...R..")
    assert after(env, "1")[0][5] == "g._.R_"
    assert after(env, "4", "0")[0][5] == "g._.>_"
    assert after(env, "3", "3", "1")[0][5] == "g._<x_"


def test_robotic_warehouse_has_walls():
    """R4: forward into a wall goes nowhere."""
    assert moved(["^....>"], "11", ["^....>"])


def test_robotic_warehouse_robots_follow_loaded_ones():
    """R4: a loaded robot goes where a carried shelf was, not where one stands over a robot."""
    env = scene(*EMPTY, "......", "..RR..")
    assert after(env, "11")[0][5] == "g._RR_"
    env = scene(*EMPTY, "......", "...R>.", wanted=())
    s, t = env.memory.records[0], env.tables[0]
    s["codes"][t["cells"][34]] += 5
    assert after(env, "11")[0][5] == "g._Rx>"  # the shelf over robot 1 stands there


@pytest.mark.parametrize(
    ("rows", "actions", "expected"),
    [
        ([".>>>.."], "111", ["..>>>."]),  # a chain
        ([".>>>.."], "110", [".>>>.."]),  # nobody follows one that stays
        ([".>>v.."], "110", [".>>v.."]),
        ([".><..."], "11", [".><..."]),  # a swap
        ([".>....", ".^...."], "11", [".^>...", "......"]),  # into the cell of one that leaves
    ],
)
def test_robotic_warehouse_moves_chains(rows, actions, expected):
    """R5: chains move whole, swaps don't."""
    assert moved(rows, actions, expected)


def test_robotic_warehouse_turns_rings():
    """R5: each robot of a ring goes where the next one was."""
    env = scene(".>v...", ".^<...", *EMPTY)
    after(env, "1111")
    assert env.state()[0][:2, 1:3].tolist() == [[3, 1], [4, 2]]


def test_robotic_warehouse_lets_the_longest_chain_go_first():
    """R5, R6: of two that want one cell, who has more behind it; else the lowest number."""
    env = scene("...v..", ">>.<..", *EMPTY)
    shown = after(env, "1111")[0]
    assert shown[:2] == ["...v..", ".>><.."]
    env = scene("......", ".>.<..", *EMPTY)
    assert after(env, "11")[0][1] == "..><.."
    env = scene("..v...", ".>.<..", *EMPTY)
    assert after(env, "111")[0][:2] == ["......", ".>v<.."]


def test_robotic_warehouse_ring_goes_before_a_chain_into_it():
    """R5: a ring turns, whoever wants to join it and however long its chain is."""
    env = scene(">>>v..", "..^<..", *EMPTY)
    numbers = env.state()[0]
    assert numbers[0, :4].tolist() == [1, 2, 3, 4]
    after(env, "111111")
    assert env.state()[0][:2].tolist() == [[1, 2, 5, 3, 0, 0], [0, 0, 6, 4, 0, 0]]


@pytest.mark.parametrize(
    ("reward_type", "paid"), [("individual", [0, 1]), ("global", [1, 1]), ("two_stage", [0, 0.5])]
)
def test_robotic_warehouse_pays_deliveries(reward_type, paid):
    """R7, R8: a requested shelf on a goal is delivered once, and another one is requested."""
    env = scene("...^..", *EMPTY, ".Lx.xx", wanted=[(1, 5)], reward_type=reward_type)
    _, (_, rewards, *_) = after(env, "01")
    assert paid == list(rewards.values())
    assert (env.state()[3] == 2).sum() == 1
    assert env.state()[3][5, 0] == 1  # the delivered one isn't requested any more
    _, (_, rewards, *_) = after(env, "00")
    assert list(rewards.values()) == [0, 0]


def test_robotic_warehouse_pays_two_stages():
    """R8: half for the goal, half for putting the shelf back, once each."""
    env = scene(*EMPTY, "......", ".Lx.xx", wanted=[(1, 5)], reward_type="two_stage")
    paid = [after(env, step)[1][1]["robot_0"] for step in "132111"]
    env.memory.records["codes"][0, env.tables[0]["cells"][32]] = 0
    s, t = env.memory.records[0], env.tables[0]
    assert paid[0] == 0.5
    assert sum(paid) == 0.5
    place = t["homes"][0]
    s["codes"][s["cell"][0]], s["robots"][s["cell"][0]] = 0, 0
    s["cell"][0] = s["to"][0] = place
    s["codes"][place], s["robots"][place] = 5 + 1 + s["facing"][0], 1
    assert [after(env, step)[1][1]["robot_0"] for step in "444"] == [0.5, 0, 0]


def test_robotic_warehouse_shows_what_robots_sense():
    """R9: itself, then each cell around with robot, direction, shelf, request."""
    env = scene(*EMPTY, "...v>.", "..x.X.", sensor_range=1)
    (seen, *_) = after(env, "00")[1]
    mine = seen["robot_0"]
    assert mine[:OWN].tolist() == [3, 4, 0, 0, 1, 0, 0, 1]
    cells = mine[OWN:].reshape(3, 3, SENSED)
    assert cells[1, 1].tolist() == [1, 0, 1, 0, 0, 0, 0]
    assert cells[1, 2].tolist() == [1, 0, 0, 0, 1, 0, 0]
    assert cells[2, 0].tolist() == [0, 1, 0, 0, 0, 1, 0]
    assert cells[2, 2].tolist() == [0, 1, 0, 0, 0, 1, 1]
    scaled = scene(*EMPTY, "...v>.", "..x.X.", normalised_coordinates=True)
    seen = after(scaled, "00")[1][0]["robot_0"]
    assert seen[:2].tolist() == np.array([3 / 5, 4 / 5], np.float32).tolist()


def test_robotic_warehouse_ends():
    """R10, R11: long without a delivery terminates, the time limit truncates, together or not."""
    env = RoboticWarehouse(max_inactivity_steps=3, max_steps=9, debug=True)
    env.reset(seed=0)
    given = [env.step(dict.fromkeys(env.agents, NOOP)) for _ in range(3)]
    assert [set(g[2].values()) for g in given] == [{False}, {False}, {True}]
    assert set(env.endings.values()) == {"inactivity"}
    env = RoboticWarehouse(max_steps=2, debug=True)
    env.reset(seed=0)
    given = [env.step(dict.fromkeys(env.agents, NOOP)) for _ in range(2)]
    assert [set(g[3].values()) for g in given] == [{False}, {True}]
    assert set(given[-1][2].values()) == {False}
    assert set(env.endings.values()) == {"horizon"}


def test_robotic_warehouse_compiled_is_plain():
    """Compiled and plain copies have the same bytes, over many episodes."""
    kernel = robotic_warehouse_kernel(
        layout=".x.x\nxg.x\n.xx.", n_agents=5, max_steps=40, max_inactivity_steps=15
    )
    plain, fast = (Batch(kernel, 6, seed=5, debug=debug) for debug in (True, False))
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(plain.reset(), fast.reset())
    for _ in range(120):
        actions = rng.choice(5, (6, 5), p=[0.05, 0.6, 0.1, 0.1, 0.15])
        for mine, theirs in zip(plain.step(actions), fast.step(actions), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert plain.snapshot() == fast.snapshot()


def test_robotic_warehouse_leaves_no_traces_of_a_tick():
    """Equal floors are equal bytes: what a tick works with is as it was after it."""
    kernel = RoboticWarehouse(layout="tiny", n_agents=9, debug=True).kernel
    batch = Batch(kernel, 2, seed=1, debug=True)
    batch.reset()
    rng = np.random.default_rng(1)
    for _ in range(60):
        batch.step(rng.choice(5, (2, 9), p=[0.1, 0.6, 0.1, 0.1, 0.1]))
        assert not batch.records["claims"].any()
        assert not batch.records["behind"].any()
        np.testing.assert_array_equal(batch.records["to"], batch.records["cell"])


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        ({"layout": "huge"}, "layout"),
        ({"layout": ".x\n.xx\ng"}, "layout"),
        ({"layout": ".xx"}, "layout"),
        ({"n_agents": 0}, "n_agents"),
        ({"n_agents": 111}, "n_agents"),
        ({"request_queue_size": 32}, "request_queue_size"),
        ({"reward_type": "none"}, "reward_type"),
        ({"shelf_columns": 2}, "shelf_columns"),
        ({"max_steps": -1}, "max_steps"),
        ({"sensor_range": 0}, "sensor_range"),
    ],
)
def test_robotic_warehouse_refuses_what_it_cannot_be(arguments, where):
    """Errors name the argument."""
    with pytest.raises(SpecError, match=where):
        RoboticWarehouse(**arguments, debug=True)


def test_robotic_warehouse_has_the_floor_that_its_arguments_name():
    """Shelves, sight and reward are as asked for."""
    env = RoboticWarehouse(
        shelf_rows=2,
        shelf_columns=3,
        column_height=8,
        n_agents=4,
        request_queue_size=5,
        sensor_range=2,
        reward_type="two_stage",
        debug=True,
    )
    assert env.state_space.shape[1:] == (20, 10)
    assert env.observation_space("robot_0").shape == (8 + 7 * 25,)
    assert env.kernel.terms == ("delivery", "put_back")


def test_robotic_warehouse_refuses_actions():
    """An action outside 0 to 4 changes nothing."""
    env = RoboticWarehouse(debug=True)
    env.reset(seed=0)
    with pytest.raises(ActionError):
        env.step({"robot_0": 5, "robot_1": 0})


def test_robotic_warehouse_draws_pictures():
    """A picture has 24 pixels a cell."""
    env = RoboticWarehouse(render_mode="rgb_array", debug=True, n_agents=5)
    env.reset(seed=0)
    assert env.render().shape == (11 * 24, 10 * 24, 3)


def test_robotic_warehouse_tells_what_is_nearest():
    """Infos point right and down to the nearest request, goal, empty place and its highway."""
    env = scene(*EMPTY, "v.....", "..x.X.", layout=OPEN)
    infos = after(env, "0")[1][4]["robot_0"]
    assert infos["to_request"].tolist() == [4, 1]
    assert infos["to_goal"].tolist() == [0, 1]
    assert infos["to_place"].tolist() == [5, 1]
    assert infos["delivered"] == 0


def test_robotic_warehouse_reference_delivers():
    """The reference delivers shelf after shelf and puts them back; who does nothing doesn't."""
    delivered = {}
    for name, policy in RoboticWarehouse.policies.items():
        env = RoboticWarehouse(n_agents=2, max_steps=250, debug=True, reward_type="two_stage")
        rng = np.random.default_rng(0)
        seen, infos = env.reset(seed=3)
        while env.agents:
            actions = {a: policy(seen[a], a, infos[a], rng) for a in env.agents}
            seen, _, _, _, infos = env.step(actions)
        delivered[name] = infos["robot_0"]["delivered"]
    assert delivered["reference"] >= 5
    assert delivered["reference"] > delivered["greedy"] > delivered["lazy"] == 0
