"""Blocks are columns of raw bytes, sorted, bounded, null where nothing is."""

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, Text

from gamekeeper.episodes import block as blocks
from gamekeeper.episodes.block import BLOCK_BYTES, Raw, block_of, element_bytes, most_rows
from gamekeeper.episodes.block import Text as Texts
from gamekeeper.episodes.buffer import BufferedTurns, LargePlace
from gamekeeper.episodes.layout import LARGE_BYTES, Layout
from gamekeeper.episodes.spaces import Codec

IMAGE = Box(0, 255, (LARGE_BYTES,), np.uint8)


def layout_of(*spaces: object) -> Layout:
    """Agents a, b, ... with these observation spaces, all acting in Discrete(5)."""
    layout = Layout()
    names = [chr(97 + place) for place in range(len(spaces))]
    codecs = {name: Codec(space) for name, space in zip(names, spaces, strict=True)}  # type: ignore[arg-type]
    layout.announce(names, lambda agent: (codecs[str(agent)], Codec(Discrete(5))))
    return layout


def given(seat: int, observation: object = None, nonconforming: object = None) -> list[object]:
    """What an agent was given."""
    return [seat, observation, None, 0.5, False, None, None, True, nonconforming]


def done(order: int | None, action: object = None, nonconforming: object = None) -> list[object]:
    """What it did."""
    return [order, action, 2, None, None, nonconforming]


def test_rows_are_sorted_by_turn_order_agent() -> None:
    """Across episodes too; those who didn't act come last, by name."""
    layout = layout_of(Discrete(3), Discrete(3))
    buffered = BufferedTurns(
        [*given(1, 1), *given(0, 0), *given(1, 2), *given(0, 1)],
        [*done(None), *done(None), *done(1, 4), *done(0, 3)],
        [0, 5, 2, *[None] * 5, 1, 0, 2, 9, *[None] * 4],
        [],
        [],
    )
    block = block_of(buffered, layout, open_large=pytest.fail)
    assert block.agent == ["a", "b", "a", "b"]
    assert block.episode.tolist() == [0, 0, 1, 1]
    assert block.turn.tolist() == [5, 5, 0, 0]
    column, cells = block.values["action"]
    assert isinstance(cells, Raw)
    assert cells.valid.tolist() == [False, False, True, True]
    assert cells.values.view(np.int64)[2:, 0].tolist() == [3, 4]
    assert column.leaf.kind == "int"
    assert block.reward.values.view(np.float64)[:, 0].tolist() == [2.0] * 4
    assert not block.truncated.valid.any()


def test_columns_of_other_groups_are_null() -> None:
    """Numbers and texts."""
    layout = layout_of(Discrete(3), Text(4), Box(0, 1, (2,), np.float32))
    floats = np.array([1, 2], np.float32).tobytes()
    buffered = BufferedTurns(
        [*given(0, 2), *given(1, "hi"), *given(2, floats), *given(2)],
        [*done(0), *done(1), *done(2), *done(3)],
        [0, 0, 4, 1, *[None] * 4],
        [],
        [],
    )
    values = block_of(buffered, layout, open_large=pytest.fail).values
    text = values["obs@b"][1]
    assert isinstance(text, Texts)
    assert text.values == [None, "hi", None, None]
    raw = values["obs@c"][1]
    assert isinstance(raw, Raw)
    assert raw.valid.tolist() == [False, False, True, False]
    assert floats == raw.values[2].tobytes()


def test_large_observations_come_from_where_they_were_put_or_as_bytes() -> None:
    """Both in one column; a missing one is null."""
    layout = layout_of(IMAGE)
    opened: list[int] = []

    def open_large(place: int, out: np.ndarray) -> None:  # type: ignore[type-arg]  # any array
        opened.append(place)
        out[:] = 7

    buffered = BufferedTurns(
        [*given(0, LargePlace(3)), *given(0, bytes(LARGE_BYTES)), *given(0)],
        [*done(0), *done(0), *done(0)],
        [n for turn in range(3) for n in (0, turn, 1, 1, *[None] * 4)],
        [],
        [],
    )
    cells = block_of(buffered, layout, open_large=open_large).values["obs"][1]
    assert isinstance(cells, Raw)
    assert opened == [3]
    assert cells.values[:, -1].tolist() == [7, 0, 0]
    assert cells.valid.tolist() == [True, True, False]


def test_nonconforming_parts_of_both_halves_are_one_object_in_the_order_of_fields() -> None:
    """What was given and what was done."""
    buffered = BufferedTurns(
        given(0, nonconforming=('"obs":{}', '"info":{}')),
        done(0, nonconforming=('"action":{}',)),
        [0, 0, 1, 1, *[None] * 4],
        [],
        [],
    )
    block = block_of(buffered, layout_of(Discrete(2)), open_large=pytest.fail)
    assert block.nonconforming == ['{"action":{},"info":{},"obs":{}}']


def test_blocks_are_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many rows of small ones, few of large ones, always at least one."""
    small, large = layout_of(Discrete(2)).columns("obs"), layout_of(IMAGE).columns("obs")
    assert element_bytes(small[0]) == 8
    assert element_bytes(large[0]) == LARGE_BYTES
    assert most_rows(small) == 65_536
    assert most_rows(large) == BLOCK_BYTES // LARGE_BYTES
    assert most_rows(layout_of(Text(5)).columns("obs")) == 65_536
    monkeypatch.setattr(blocks, "BLOCK_BYTES", LARGE_BYTES - 1)
    assert most_rows(large) == 1
