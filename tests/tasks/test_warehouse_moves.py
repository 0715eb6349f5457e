"""Who may move: laws that hold for any crowd, and each case by itself."""

import itertools
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.kernels.scalar_rules import as_python
from gamekeeper.tasks.warehouse.warehouse_floor import NOWHERE
from gamekeeper.tasks.warehouse.warehouse_rules import refuse


def refused_moves(moves: dict[str, tuple[int, int]], stands: dict[int, str]) -> set[str]:
    """Whom the rule refuses, robots being numbered in the order in which they are listed."""
    names = list(stands.values())
    state = SimpleNamespace(
        cell=list(stands),
        wants=[moves[name][1] if name in moves else NOWHERE for name in names],
        refused=[0] * len(names),
        robot_at=[names.index(stands[cell]) + 1 if cell in stands else 0 for cell in range(9)],
        claims=[0] * 9,
    )
    as_python(refuse)(state)
    assert state.claims == [0] * 9
    return {name for name, flag in zip(names, state.refused, strict=True) if flag}


@st.composite
def crowds(draw: Any) -> tuple[dict[str, tuple[int, int]], dict[int, str]]:
    """Robots on some of nine cells, some of which want another cell."""
    cells = draw(st.lists(st.integers(0, 8), unique=True, max_size=9))
    stands = {cell: f"robot_{i}" for i, cell in enumerate(cells)}
    moves = {}
    for cell, agent in stands.items():
        wanted = draw(st.none() | st.integers(0, 8).filter(lambda other, own=cell: other != own))
        if wanted is not None:
            moves[agent] = (cell, wanted)
    return moves, stands


def outcome(
    moves: dict[str, tuple[int, int]], stands: dict[int, str], refused: set[str]
) -> dict[str, int]:
    """Where each robot is afterwards."""
    return {
        agent: moves[agent][1] if agent in moves and agent not in refused else cell
        for cell, agent in stands.items()
    }


def is_fair(moves: dict[str, tuple[int, int]], stands: dict[int, str], refused: set[str]) -> bool:
    """Nobody shares a cell; ties and swaps are refused whole."""
    cells = outcome(moves, stands, refused)
    if len(set(cells.values())) < len(cells):
        return False
    for a, b in itertools.combinations(moves, 2):
        is_tie = moves[a][1] == moves[b][1]
        is_swap = moves[a] == moves[b][::-1]
        if (is_tie or is_swap) and not {a, b} <= refused:
            return False
    return True


@given(crowds())
def test_moves_refused_are_the_least_fair_set(
    crowd: tuple[dict[str, tuple[int, int]], dict[int, str]],
) -> None:
    """The answer is fair, and every fair set holds it: nobody is refused for nothing."""
    moves, stands = crowd
    refused = refused_moves(moves, stands)
    assert is_fair(moves, stands, refused)
    names = sorted(moves)
    for count in range(len(names) + 1):
        for some in itertools.combinations(names, count):
            if is_fair(moves, stands, set(some)):
                assert refused <= set(some)


@given(crowds(), st.randoms(use_true_random=False))
def test_moves_refused_do_not_hang_on_order(
    crowd: tuple[dict[str, tuple[int, int]], dict[int, str]], shuffler: Any
) -> None:
    """However moves and cells are listed, the same robots are refused."""
    moves, stands = crowd
    listed, placed = list(moves.items()), list(stands.items())
    shuffler.shuffle(listed)
    shuffler.shuffle(placed)
    assert refused_moves(moves, stands) == refused_moves(dict(listed), dict(placed))


@pytest.mark.parametrize(
    ("wanted", "refused"),
    [
        ({"a": 2, "b": 3, "c": 4}, ""),  # a queue moves on
        ({"a": 2, "b": 3}, "ab"),  # c stays, so the queue does
        ({"a": 2, "b": 1}, "ab"),  # a swap
        ({"a": 2, "b": 3, "c": 1}, ""),  # a ring turns
        ({"a": 4, "b": 4}, "ab"),  # a tie
        ({"a": 4, "b": 4, "c": 1}, "abc"),  # a tie keeps a in the cell that c wants
        ({"a": 2, "b": 1, "c": 2}, "abc"),  # a swap with a third who wants in
        ({"a": 2, "b": 4, "c": 4}, "abc"),  # the queue behind a tie
        ({"a": 5}, ""),  # alone
        ({}, ""),
    ],
)
def test_moves_of_three_in_a_row(wanted: dict[str, int], refused: str) -> None:
    """Robots a, b, c in cells 1, 2, 3: each case that the rule names."""
    stands = {1: "a", 2: "b", 3: "c"}
    cells = {agent: cell for cell, agent in stands.items()}
    moves = {agent: (cells[agent], cell) for agent, cell in wanted.items()}
    assert refused_moves(moves, stands) == set(refused)
