"""One counted stream of random numbers."""

import copy
import math
import pickle
from collections import Counter
from statistics import NormalDist, fmean

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import DrawError
from gamekeeper.randomness.philox import STEP, log_of, normal_of, philox4x32, unit_of
from gamekeeper.randomness.stream import Stream

SEEDS = st.integers(0, 2**64 - 1)
WORDS = st.integers(0, 2**32 - 1)
PLACES = st.tuples(SEEDS, WORDS, WORDS, st.integers(0, 2**66 - 1))


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        (
            "00000000 00000000 00000000 00000000",
            "00000000 00000000",
            "6627e8d5 e169c58d bc57ac4c 9b00dbd8",
        ),
        (
            "ffffffff ffffffff ffffffff ffffffff",
            "ffffffff ffffffff",
            "408f276d 41c83b0e a20bc7c6 6d5451fd",
        ),
        (
            "243f6a88 85a308d3 13198a2e 03707344",
            "a4093822 299f31d0",
            "d16cfe09 94fdcceb 5001e420 24126ea1",
        ),
    ],
)
def test_philox_gives_the_known_answers(counter: str, key: str, words: str) -> None:
    """The three vectors of Random123's kat_vectors for philox4x32 with ten rounds."""
    given_words = [int(word, 16) for word in f"{counter} {key}".split()]
    assert words == " ".join(f"{word:08x}" for word in philox4x32(*given_words))


@given(PLACES)
def test_stream_is_laid_out_as_its_page_says(place: tuple[int, int, int, int]) -> None:
    """Word d is word d % 4 of block d // 4, under key and counter as documented."""
    seed, episode, lane, draws = place
    block = draws // 4
    expected = philox4x32(
        block % 2**32, block // 2**32, episode, lane, seed % 2**32, seed // 2**32
    )[draws % 4]
    assert expected == Stream.from_state(place).word()


def test_stream_draws_the_same_everywhere() -> None:
    """Draws of every kind, pinned to the last bit: the scheme may not change."""
    rng = Stream(2024, 7)
    drawn = [rng.word(), rng.integers(10), rng.integers(-5, 5), rng.integers(2**40)]
    assert drawn == [1200655132, 3, 4, 889478535940]
    assert [rng.uniform().hex(), rng.uniform(-4.0, 2.0).hex()] == [
        "0x1.42f8eddd12860p-2",
        "-0x1.7ec1b9fd41d16p+1",
    ]
    assert [rng.normal().hex(), rng.normal(10.0, 0.5).hex()] == [
        "0x1.01cac6dc662aep-3",
        "0x1.463862abd6abcp+3",
    ]
    order = list(range(8))
    rng.shuffle(order)
    assert order == [0, 5, 2, 1, 3, 6, 7, 4]
    assert (rng.choice("abc"), rng.choice("abc", weights=[1, 2, 0.5])) == ("a", "b")


@given(SEEDS, WORDS, WORDS)
def test_streams_of_seed_episode_and_lane_are_apart(seed: int, episode: int, lane: int) -> None:
    """Another seed, episode or lane is another stream."""
    here = Stream(seed, episode, lane=lane)
    others = [
        Stream(seed ^ 1, episode, lane=lane),
        Stream(seed ^ 2**63, episode, lane=lane),
        Stream(seed, episode ^ 1, lane=lane),
        Stream(seed, episode, lane=lane ^ 1),
    ]
    drawn = [tuple(stream.word() for _ in range(4)) for stream in (here, *others)]
    assert len(set(drawn)) == 5


BEFORE_THE_END = st.tuples(SEEDS, WORDS, WORDS, st.integers(0, 2**66 - 100))
"""Places after which a stream has some words left."""


@given(BEFORE_THE_END, st.integers(0, 9))
def test_state_holds_the_whole_stream(place: tuple[int, int, int, int], ahead: int) -> None:
    """A stream made from a state, a copy, a deep copy and a pickled one all go on alike."""
    stream = Stream.from_state(place)
    for _ in range(ahead):
        stream.word()
    counterfactuals = [
        Stream.from_state(stream.state),
        stream.copy(),
        copy.copy(stream),
        copy.deepcopy(stream),
        pickle.loads(pickle.dumps(stream)),
    ]
    assert [stream] * 5 == counterfactuals
    expected = [stream.normal() for _ in range(3)]
    assert [expected] * 5 == [
        [counterfactual.normal() for _ in range(3)] for counterfactual in counterfactuals
    ]
    assert stream != Stream.from_state(place)


@given(st.tuples(SEEDS, WORDS, WORDS, st.integers(0, 2**66 - 3000)), st.integers(0, 3))
@settings(max_examples=8)
def test_many_words_in_a_row_are_those_of_their_numbers(
    place: tuple[int, int, int, int], skipped: int
) -> None:
    """Words that are worked out ahead are the blocks' own, and a copy goes on in their midst."""
    seed, episode, lane, first = place
    rng = Stream.from_state(place)
    found, copies = [], []
    for number in range(2500):
        if number % 611 == skipped:
            copies.append((number, rng.copy()))
        found.append(rng.word())
    key = (seed & 0xFFFFFFFF, seed >> 32)
    expected = []
    for block in range(first >> 2, (first + 2500 + 3) >> 2):
        expected += philox4x32(block & 0xFFFFFFFF, block >> 32, episode, lane, *key)
    assert expected[first & 3 :][:2500] == found
    assert all(
        found[number:][:9] == [one.word() for _ in range(9)]
        for number, one in copies
        if number < 2490
    )


def test_draws_may_be_set_back_and_ahead() -> None:
    """The count of words is all that moves a stream."""
    rng = Stream(3)
    first = [rng.word() for _ in range(20)]
    rng.draws = 5
    assert first[5:9] == [rng.word() for _ in range(4)]
    rng.draws = 0
    assert first[:3] == [rng.word() for _ in range(3)]


def test_fork_leaves_the_stream_as_it_was() -> None:
    """Noise drawn from another lane changes no other draw."""
    plain, noisy = Stream(5, 1), Stream(5, 1)
    lane = noisy.fork(1)
    drawn = []
    for _ in range(10):
        drawn.append(noisy.integers(100))
        lane.normal()
    assert [plain.integers(100) for _ in range(10)] == drawn
    assert Stream(5, 2) == plain.next_episode()


@given(SEEDS, st.integers(-(2**62), 2**62), st.integers(1, 2**63))
def test_integers_stay_in_their_bounds(seed: int, low: int, span: int) -> None:
    """Every number is in [low, high), a Python int, whatever integer type the bounds are."""
    rng = Stream(seed)
    for _ in range(5):
        number = rng.integers(low, low + span)
        assert low <= number < low + span
        assert type(number) is int
    assert type(rng.integers(np.int32(3), np.uint8(200))) is int


@pytest.mark.parametrize("span", [2, 3, 7, 10, 1000])
def test_integers_are_even(span: int) -> None:
    """Counts of 20,000 draws lie within five standard deviations of even."""
    rng = Stream(11)
    count = Counter(rng.integers(span) for _ in range(20_000))
    expected = 20_000 / span
    assert all(abs(count[value] - expected) < 5 * math.sqrt(expected) for value in range(span))


def test_integers_show_no_bias_where_words_do() -> None:
    """3 * 2**30 values out of 2**32 words: plain multiplying would give every third one twice."""
    rng = Stream(1)
    count = Counter(rng.integers(3 * 2**30) % 3 for _ in range(12_000))
    assert all(abs(count[rest] - 4_000) < 5 * math.sqrt(4_000) for rest in range(3))
    assert rng.draws > 12_000  # a quarter of the words are refused


@given(WORDS, WORDS)
def test_uniform_is_one_of_the_even_steps(first: int, second: int) -> None:
    """A number of [0, 1) with 53 bits."""
    unit = unit_of(first, second)
    assert 0.0 <= unit < 1.0
    assert float(unit / STEP).is_integer()


@given(WORDS, WORDS)
def test_normal_is_the_quantile_and_antisymmetric(first: int, second: int) -> None:
    """Agrees with the standard library's quantile; the opposite words give the opposite number."""
    z = normal_of(first, second)
    level = (2 * ((first << 20) | (second >> 12)) + 1) * STEP
    assert z == pytest.approx(NormalDist().inv_cdf(level), rel=1e-14, abs=1e-16)
    assert -z == normal_of(first ^ 0xFFFFFFFF, second ^ 0xFFFFFFFF)


@given(st.floats(min_value=5e-324, max_value=1.7e308))
def test_logarithm_of_our_own_is_exact_to_three_steps(x: float) -> None:
    """Made of basic operations, it stays within three units in the last place of the library's."""
    expected = math.log(x)
    assert abs(log_of(x) - expected) <= 3 * math.ulp(expected)


def test_normal_has_mean_and_deviation() -> None:
    """Moments of 20,000 draws are those asked for, and float32 bounds lose nothing."""
    rng = Stream(9)
    drawn = [rng.normal(3.0, 2.0) for _ in range(20_000)]
    assert fmean(drawn) == pytest.approx(3.0, abs=0.05)
    assert fmean((each - 3.0) ** 2 for each in drawn) == pytest.approx(4.0, rel=0.05)
    assert Stream(9).normal(np.float32(3), np.float32(2)) == drawn[0]
    assert Stream(9).uniform(np.float32(1), np.float32(3)) == Stream(9).uniform(1.0, 3.0)


@given(SEEDS, st.lists(st.integers(), max_size=40))
def test_shuffle_keeps_the_items(seed: int, items: list[int]) -> None:
    """A shuffled list is a permutation, and the same one for the same stream."""
    once, again = items[:], items[:]
    Stream(seed).shuffle(once)
    Stream(seed).shuffle(again)
    assert sorted(items) == sorted(once)
    assert again == once


def test_shuffle_gives_every_order() -> None:
    """The 24 orders of four items come equally often."""
    rng = Stream(4)
    count: Counter[tuple[int, ...]] = Counter()
    for _ in range(12_000):
        items = [0, 1, 2, 3]
        rng.shuffle(items)
        count[tuple(items)] += 1
    assert len(count) == 24
    assert all(abs(seen - 500) < 5 * math.sqrt(500) for seen in count.values())


def test_choice_follows_its_weights() -> None:
    """Items come as often as their weights say; those of weight 0 never."""
    rng = Stream(8)
    count = Counter(rng.choice("abcd", weights=[1, 0, 3, 0]) for _ in range(8_000))
    assert {"a", "c"} == set(count)
    assert count["a"] == pytest.approx(2_000, abs=5 * math.sqrt(2_000))
    assert {5} == {rng.choice([5]), rng.choice(range(5, 6)), rng.choice(np.array([5]))}


@pytest.mark.parametrize(
    "draw",
    [
        lambda rng: rng.integers(5, 5),
        lambda rng: rng.integers(0),
        lambda rng: rng.integers(-(2**63), 2**63),
        lambda rng: rng.normal(0.0, -1.0),
        lambda rng: rng.normal(0.0, math.nan),
        lambda rng: rng.choice([]),
        lambda rng: rng.choice({1, 2}),
        lambda rng: rng.choice({1: 2}),
        lambda rng: rng.choice("ab", weights=[1]),
        lambda rng: rng.choice("ab", weights=[0, 0]),
        lambda rng: rng.choice("ab", weights=[1, -1]),
        lambda rng: rng.choice("ab", weights=[1, math.nan]),
        lambda rng: rng.shuffle(np.zeros((2, 2))),
    ],
)
def test_draw_from_nothing_is_refused_and_takes_nothing(draw: object) -> None:
    """What can't be drawn is said as such, and the stream stays where it was."""
    rng = Stream(0)
    with pytest.raises(DrawError):
        draw(rng)  # type: ignore[operator]
    assert rng.draws == 0


@pytest.mark.parametrize(
    "made",
    [
        lambda: Stream(-1),
        lambda: Stream(2**64),
        lambda: Stream("1"),
        lambda: Stream(1.0),
        lambda: Stream(1, 2**32),
        lambda: Stream(1, lane=-1),
        lambda: Stream.from_state((1, 2, 3)),
        lambda: Stream.from_state((1, 2, 3, -1)),
    ],
)
def test_stream_out_of_range_is_refused(made: object) -> None:
    """A number that would be cut silently is no seed, episode or lane."""
    with pytest.raises(DrawError, match="stream"):
        made()  # type: ignore[operator]


def test_integers_take_whole_numbers_only() -> None:
    """A float is no bound."""
    with pytest.raises(TypeError):
        Stream(0).integers(2.5)  # type: ignore[arg-type]
