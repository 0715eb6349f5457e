"""connect_four: its written rules, and equality with PettingZoo's."""

from typing import Any

import numpy as np
import pytest
from pettingzoo.classic import connect_four_v3

from gamekeeper.tasks.connect_four import COLUMNS, ROWS, ConnectFour, greedy, lazy, reference
from tests.tasks.classic import quiet, walk  # noqa: F401  # a fixture

UPRIGHT = (0, 1, 0, 1, 0, 1, 0)
LEVEL = (0, 0, 1, 1, 2, 2, 3)
RISING = (0, 1, 1, 2, 2, 3, 2, 3, 3, 6, 3)
FALLING = (6, 5, 5, 4, 4, 3, 4, 3, 3, 0, 3)
DRAW = (
    tuple(c for pair in ((0, 1), (2, 3), (4, 5)) for c in (*pair * 3, *pair[::-1] * 3)) + (6,) * 6
)


def played(*columns: int) -> ConnectFour:
    """A grid into which tokens fell in these columns, in plain Python."""
    env = ConnectFour(debug=True, render_mode="ansi")
    env.reset(seed=0)
    for column in columns:
        env.step(column)
    return env


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.usefixtures("quiet")
def test_connect_four_equals_pettingzoo(seed: int) -> None:
    """The same actions give the same `last`, books and observations; 5,000 steps."""
    ends = walk(ConnectFour(), connect_four_v3.env(), steps=5_000, seed=seed)
    for how, least in (("won", 50), ("illegal", 5)):
        assert ends[how] > least


@pytest.mark.usefixtures("quiet")
def test_connect_four_equals_pettingzoo_as_plain_python() -> None:
    """The same, of the rules that a debugger walks through."""
    walk(ConnectFour(debug=True), connect_four_v3.env(), steps=500, seed=3)


def test_connect_four_draws_as_pettingzoo_does() -> None:
    """R4: a full grid without a row of four, which random play doesn't come to."""
    env, theirs = played(*DRAW), connect_four_v3.env()
    theirs.reset(seed=0)
    for column in DRAW:
        theirs.step(column)
    assert env.state().all()
    assert env.endings == dict.fromkeys(env.possible_agents, "drawn")
    assert env.terminations == theirs.terminations
    assert env.rewards == theirs.rewards == {"player_0": 0.0, "player_1": 0.0}
    assert env.agent_selection == theirs.agent_selection == "player_0"


def test_connect_four_player_0_begins_and_they_take_turns() -> None:
    """R1."""
    env = played()
    assert env.agent_selection == "player_0"
    assert env.state().shape == (6, 7)
    assert not env.state().any()
    env.step(3)
    assert env.agent_selection == "player_1"


def test_connect_four_token_falls_to_the_lowest_empty_cell() -> None:
    """R2."""
    env = played(3, 3, 0)
    assert env.render().splitlines()[-2:] == ["...O...", "X..X..."]


@pytest.mark.parametrize("columns", [UPRIGHT, LEVEL, RISING, FALLING])
def test_connect_four_four_in_a_row_win(columns: tuple[int, ...]) -> None:
    """R3: 1 and -1, terminated, in every direction."""
    env = played(*columns)
    assert env.rewards == {"player_0": 1.0, "player_1": -1.0}
    assert env.terms == {"player_0": {"game": 1.0}, "player_1": {"game": -1.0}}
    assert env.endings == dict.fromkeys(env.possible_agents, "won")
    assert all(env.terminations.values())
    assert not any(env.truncations.values())


def test_connect_four_three_in_a_row_over_the_edge_do_not() -> None:
    """R3: the last cells of a row and the first of the next aren't neighbours."""
    env = played(5, 5, 6, 6, 4, 0, 0)
    assert not env.endings


def test_connect_four_full_column_ends_the_game() -> None:
    """R5: -1 for who dropped into it, 0 for the other."""
    env = played(*(0,) * 6, 0)
    assert env.rewards == {"player_0": -1.0, "player_1": 0.0}
    assert env.endings == dict.fromkeys(env.possible_agents, "illegal")
    assert all(env.terminations.values())
    assert all(env.truncations.values())


def test_connect_four_shows_own_tokens_first_and_masks_who_waits() -> None:
    """R6."""
    env = played(*(0,) * 6)
    env.step(2)
    mine, yours = env.observe("player_1"), env.observe("player_0")
    assert [mine["observation"][..., k].sum() for k in (0, 1)] == [3, 4]
    assert np.array_equal(mine["observation"][..., ::-1], yours["observation"])
    assert mine["action_mask"].tolist() == [0, 1, 1, 1, 1, 1, 1]
    assert not yours["action_mask"].any()


@pytest.mark.parametrize(
    ("columns", "order"),
    [(UPRIGHT, ("player_1", "player_0")), ((0,) * 7, ("player_0", "player_1"))],
)
def test_connect_four_who_would_be_in_turn_leaves_first(
    columns: tuple[int, ...], order: tuple[str, str]
) -> None:
    """R7."""
    env = played(*columns)
    left = []
    for agent in env.agent_iter():
        left.append(agent)
        env.step(None)
    assert order == tuple(left)


def wins(first: Any, second: Any, games: int = 20) -> int:
    """How often the first policy wins, beginning in every other game."""
    env, rng, count = ConnectFour(debug=True), np.random.default_rng(0), 0
    for game in range(games):
        env.reset(seed=game)
        me = env.possible_agents[game % 2]
        while not env.endings:
            seen, _, _, _, info = env.last()
            policy = first if env.agent_selection == me else second
            env.step(policy(seen, env.agent_selection, info, rng))
        count += env.rewards[me] == 1.0
    return count


def test_connect_four_reference_beats_the_others() -> None:
    """It sees fours of both; greedy doesn't see the other's, lazy sees none."""
    assert wins(reference, greedy) >= 18
    assert wins(reference, lazy) == 20


def test_connect_four_policies_play_legal_columns() -> None:
    """None of them drops into a full column."""
    for policy in (reference, greedy, lazy):
        env, rng = ConnectFour(debug=True), np.random.default_rng(1)
        env.reset(seed=0)
        while not env.endings:
            seen, _, _, _, info = env.last()
            env.step(policy(seen, env.agent_selection, info, rng))
        assert set(env.endings.values()) <= {"won", "drawn"}


def test_connect_four_draws_its_grid() -> None:
    """Cells of 24 pixels; a token is seen where it fell."""
    env = ConnectFour(debug=True, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(0)
    changed = (env.render() != before).any(-1)
    assert before.shape == (24 * ROWS, 24 * COLUMNS, 3)
    assert changed[-24:, :24].any()
    assert not changed[:-24].any()


def test_connect_four_contract_stands_beside_it() -> None:
    """Its name and API are the environment's."""
    declared = ConnectFour(debug=True).declared
    assert (declared.name, declared.api) == ("connect_four_v3", "aec")
