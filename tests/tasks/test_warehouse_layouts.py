"""Floors: what makes one, and how far it is from cell to cell."""

import copy
import pickle
from collections import deque

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import SpecError
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.warehouse.warehouse_floor import (
    CLOSED,
    FAR,
    NAMED,
    NEEDED,
    FloorLayout,
    layout_of,
)


def moves_from(floor: FloorLayout, goals: list[int]) -> list[int]:
    """Distances by plain breadth-first search."""
    found = [FAR] * floor.size
    queue = deque(goals)
    for goal in goals:
        found[goal] = 0
    while queue:
        cell = queue.popleft()
        for near in floor.beside(cell):
            if near >= 0 and floor.text[near] not in CLOSED and found[near] == FAR:
                found[near] = found[cell] + 1
                queue.append(near)
    return found


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("kind", NEEDED)
def test_distances_are_shortest_ways(name: str, kind: str) -> None:
    """From every cell to every place, as a plain search finds them."""
    floor = layout_of(name)
    cells = [cell for cell, letter in enumerate(floor.text) if letter == kind]
    for cell, row in zip(cells, floor.distances(kind).tolist(), strict=True):
        goals = (
            [cell]
            if kind != "s"
            else [
                near for near in floor.beside(cell) if near >= 0 and floor.text[near] not in CLOSED
            ]
        )
        assert row == moves_from(floor, goals)


@given(st.sampled_from(list(NAMED)), st.integers(0, 2**32))
@settings(max_examples=15)
def test_shuffled_floors_keep_parts_and_are_whole(name: str, seed: int) -> None:
    """As many places of each kind, walls where they were, and all of it can be reached."""
    floor = layout_of(name)
    other = floor.shuffled(Stream(seed))
    assert sorted(other.text) == sorted(floor.text)
    assert [a == "#" for a in other.text] == [a == "#" for a in floor.text]
    assert (other.width, other.height) == (floor.width, floor.height)
    assert other == floor.shuffled(Stream(seed))


def test_floors_are_never_copied() -> None:
    """A deep copy is the floor itself; a pickle of one of ours is ours."""
    floor = layout_of("small")
    assert copy.deepcopy(floor) is floor
    assert pickle.loads(pickle.dumps(floor)) is floor
    own = layout_of(("s.h", "..d", "c.."))
    assert pickle.loads(pickle.dumps(own)) == own


@pytest.mark.parametrize(
    ("rows", "fault"),
    [
        (("s.h", "..d", "..."), "no charger"),
        (("s.h", "..", "c.d"), "can't be read"),
        (("s.x", "..d", "ch."), "can't be read"),
        ((), "can't be read"),
        (("s.#h", "c.#d"), "in parts"),
        (("s#..", "##hd", "...c"), "no robot reaches"),
        (("shdc",), "no floor"),
    ],
)
def test_layouts_that_make_no_floor_are_refused(rows: tuple[str, ...], fault: str) -> None:
    """Each with its reason."""
    with pytest.raises(SpecError, match=fault):
        layout_of(rows)


def test_crowded_floors_refuse_to_be_shuffled() -> None:
    """Where shelves leave no room to put them elsewhere, it is said."""
    floor = layout_of(("sssss", "h.d.c", "sssss"))
    with pytest.raises(SpecError, match="too crowded"):
        floor.shuffled(Stream(1))
