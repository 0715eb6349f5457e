"""pursuit: each of its written rules, in fields drawn as text."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.tasks.pursuit import pursuit_rules as rules
from gamekeeper.tasks.pursuit.pursuit import Pursuit
from tests.tasks.pursuit_fields import after, field, text

STAY, NORTH, EAST, SOUTH, WEST = range(5)


def test_pursuit_rocks_stand_in_nonconforming_rows_and_columns() -> None:
    """R1: none elsewhere, all of them with probability 1, others in each episode."""
    env = Pursuit(rocks=1.0, debug=True)
    env.reset(seed=1)
    assert np.array_equal(np.argwhere(env.state() == -2) % 2, np.ones((64, 2)))
    env = Pursuit(rocks=0.5, debug=True)
    drawn = []
    for seed in range(2):
        env.reset(seed=seed)
        drawn.append(env.state() == -2)
    assert 15 < drawn[0].sum() < 49
    assert (drawn[0] != drawn[1]).any()


def test_pursuit_puts_everybody_into_a_cell_of_its_own() -> None:
    """R2: as many as there are, in other cells in each episode."""
    env = Pursuit(debug=True)
    seen = []
    for seed in range(3):
        _, infos = env.reset(seed=seed)
        places = [tuple(info["position"].tolist()) for info in infos.values()]
        assert len(set(places)) == 16
        assert (env.state() > 0).sum() == (env.state() == -1).sum() == 8
        seen.append(places)
    assert seen[0] != seen[1] != seen[2]


@pytest.mark.parametrize(
    ("move", "moved"),
    [
        (STAY, ["...", ".P.", "..."]),
        (NORTH, [".P.", "...", "..."]),
        (EAST, ["...", "..P", "..."]),
        (SOUTH, ["...", "...", ".P."]),
        (WEST, ["...", "P..", "..."]),
    ],
)
def test_pursuit_moves_a_cell(move: int, moved: list[str]) -> None:
    """R3: nowhere, north, east, south, west."""
    lines = ("....e", ".P...", ".....")
    assert moved == [line[:3] for line in after(lines, {"pursuer_0": move})]


@pytest.mark.parametrize(
    ("lines", "moves"),
    [
        (("P..", "..e"), {"pursuer_0": NORTH}),
        (("P..", "..e"), {"pursuer_0": WEST}),
        (("P#.", "..e"), {"pursuer_0": EAST}),
        (("PP.", "..e"), {"pursuer_0": EAST, "pursuer_1": EAST}),
        (("PP.", "..e"), {"pursuer_0": EAST, "pursuer_1": WEST}),
    ],
)
def test_pursuit_goes_into_nothing_closed(lines: tuple[str, ...], moves: dict[str, int]) -> None:
    """R3: edges, rocks, and cells in which somebody stood as the tick began."""
    assert after(lines, moves)[0][0] == "P"


def test_pursuit_leaves_a_contested_cell_empty() -> None:
    """R4: of two, three or four that want a cell nobody goes, pursuer or evader."""
    east_west = {"pursuer_0": EAST, "pursuer_1": WEST}
    assert after(("P.P", "...", "..e"), east_west)[0] == "P.P"
    lines = (".P.", "P.P", ".e.")
    moves = {"pursuer_0": SOUTH, "pursuer_1": EAST, "pursuer_2": WEST, "evader_0": NORTH}
    assert after(lines, moves) == list(lines)
    assert after(lines, {**moves, "evader_0": STAY, "pursuer_1": STAY}) == list(lines)
    free = after(lines, {"pursuer_0": SOUTH}, catchers=4, evaders=1)
    assert free == ["...", "PPP", ".e."]


@pytest.mark.parametrize(
    ("lines", "catchers", "is_caught"),
    [
        ((".....", ".PeP.", "....."), 2, True),
        ((".....", ".Pe..", "..P.."), 2, True),
        ((".....", ".Pe..", "....."), 2, False),
        ((".P.P.", "..e..", "....."), 2, False),
        (("..P..", ".PeP.", "....."), 4, False),
        (("..P..", ".PeP.", "..P.."), 4, True),
        (("eP", "P."), 4, True),
        (("eP", ".."), 4, False),
        ((".#.", "PeP", ".#."), 4, True),
        (("....", "Pee.", "...."), 1, True),
    ],
)
def test_pursuit_catches_from_enough_sides(
    lines: tuple[str, ...], catchers: int, is_caught: bool
) -> None:
    """R5: so many pursuers beside it, or on all its open sides; diagonals don't count."""
    env = field(*lines, catchers=catchers)
    _, rewards, terminated, _, _ = env.step(dict.fromkeys(env.agents, STAY))
    assert is_caught == terminated["evader_0"]
    assert is_caught == ("evader_0" not in env.agents)
    assert rewards["evader_0"] == (rules.BEING_CAUGHT if is_caught else rules.TICK)
    if is_caught:
        assert env.endings["evader_0"] == "caught"
        assert sum("e" in line for line in text(env, lines)) == len(env.agents) - len(
            [agent for agent in env.agents if agent[0] == "p"]
        )


def test_pursuit_looks_for_catches_after_the_moves() -> None:
    """R5: pursuers that arrive catch, and who flees into an empty cell is gone from between."""
    lines = ("......", "P.e.P.", "......")
    assert after(lines, {"pursuer_0": EAST, "pursuer_1": WEST})[1] == ".P.P.."
    ran = {"pursuer_0": EAST, "pursuer_1": WEST, "evader_0": NORTH}
    assert after(lines, ran) == ["..e...", ".P.P..", "......"]


def test_pursuit_shares_prey_among_who_is_beside() -> None:
    """R6: equal shares, and one of each catch."""
    env = field("..P....", ".PeP...", ".......", "e......")
    _, rewards, *_ = env.step(dict.fromkeys(env.agents, STAY))
    assert [rewards[f"pursuer_{i}"] for i in range(3)] == [1 / 3] * 3
    env = field("PePeP", ".....", "....e")
    _, rewards, *_ = env.step(dict.fromkeys(env.agents, STAY))
    assert [rewards[f"pursuer_{i}"] for i in range(3)] == [0.5, 1.0, 0.5]
    assert env.terms["pursuer_1"] == {"prey": 1.0}


def test_pursuit_starves_and_leaves() -> None:
    """R7: who has no energy left; its cell is free in the next tick."""
    env = field("PP..", "....", "e...", stamina=9, catchers=3)
    env.memory.records["energy"][0, 0] = 3
    for left in (2, 1):
        *_, infos = env.step(dict.fromkeys(env.agents, STAY))
        assert infos["pursuer_0"]["energy"] == left
    _, rewards, terminated, _, _ = env.step(dict.fromkeys(env.agents, STAY))
    assert (rewards["pursuer_0"], terminated["pursuer_0"]) == (rules.STARVING, True)
    assert env.endings == {"pursuer_0": "starved"}
    assert text(env, ("....",)) == [".P.."]
    env.step({"pursuer_1": WEST, "evader_0": STAY})
    assert text(env, ("....",)) == ["P..."]


def test_pursuit_prey_fills_up_even_the_last_tick() -> None:
    """R7: who has a share in a catch has all its energy again."""
    env = field("PeP.", "....", "...e", stamina=7)
    env.memory.records["energy"][0, 0] = 1
    *_, infos = env.step(dict.fromkeys(env.agents, STAY))
    assert [infos[f"pursuer_{i}"]["energy"] for i in range(2)] == [7, 7]


def test_pursuit_nobody_starves_without_stamina() -> None:
    """R7: `stamina` 0 is for ever."""
    env = field("P...", "...e", stamina=0)
    for _ in range(20):
        observations, *_ = env.step(dict.fromkeys(env.agents, STAY))
    assert env.endings == {}
    assert observations["pursuer_0"][4, 4, 1] == 100


def test_pursuit_pays_survival() -> None:
    """R8: each tick, to each evader that isn't caught."""
    env = field("P..e", "...e")
    _, rewards, *_ = env.step(dict.fromkeys(env.agents, STAY))
    assert rewards == {"pursuer_0": 0.0, "evader_0": 0.01, "evader_1": 0.01}


def test_pursuit_ends_with_the_last_of_a_kind() -> None:
    """R9: cleared, or free."""
    env = field("PeP.", "....")
    env.step(dict.fromkeys(env.agents, STAY))
    assert env.endings == {"evader_0": "caught", "pursuer_0": "cleared", "pursuer_1": "cleared"}
    env = field("P.e.", "..e.", stamina=1)
    _, rewards, *_ = env.step(dict.fromkeys(env.agents, STAY))
    assert env.endings == {"pursuer_0": "starved", "evader_0": "free", "evader_1": "free"}
    assert rewards["evader_1"] == rules.TICK
    assert env.agents == []


def test_pursuit_truncates_at_the_horizon() -> None:
    """R9: whoever is left."""
    env = Pursuit(horizon=3, debug=True)
    env.reset(seed=0)
    for _ in range(3):
        _, _, terminated, truncated, _ = env.step(dict.fromkeys(env.agents, STAY))
    assert all(truncated.values())
    assert not any(terminated.values())
    assert set(env.endings.values()) == {"horizon"}


def test_pursuit_shows_three_planes_around_oneself() -> None:
    """R10: what is closed, pursuers with their energy, evaders."""
    env = field("P.#", "e.P", pursuer_sight=2, evader_sight=1, stamina=150, catchers=4)
    seen, *_ = env.step(dict.fromkeys(env.agents, STAY))
    closed, pursuers, evaders = np.moveaxis(seen["pursuer_0"], -1, 0)
    assert closed.tolist() == [[1] * 5, [1] * 5, [1, 1, 0, 0, 1], [1, 1, 0, 0, 0], [1] * 5]
    assert np.argwhere(pursuers).tolist() == [[2, 2], [3, 4]]
    assert pursuers.max() == 100  # 149 of 150, rounded up
    assert np.argwhere(evaders).tolist() == [[3, 2]]
    closed, pursuers, evaders = np.moveaxis(seen["evader_0"], -1, 0)
    assert closed.tolist() == [[1, 0, 0], [1, 0, 0], [1, 1, 1]]
    assert pursuers.tolist() == [[0, 1, 0], [0, 0, 0], [0, 0, 0]]
    assert evaders.tolist() == [[0, 0, 0], [0, 1, 0], [0, 0, 0]]


def test_pursuit_shows_who_dies_the_field_without_it() -> None:
    """R10: the last observation is of the tick's end, and lies in its space."""
    env = field("PeP.", "...e")
    seen, _, terminated, _, _ = env.step(dict.fromkeys(env.agents, STAY))
    assert terminated["evader_0"]
    assert seen["evader_0"][3, 3].tolist() == [0, 0, 0]
    assert seen["evader_0"][3, 2].tolist() == [0, 1, 0]
    assert all(env.observation_space(agent).contains(seen[agent]) for agent in seen)


def test_pursuit_scripted_evaders_are_no_agents() -> None:
    """R11: the pursuers alone; evaders stay, wander, or keep away from whom they see."""
    env = field("P....", "..e..", evaders_are="still", evaders=1)
    assert env.agents == ["pursuer_0"]
    env.step({"pursuer_0": STAY})
    assert text(env, (".....",) * 2) == ["P....", "..e.."]
    env = field(".....", "..e..", ".....", "P....", evaders_are="wander")
    spots = set()
    for _ in range(30):
        env.step({"pursuer_0": STAY})
        spots.add(tuple(text(env, (".....",) * 4)))
    assert len(spots) > 4
    for seed in range(5):
        env = field("P.e..", evaders_are="flee", evader_sight=2)
        env.rng.draws = seed
        env.step({"pursuer_0": STAY})
        assert text(env, (".....",)) == ["P..e."]


def test_pursuit_scripted_evader_in_a_corner_takes_what_is_left() -> None:
    """R11: of what is open it takes the furthest, which may be to stay."""
    env = field("e.P", "...", evaders_are="flee")
    env.step({"pursuer_0": STAY})
    assert text(env, ("...",) * 2) in (["e.P", "..."], ["..P", "e.."])
    env.step({"pursuer_0": STAY})
    assert text(env, ("...",) * 2) == ["..P", "e.."]


@settings(max_examples=30, deadline=None)
@given(st.permutations(range(5)), st.permutations(range(5, 9)), st.randoms(use_true_random=False))
def test_pursuit_outcome_does_not_hang_on_numbers(pursuers: Any, evaders: Any, random: Any) -> None:
    """A joint rule: with other numbers for the same places and moves everything goes the same."""
    lines = ("P.e.P", ".e.#.", "P.Pe.", "..eP.")
    places, orders = 9, [list(range(9)), [*pursuers, *evaders]]
    envs = [field(*lines, order=order) for order in orders]
    for _ in range(4):
        moves = [random.randrange(5) for _ in range(places)]
        told = []
        for env, order in zip(envs, orders, strict=True):
            names = env.possible_agents
            _, paid, ended, _, _ = env.step(
                {names[n]: moves[k] for k, n in enumerate(order) if names[n] in env.agents}
            )
            told.append([(paid.get(names[n]), ended.get(names[n])) for n in order])
        assert told[0] == told[1]
        assert envs[0].render() == envs[1].render()
        if not envs[0].agents:
            return
