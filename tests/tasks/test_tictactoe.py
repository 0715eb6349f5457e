"""tictactoe: its written rules, and equality with PettingZoo's."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.classic import tictactoe_v3

from gamekeeper.tasks.tictactoe import Tictactoe, greedy, lazy, reference
from tests.tasks.classic import quiet, walk  # noqa: F401  # a fixture

SOME = np.array([[1, 0, 0], [0, 0, 0], [0, 0, 0]])


def played(*cells: int) -> Tictactoe:
    """A board on which these cells were marked in turn, in plain Python."""
    env = Tictactoe(debug=True, render_mode="ansi")
    env.reset(seed=0)
    for cell in cells:
        env.step(cell)
    return env


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.usefixtures("quiet")
def test_tictactoe_equals_pettingzoo(seed: int) -> None:
    """The same actions give the same `last`, books and observations; 5,000 steps."""
    ends = walk(Tictactoe(), tictactoe_v3.env(), steps=5_000, seed=seed)
    for how, least in (("won", 50), ("drawn", 5), ("illegal", 10)):
        assert ends[how] > least


@pytest.mark.usefixtures("quiet")
def test_tictactoe_equals_pettingzoo_as_plain_python() -> None:
    """The same, of the rules that a debugger walks through."""
    walk(Tictactoe(debug=True), tictactoe_v3.env(), steps=500, seed=3)


def test_tictactoe_player_1_begins_and_they_take_turns() -> None:
    """R1."""
    env = played()
    assert env.agent_selection == "player_1"
    assert not env.state().any()
    env.step(4)
    assert env.agent_selection == "player_2"


def test_tictactoe_action_marks_its_cell() -> None:
    """R2."""
    env = played(1, 5)
    assert env.state().tolist() == [[0, 1, 0], [0, 0, 2], [0, 0, 0]]
    assert env.render() == ".X.\n..O\n..."


@pytest.mark.parametrize("three", [(0, 1, 2), (2, 5, 8), (0, 4, 8), (2, 4, 6)])
def test_tictactoe_three_in_a_row_win(three: tuple[int, int, int]) -> None:
    """R3: 1 and -1, terminated."""
    rest = [cell for cell in (1, 3, 5, 7, 0, 2) if cell not in three]
    env = played(three[0], rest[0], three[1], rest[1], three[2])
    assert env.rewards == {"player_1": 1.0, "player_2": -1.0}
    assert env.terms == {"player_1": {"game": 1.0}, "player_2": {"game": -1.0}}
    assert env.endings == dict.fromkeys(env.possible_agents, "won")
    assert all(env.terminations.values())
    assert not any(env.truncations.values())


def test_tictactoe_full_board_is_a_draw() -> None:
    """R4: nobody is paid."""
    env = played(0, 1, 2, 4, 3, 5, 7, 6, 8)
    assert env.rewards == {"player_1": 0.0, "player_2": 0.0}
    assert env.endings == dict.fromkeys(env.possible_agents, "drawn")


def test_tictactoe_full_board_may_be_won() -> None:
    """R3 before R4: the ninth mark may make three."""
    env = played(0, 1, 2, 3, 4, 5, 7, 6, 8)
    assert env.rewards == {"player_1": 1.0, "player_2": -1.0}
    assert env.endings == dict.fromkeys(env.possible_agents, "won")


def test_tictactoe_marked_cell_ends_the_game() -> None:
    """R5: -1 for who did it, 0 for the other."""
    env = played(4, 4)
    assert env.rewards == {"player_1": 0.0, "player_2": -1.0}
    assert env.endings == dict.fromkeys(env.possible_agents, "illegal")
    assert all(env.terminations.values())
    assert all(env.truncations.values())


def test_tictactoe_shows_own_marks_first_and_masks_who_waits() -> None:
    """R6."""
    env = played(0)
    mine, yours = env.observe("player_2"), env.observe("player_1")
    assert np.array_equal(mine["observation"][..., 1], SOME)
    assert np.array_equal(yours["observation"][..., 0], SOME)
    assert mine["action_mask"].tolist() == [0, 1, 1, 1, 1, 1, 1, 1, 1]
    assert not yours["action_mask"].any()


@pytest.mark.parametrize(
    ("cells", "order"),
    [((0, 3, 1, 4, 2), ("player_2", "player_1")), ((4, 4), ("player_1", "player_2"))],
)
def test_tictactoe_who_would_be_in_turn_leaves_first(
    cells: tuple[int, ...], order: tuple[str, str]
) -> None:
    """R7."""
    env = played(*cells)
    left = []
    for agent in env.agent_iter():
        left.append(agent)
        env.step(None)
    assert order == tuple(left)


def results(first: Any, second: Any, games: int = 30) -> set[float]:
    """What player_1 is paid when these play each other."""
    env, rng, found = Tictactoe(debug=True), np.random.default_rng(0), set()
    for game in range(games):
        env.reset(seed=game)
        while not env.endings:
            seen, _, _, _, info = env.last()
            policy = first if env.agent_selection == "player_1" else second
            env.step(policy(seen, env.agent_selection, info, rng))
        found.add(env.rewards["player_1"])
    return found


def test_tictactoe_reference_is_never_beaten() -> None:
    """Perfect play draws with itself, and loses against nobody."""
    assert results(reference, reference) == {0.0}
    assert -1.0 not in results(reference, greedy) | results(reference, lazy)
    assert 1.0 not in results(greedy, reference) | results(lazy, reference)


def test_tictactoe_draws_its_board() -> None:
    """Three cells of 24 pixels a side, and nothing without a mode."""
    env = Tictactoe(debug=True, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(0)
    assert (env.render() != before).any(-1)[:24, :24].any()
    assert before.shape == (72, 72, 3)
    assert Tictactoe().render_mode is None


def test_tictactoe_contract_stands_beside_it() -> None:
    """Its name and API are the environment's."""
    declared = Tictactoe(debug=True).declared
    assert (declared.name, declared.api) == ("tictactoe_v3", "aec")
    assert Path(Tictactoe(debug=True).contract_path).exists()
