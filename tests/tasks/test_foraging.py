import functools

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import gamekeeper.tasks  # noqa: F401  # registers the tasks
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import SpecError
from gamekeeper.interface.contract_draft import agent_specs
from gamekeeper.kernels.batch import Batch
from gamekeeper.tasks.foraging.foraging import Foraging, foraging_kernel

NOTHING, NORTH, SOUTH, WEST, EAST, LOAD = range(6)


def scene(*rows, **arguments):
    """A field that looks like these rows, as `ansi` has them: `a b c` players, digits food."""
    players = [
        (r + 1, c + 1, "abc".index(letter) + 1)
        for r, row in enumerate(rows)
        for c, letter in enumerate(row)
        if letter in "abc"
    ]
    foods = [
        (r + 1, c + 1, int(letter))
        for r, row in enumerate(rows)
        for c, letter in enumerate(row)
        if letter.isdigit()
    ]
    env = Foraging(
        players=len(players),
        max_num_food=max(len(foods), 1),
        field_size=(len(rows), len(rows[0])),
        max_player_level=3,
        render_mode="ansi",
        debug=True,
        **arguments,
    )
    env.reset(seed=0)
    s = env.memory.records[0]
    s["grid"][1:-1, 1:-1] = 0
    for i, (row, column, level) in enumerate(players):
        s["row"][i] = s["to_row"][i] = row
        s["column"][i] = s["to_column"][i] = column
        s["level"][i] = level
    for k, (row, column, level) in enumerate(foods):
        s["food_row"][k], s["food_column"][k], s["worth"][k] = row, column, level
        s["grid"][row, column] = k + 1
    s["left"], s["spawned"] = len(foods), sum(food[2] for food in foods)
    return env


def after(env, *actions):
    """What the field looks like after a tick, and what the step gave."""
    given = env.step(dict(zip(env.agents, actions, strict=True)))
    return env.render().split("\n"), given


def test_foraging_conforms_to_pettingzoo():
    """PettingZoo's own tests pass on the registered task, and its contract leaves nothing open."""
    make = functools.partial(pettingzoo.make, "parallel", "gamekeeper/foraging-v0", debug=True)
    parallel_api_test(make(), num_cycles=60)
    parallel_seed_test(make, num_cycles=30)
    env = Foraging(debug=True)
    env.reset(seed=0)
    assert env.state_space.contains(env.state())
    assert open_questions(env.declared, agent_specs(env, env.declared)) == ()


def test_foraging_begins_within_its_bounds():
    """R1, R2: players apart with their levels, food off the edge and apart, in order."""
    for seed in range(20):
        env = Foraging(
            players=3,
            field_size=(7, 9),
            max_num_food=4,
            min_player_level=[1, 2, 5],
            max_player_level=[1, 3, 5],
            min_food_level=2,
            max_food_level=4,
            debug=True,
        )
        env.reset(seed=seed)
        state = env.state()
        players, foods = state[:3], state[3:]
        levels = sorted(players[:, 2].tolist())
        assert levels[0] == 1
        assert levels[1] in (2, 3)
        assert levels[2] == 5
        there = [tuple(cell) for cell in state[state[:, 2] > 0][:, :2].tolist()]
        assert len(set(there)) == len(there)
        grown = foods[foods[:, 2] > 0]
        assert (grown[:, 0] >= 1).all()
        assert (grown[:, 0] <= 5).all()
        assert ((grown[:, 1] >= 1) & (grown[:, 1] <= 7)).all()
        assert ((grown[:, 2] >= 2) & (grown[:, 2] <= 4)).all()
        cells = grown[:, :2].tolist()
        assert cells == sorted(cells)
        for one in grown:
            for other in grown:
                down, right = np.abs(one - other)[:2]
                assert (down, right) == (0, 0) or max(down, right) > 1
                assert (down, right) not in ((0, 2), (2, 0))


def test_foraging_coop_food_takes_the_three_weakest():
    """R2: with force_coop all food has the level of the three weakest players together."""
    env = Foraging(players=4, max_player_level=3, force_coop=True, debug=True)
    for seed in range(10):
        env.reset(seed=seed)
        state = env.state()
        weakest = np.sort(state[:4, 2])[:3].sum()
        assert set(state[4:, 2].tolist()) <= {weakest, 0}


def test_foraging_moves_only_onto_free_cells():
    """R3: no move off the field or onto food; loading beside nothing does nothing."""
    env = scene("a....", ".....", "..1b.", ".....", ".....")
    shown, (_, rewards, *_) = after(env, NORTH, WEST)
    assert shown == ["a....", ".....", "..1b.", ".....", "....."]
    shown, (_, rewards, *_) = after(env, LOAD, NORTH)
    assert shown[:3] == ["a....", "...b.", "..1.."]
    assert list(rewards.values()) == [0.0, 0.0]


@pytest.mark.parametrize(
    ("row", "actions", "expected"),
    [
        ("a.b", (EAST, WEST), "a.b"),  # one cell
        ("ab.", (EAST, NOTHING), "ab."),  # taken
        ("ab.", (EAST, EAST), ".ab"),  # left
        ("ab.", (EAST, WEST), "ba."),  # swapped
        ("ab.c", (EAST, EAST, WEST), ".B.c"),  # refused where another one moved in: both there
    ],
)
def test_foraging_refuses_those_that_meet(row, actions, expected):
    """R4: who would share a cell stays; who follows moves, swaps pass."""
    rows = [row.ljust(5, "."), ".....", ".....", "...1.", "....."]
    shown, _ = after(scene(*rows), *actions)
    assert expected.ljust(5, ".") == shown[0]


def test_foraging_pays_those_who_load_together():
    """R5, R6: levels add up; each is paid its level's share of the food's share."""
    env = scene(".....", ".ab..", ".2...", ".b.3.", ".....", penalty=0.25)
    shown, (_, rewards, terminated, *_) = after(env, LOAD, LOAD, LOAD)
    assert shown[2] == "....."
    expected = {"player_0": 1 * 2 / (3 * 5), "player_1": 0.0, "player_2": 2 * 2 / (3 * 5)}
    assert expected == rewards
    assert set(terminated.values()) == {False}
    env = scene(".....", ".a...", ".2...", ".....", "...1.", penalty=0.25, normalize_reward=False)
    shown, (_, rewards, *_) = after(env, LOAD)
    assert (rewards["player_0"], shown[2]) == (-0.25, ".2...")


def test_foraging_pays_levels_without_normalisation():
    """R6: a player's level times the food's."""
    env = scene(".....", ".ab..", ".2...", ".b...", ".....", normalize_reward=False)
    _, (_, rewards, terminated, *_) = after(env, LOAD, NOTHING, LOAD)
    assert rewards == {"player_0": 2.0, "player_1": 0.0, "player_2": 4.0}
    assert set(terminated.values()) == {True}  # R8
    assert set(env.endings.values()) == {"cleared"}


def test_foraging_shows_what_lies_in_sight():
    """R7: food in sight, itself, then others within two sights of the corner."""
    rows = ["a...c", ".....", "..1..", ".....", "....2", ".....", "b...."]
    env = scene(*rows, sight=2)
    seen, *_ = after(env, NOTHING, NOTHING, NOTHING)[1]
    gone = [-1, -1, 0]
    assert seen["player_0"].tolist() == [2, 2, 1, *gone, 0, 0, 1, 0, 4, 3, *gone]
    assert seen["player_1"].tolist() == [2, 0, 1, *gone, 0, 2, 3, *gone, *gone]
    assert seen["player_2"].tolist() == [*gone, *gone, 2, 0, 2, *gone, *gone]
    blind = scene(*rows, sight=2, observe_agent_levels=False)
    seen, *_ = after(blind, NOTHING, NOTHING, NOTHING)[1]
    assert seen["player_0"].tolist() == [2, 2, 1, *gone, 0, 0, 0, 4, -1, -1]


def test_foraging_is_cut_at_its_horizon():
    """R9: after `max_episode_steps` all are truncated."""
    env = Foraging(max_episode_steps=3, debug=True)
    env.reset(seed=0)
    given = [env.step(dict.fromkeys(env.agents, NOTHING)) for _ in range(3)]
    assert [set(g[3].values()) for g in given] == [{False}, {False}, {True}]
    assert set(env.endings.values()) == {"horizon"}


def test_foraging_compiled_is_plain():
    """Compiled and plain copies have the same bytes, over many episodes."""
    kernel = foraging_kernel(
        players=4, field_size=(6, 5), sight=2, penalty=0.1, max_episode_steps=30
    )
    plain, fast = (Batch(kernel, 6, seed=5, debug=debug) for debug in (True, False))
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(plain.reset(), fast.reset())
    for _ in range(100):
        actions = rng.choice(6, (6, 4), p=[0.05, 0.15, 0.15, 0.15, 0.15, 0.35])
        for mine, theirs in zip(plain.step(actions), fast.step(actions), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert plain.snapshot() == fast.snapshot()


def test_foraging_reference_is_better_than_greedy_than_lazy():
    """Together at one food pays more than each at its own, and that more than nothing."""
    rng = np.random.default_rng(0)
    env = Foraging(players=2, max_num_food=2, field_size=(6, 6), force_coop=True, debug=True)
    means = {}
    for name, policy in Foraging.policies.items():
        paid = []
        for seed in range(12):
            seen, infos = env.reset(seed=seed)
            total = 0.0
            while env.agents:
                actions = {a: policy(seen[a], a, infos[a], rng) for a in env.agents}
                seen, rewards, _, _, infos = env.step(actions)
                total += sum(rewards.values())
            paid.append(total)
        means[name] = np.mean(paid)
    assert means["reference"] > 0.6
    assert means["reference"] > means["greedy"] > means["lazy"] == 0.0


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        ({"players": 0}, "players"),
        ({"field_size": (2, 8)}, "field_size"),
        ({"max_num_food": 0}, "max_num_food"),
        ({"sight": 0}, "sight"),
        ({"min_player_level": 3}, "min_player_level"),
        ({"min_player_level": [1, 1, 1]}, "min_player_level"),
        ({"max_food_level": 10**6}, "max_food_level"),
        ({"min_food_level": 3}, "min_food_level"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
    ],
)
def test_foraging_refuses_what_it_cannot_be(arguments, where):
    """Errors name the argument."""
    with pytest.raises(SpecError, match=where):
        Foraging(**arguments, debug=True)


def test_foraging_draws_pictures():
    """A picture has 24 pixels a cell."""
    env = Foraging(render_mode="rgb_array", debug=True, field_size=(5, 9))
    env.reset(seed=0)
    assert env.render().shape == (5 * 24, 9 * 24, 3)
