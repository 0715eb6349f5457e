"""Arrays of draws are the draws that a stream makes one by one, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gamekeeper.randomness import philox
from gamekeeper.randomness import stream as draws
from gamekeeper.randomness.stream import Stream

WORDS = st.integers(0, 2**32 - 1)
PLACES = st.tuples(st.integers(0, 2**64 - 1), WORDS, WORDS, st.integers(0, 2**66 - 100))


@given(PLACES, st.integers(1, 30))
def test_words_are_those_of_the_stream(place: tuple[int, int, int, int], count: int) -> None:
    """From any place within a block on; the stream stays where it was."""
    stream = Stream.from_state(place)
    found = draws.words(stream, count).tolist()
    assert stream.state == place
    assert found == [stream.word() for _ in range(count)]


@given(PLACES, st.integers(1, 30))
def test_numbers_are_those_of_the_stream(place: tuple[int, int, int, int], count: int) -> None:
    """Uniform and normal numbers have equal bits."""
    stream = Stream.from_state(place)
    units, normals = draws.units(stream, count), draws.normals(stream, count)
    one_by_one = Stream.from_state(place)
    assert units.tolist() == [one_by_one.uniform() for _ in range(count)]
    one_by_one = Stream.from_state(place)
    assert normals.tolist() == [one_by_one.normal() for _ in range(count)]


@pytest.mark.parametrize("seed", range(4))
def test_normals_have_equal_bits_by_the_thousand(seed: int) -> None:
    """Among them some of the tails."""
    found = draws.normals(Stream(seed), 5000)
    stream = Stream(seed)
    assert found.tobytes() == np.array([stream.normal() for _ in range(5000)]).tobytes()
    assert np.abs(found).max() > 3


@example(0, 0)
@example(2**32 - 1, 2**32 - 1)
@example(2**31, 0)
@given(st.integers(0, 2**32 - 1), WORDS)
def test_normals_are_equal_in_every_branch(first: int, second: int) -> None:
    """In the middle, in the tails and far out, which single draws hardly ever reach."""
    for shift in (0, 8, 16, 24, 31):
        for a in (first >> shift, philox.WORD - (first >> shift)):
            nonconforming = float(2 * (a * 1048576 + (second >> 12)) + 1)
            assert draws._normals(np.array([nonconforming]))[0] == philox.normal_of(a, second)
