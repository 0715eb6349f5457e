"""Arrays of draws are the draws that a stream makes one by one, to the last bit."""

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
    """Drawn one by one, ahead, or as an array, from an odd word too; among them some tails."""
    words = draws.words(Stream(seed), 6003).tolist()
    expected = [philox.normal_of(*words[at : at + 2]) for at in range(3, 6003, 2)]
    assert np.abs(expected).max() > 3
    stream = Stream(seed)
    stream.draws = 3
    assert draws.normals(stream, 3000).tolist() == expected
    assert [stream.normal() for _ in range(3000)] == expected
    following = Stream(seed)
    following.follow(stream)
    first = [following.word() for _ in range(3)]
    assert words == first + [following.word() for _ in range(6000)]
    following = Stream(seed)
    following.follow(stream)
    following.draws = 3
    found = [following.normal() for _ in range(700)]
    other = following.copy()
    assert expected[:1400] == found + [other.normal() for _ in range(700)]


@given(st.lists(st.sampled_from(["normal", "word", "uniform"]), min_size=40, max_size=40))
def test_mixed_draws_are_the_same_ahead(kinds: list[str]) -> None:
    """A stream that works its numbers out ahead gives what one that doesn't gives."""
    before = Stream(1)
    for _ in range(2000):
        before.normal()
    ahead = Stream(2)
    ahead.follow(before)
    for kind in kinds:
        alone = Stream.from_state(ahead.state)
        assert getattr(alone, kind)() == getattr(ahead, kind)()
    assert ahead._normals or "normal" not in kinds[:-1]


@example(0, 0)
@example(2**32 - 1, 2**32 - 1)
@example(2**31, 0)
@given(st.integers(0, 2**32 - 1), WORDS)
def test_normals_are_equal_in_every_branch(first: int, second: int) -> None:
    """In the middle, in the tails and far out, which single draws hardly ever reach."""
    for shift in (0, 8, 16, 24, 31):
        for a in (first >> shift, philox.WORD - (first >> shift)):
            pair = np.array([[a], [second]], np.uint64)
            assert draws._normals_of(*pair)[0] == philox.normal_of(a, second)
