"""Canonical bytes: what counts, what doesn't, and that no two rows share them by accident."""

import json
from hashlib import blake2b
from typing import Any

import numpy as np
from blake3 import blake3
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.episodes.block import Raw, Text
from gamekeeper.episodes.digest import (
    SIZE,
    DigestField,
    EpisodeDigest,
    cells_digest_field,
    digest_fields,
    episode_header,
    run_fingerprint,
    run_header,
)
from gamekeeper.episodes.layout import LARGE_BYTES


def raw(values: Any, valid: Any = None) -> Raw:
    """Cells of an array [rows, ...]."""
    array = np.ascontiguousarray(values)
    rows = array.reshape(len(array), -1).view(np.uint8)
    return Raw(rows, np.ones(len(array), np.bool_) if valid is None else np.array(valid, np.bool_))


def digests(*fields: DigestField, count: int) -> list[bytes]:
    """The digests of rows."""
    return [row.tobytes() for row in digest_fields(list(fields), count)]


def test_row_is_its_layout_and_then_its_bytes() -> None:
    """As another reader would compute it from the page on the format."""
    values = np.array([[1, 2], [3, 4]], np.float32)
    field = cells_digest_field("obs", "<f4", (2,), raw(values))
    layout = json.dumps([["obs", "<f4", [2]]], separators=(",", ":"))
    head = blake2b(layout.encode(), digest_size=SIZE).digest()
    expected = [blake2b(head + row.tobytes(), digest_size=SIZE).digest() for row in values]
    assert expected == digests(field, count=2)


def test_large_values_stand_by_their_blake3() -> None:
    """A null one leaves nothing."""
    values = np.arange(2 * LARGE_BYTES, dtype=np.uint8).reshape(2, -1)
    field = cells_digest_field("obs", "|u1", (LARGE_BYTES,), raw(values, [True, False]))
    assert field.values[0].tobytes() == blake3(values[0].tobytes()).digest()
    none = cells_digest_field("obs", "|u1", (LARGE_BYTES,), raw(values, [False, False]))
    assert digests(field, count=2)[1] == digests(none, count=2)[0]


CELL = st.none() | st.integers(0, 2)


@settings(max_examples=20)
@given(st.lists(st.lists(CELL, min_size=70, max_size=70), min_size=2, max_size=6))
def test_row_digest_depends_on_its_own_row_only(rows: list[list[int | None]]) -> None:
    """However many fields are null in others; more patterns than bits in a word too."""
    columns = list(zip(*rows, strict=True))

    def fields(of: list[tuple[int | None, ...]]) -> list[DigestField]:
        return [
            cells_digest_field(
                f"f{place}",
                "<i8",
                (),
                raw(np.array([c or 0 for c in column]), [c is not None for c in column]),
            )
            for place, column in enumerate(of)
        ]

    together = digests(*fields(columns), count=len(rows))
    alone = [digests(*fields([(cell,) for cell in row]), count=1)[0] for row in rows]
    assert alone == together
    assert len(set(together)) == len({tuple(row) for row in rows})


def test_null_differs_from_zero_and_from_the_empty_text() -> None:
    """A field that isn't there isn't in the layout."""
    null = cells_digest_field("x", "<i8", (), raw(np.zeros(1, np.int64), [False]))
    zero = cells_digest_field("x", "<i8", (), raw(np.zeros(1, np.int64)))
    empty, none = (cells_digest_field("x", "", (), Text([text])) for text in ("", None))
    assert len({digests(f, count=1)[0] for f in (null, zero, empty)}) == 3
    assert digests(null, count=1) == digests(none, count=1)


def test_values_cannot_move_between_fields() -> None:
    """Dtype, shape and tag are in the layout."""
    pair = np.array([[1, 2]], np.int64)
    one = cells_digest_field("a", "<i8", (2,), raw(pair))
    two = [cells_digest_field(tag, "<i8", (), raw(pair[:, i])) for i, tag in enumerate("ab")]
    other = cells_digest_field("a", "<u8", (2,), raw(pair))
    found = {digests(one, count=1)[0], digests(*two, count=1)[0], digests(other, count=1)[0]}
    assert len(found) == 3


def test_lone_surrogates_have_a_digest() -> None:
    """Agents and texts of odd values may hold them."""
    field = cells_digest_field("x", "", (), Text(["\ud800", "a"]))
    assert len(set(digests(field, count=2))) == 2


@given(st.lists(st.binary(min_size=SIZE, max_size=SIZE), max_size=9), st.data())
def test_episode_digest_does_not_depend_on_parts(rows: list[bytes], data: st.DataObject) -> None:
    """Rows and states may come interleaved, many or few at a time."""
    header = episode_header(seed=1, options=None)
    whole, parts = EpisodeDigest(header), EpisodeDigest(header)
    table = np.frombuffer(b"".join(rows), np.uint8).reshape(-1, SIZE)
    whole.add_rows(table)
    whole.add_states(table)
    cut = data.draw(st.integers(0, len(rows)))
    for part in (table[:cut], table[cut:]):
        parts.add_states(part)
        parts.add_rows(part)
    assert whole.fingerprint == parts.fingerprint
    assert whole.info_fingerprint == parts.info_fingerprint


def test_rows_are_not_states_nor_headers() -> None:
    """The same digests in another place are another episode."""
    table = np.ones((1, SIZE), np.uint8)
    header = episode_header(seed=1, options=None)
    rows, states = EpisodeDigest(header), EpisodeDigest(header)
    rows.add_rows(table)
    states.add_states(table)
    other = EpisodeDigest(episode_header(seed=1, options="null"))
    other.add_rows(table)
    assert len({rows.fingerprint, states.fingerprint, other.fingerprint}) == 3


def test_run_covers_environment_spaces_and_the_order_of_episodes() -> None:
    """And nothing of the order of keys."""
    one = run_fingerprint(run_header({"a": 1, "b": 2}, {"x": None}), ["aa", "bb"])
    assert one == run_fingerprint(run_header({"b": 2, "a": 1}, {"x": None}), ["aa", "bb"])
    others = [
        run_fingerprint(run_header({"a": 1, "b": 3}, {"x": None}), ["aa", "bb"]),
        run_fingerprint(run_header({"a": 1, "b": 2}, {"y": None}), ["aa", "bb"]),
        run_fingerprint(run_header({"a": 1, "b": 2}, {"x": None}), ["bb", "aa"]),
    ]
    assert len({one, *others}) == 4
