"""One stream of random numbers, counted and not stored (Philox 4x32-10).

Word number d of a stream is a pure function of (seed, episode, lane, d):

    key      seed: 64 bits, the low word first
    counter  block d // 4: 64 bits, the low word first; then episode, then lane: 32 bits each
    word d   word d % 4 of that block

Nothing else is carried along. A copy costs four integers, no episode depends on how long the one
before it was, and a kernel that knows the four integers draws the same numbers. How many words a
draw takes: `uniform`, `normal` and a weighted `choice` two; `integers` one (two for more than 2**32
values), plus as many again each time a word is refused, which happens to less than one in two;
`shuffle` what its integers take. This scheme is part of the record's promise and doesn't change.
"""

from __future__ import annotations

import sys
from collections.abc import MutableSequence, Sequence
from operator import index
from typing import Any, Final, SupportsIndex, TypeVar

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import DrawError
from gamekeeper.randomness import philox
from gamekeeper.randomness.philox import SPAN, WORD, normal_of, unit_of

T = TypeVar("T")

SEEDS: Final = 1 << 64
_STEPS: Final = tuple((i * philox.W0, i * philox.W1) for i in range(10))  # of a key, by round
WIDEST: Final = 1 << 63  # a kernel's integers are 64 bits wide, with a sign
ONE_BY_ONE: Final = 12  # blocks in a row that are worked out alone, for the price of 64 at once
AT_ONCE: Final = (64, 256)  # blocks worked out after them, the first time and from then on
NORMALS_ALONE: Final = 8  # normal numbers worked out alone, before all that lie ahead are at once,
LEAST_AHEAD: Final = 160  # if so many words do


class Stream:
    """The random numbers of one episode, in the order they are drawn, the same on every platform.

    `seed`, `episode` and `lane` name the stream, `draws` counts the words taken from it; all four
    may be read, and `draws` may be set to go back or ahead.
    """

    __slots__ = (
        "_ahead",
        "_alone",
        "_first",
        "_keys",
        "_likely",
        "_normals",
        "_run",
        "_worked_out",
        "draws",
        "episode",
        "lane",
        "seed",
    )

    def __init__(
        self, seed: SupportsIndex, episode: SupportsIndex = 0, *, lane: SupportsIndex = 0
    ) -> None:
        """Stands at word 0 of a stream.

        Args:
            seed: in [0, 2**64).
            episode: in [0, 2**32).
            lane: in [0, 2**32); streams of two lanes have nothing in common.
        Raises:
            DrawError: a number is out of its range.
        """
        self.seed: Final = _within(seed, SEEDS, "seed")
        self.episode: Final = _within(episode, SPAN, "episode")
        self.lane: Final = _within(lane, SPAN, "lane")
        self.draws = 0
        self._first, self._run, self._likely, self._alone = 0, 0, 0, 0
        self._ahead: Sequence[int] = ()  # words from number _first on
        self._worked_out: Words | None = None  # the same as an array, where many were at once
        self._normals: Sequence[float] = ()  # the normal number that begins at each of them
        self._keys = _keys_of(self.seed)

    def word(self) -> int:
        """The next 32-bit word, which every other draw is made of."""
        draws = self.draws
        self.draws = draws + 1
        at = draws - self._first
        if not 0 <= at < len(self._ahead):
            self._fetch(draws)
            at = draws - self._first
        return self._ahead[at]

    def _two_words(self) -> tuple[int, int]:
        """The next two words."""
        at = self.draws - self._first
        if 0 <= at < len(self._ahead) - 1:
            self.draws += 2
            return self._ahead[at], self._ahead[at + 1]
        return self.word(), self.word()

    def _fetch(self, draws: int) -> None:
        """Works out the words from that number's block on: many, once many were drawn in a row."""
        block = draws >> 2
        self._run = self._run + 1 if draws == self._first + len(self._ahead) else 0
        if self._ahead:
            self._alone = NORMALS_ALONE if self._normals else 0
        self._first, self._normals = 4 * block, ()
        likely, self._likely = -(-self._likely // 4), 0
        if likely > 2 * ONE_BY_ONE:
            self._run = ONE_BY_ONE
            blocks = min(likely + likely // 8, 4 * AT_ONCE[1])
        elif self._run < ONE_BY_ONE:
            self._ahead, self._worked_out = _one_block(self, block), None
            return
        else:
            blocks = AT_ONCE[self._run > ONE_BY_ONE]
        self._worked_out = words_from(self, block, blocks).reshape(-1)
        self._ahead = self._worked_out.tolist()

    def follow(self, last: Stream) -> None:
        """Works out as many words at once as another stream gave, when the first is drawn.

        The numbers stay the same.
        """
        self._likely, self._alone = last.draws, NORMALS_ALONE if last._normals else 0

    def _normal(self) -> float:
        """The next two words as a normal number; after some of them, all that lie ahead at once."""
        self._alone += 1
        drawn = normal_of(*self._two_words())
        ahead = self._worked_out  # perhaps just fetched
        if self._alone > NORMALS_ALONE and ahead is not None and len(ahead) >= LEAST_AHEAD:
            self._normals = _normals_of(ahead[:-1], ahead[1:]).tolist()
        return drawn

    def integers(self, low: SupportsIndex, high: SupportsIndex | None = None) -> int:
        """A whole number in [low, high), or in [0, low) where no `high` is given, without bias.

        Args:
            low: the least value, or, alone, the bound of values that begin at 0.
            high: one more than the greatest value; high - low is at most 2**63.
        Raises:
            DrawError: there is nothing between the bounds, or too much.
        Source: Lemire 2019, "Fast random integer generation in an interval" (multiply, keep the
            upper word, refuse where the lower one shows bias); above 2**32 values: a bit mask.
        """
        least, bound = (0, index(low)) if high is None else (index(low), index(high))
        span = bound - least
        if not 0 < span <= SPAN:
            return least + self._wide(span, least, bound)
        product = self.word() * span
        if (product & WORD) < span:
            refused = SPAN % span
            while (product & WORD) < refused:
                product = self.word() * span
        return least + (product >> 32)

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:
        """A number in [low, high), low + (high - low) * u with u one of 2**53 steps in [0, 1).

        As everywhere in floating point, rounding may return `high` itself where u is next to 1.
        """
        unit = unit_of(*self._two_words())
        low = float(low)
        return low + (float(high) - low) * unit

    def normal(self, mean: float = 0.0, deviation: float = 1.0) -> float:
        """A number from the normal distribution, mean + deviation * z, by inversion of two words.

        Raises:
            DrawError: the deviation is negative or not a number.
        Source: `gamekeeper.randomness.philox.normal_of`.
        """
        if not deviation >= 0.0:
            raise DrawError(
                "a standard deviation is negative",
                where="normal(deviation=...)",
                expected="0 or more",
                actual=repr(deviation),
                fix="give a deviation of 0 or more",
            )
        at = self.draws - self._first
        if 0 <= at < len(self._normals):
            self.draws += 2
            return float(mean) + float(deviation) * self._normals[at]
        return float(mean) + float(deviation) * self._normal()

    def choice(self, items: Sequence[T], *, weights: Sequence[float] | None = None) -> T:
        """One of the items, each as likely as any other, or as its weight says.

        Args:
            items: a sequence; sets have no order that two processes share.
            weights: one for each item, finite and not negative, not all 0; any sum.
        Raises:
            DrawError: there are no items, they have no order, or the weights don't fit.
        """
        if not hasattr(items, "__getitem__") or hasattr(items, "keys"):
            raise DrawError(
                "a choice was asked from a collection without positions",
                expected="a list, tuple, range, text or array",
                actual=type(items).__name__,
                fix="hand over sorted(items): a set's order differs from process to process",
            )
        if weights is not None:
            return items[self._weighted(len(items), weights)]
        if not len(items):
            raise DrawError(
                "a choice was asked from nothing",
                actual=f"an empty {type(items).__name__}",
                fix="choose from at least one item",
            )
        return items[self.integers(len(items))]

    def shuffle(self, items: MutableSequence[Any]) -> None:
        """Puts the items into a random order, in place, every order as likely as any other.

        Raises:
            DrawError: the items are an array of more than one axis, whose rows can't be swapped.
        Source: Durstenfeld 1964, algorithm 235 (from the last position down).
        """
        if getattr(items, "ndim", 1) != 1:
            raise DrawError(
                "an array of several axes can't be shuffled in place",
                expected="a list, or an array of one axis",
                actual=f"{getattr(items, 'ndim', '?')} axes",
                fix="shuffle a list of indices and take the rows by it",
            )
        for last in range(len(items) - 1, 0, -1):
            other = self.integers(last + 1)
            items[last], items[other] = items[other], items[last]

    def fork(self, lane: SupportsIndex) -> Stream:
        """The stream of another lane of the same seed and episode, at its beginning.

        What draws from a lane of its own (a knob's noise, say) leaves every other draw as it was.
        """
        return Stream(self.seed, self.episode, lane=lane)

    def leave(self, number: int) -> None:
        """Becomes the stream of another seed, at its beginning; lanes forked off it follow.

        Args:
            number: in [0, 2**31); equal numbers lead from one stream to one other.
        """
        seed = (self.seed + ((number + 1) << 32)) % SEEDS
        Stream.__init__(self, seed, self.episode, lane=self.lane)

    def next_episode(self) -> Stream:
        """The stream of the episode after this one, at its beginning."""
        return Stream(self.seed, self.episode + 1, lane=self.lane)

    @property
    def state(self) -> tuple[int, int, int, int]:
        """All there is to know: seed, episode, lane, draws."""
        return (self.seed, self.episode, self.lane, self.draws)

    @classmethod
    def from_state(cls, state: Sequence[SupportsIndex]) -> Stream:
        """The stream that `state` was read from, at the same place.

        Raises:
            DrawError: these aren't four numbers in their ranges.
        """
        if len(state) != 4:
            raise DrawError(
                "this is no state of a stream",
                expected="seed, episode, lane, draws",
                actual=repr(state),
                fix="restore what state() of a stream returned",
            )
        stream = cls(state[0], state[1], lane=state[2])
        stream.draws = _within(state[3], 4 * SEEDS, "draws")
        return stream

    def copy(self) -> Stream:
        """Another stream at the same place; the two go on alike and apart."""
        other = Stream(self.seed, self.episode, lane=self.lane)
        other.draws, other._run, other._first = self.draws, self._run, self._first
        other._ahead, other._worked_out = self._ahead, self._worked_out
        other._normals, other._alone, other._likely = self._normals, self._alone, self._likely
        return other

    __copy__ = copy

    def __deepcopy__(self, memo: dict[int, Any]) -> Stream:
        """A deep copy is a copy: a stream is made of numbers alone."""
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """A pickled stream is its state."""
        return (Stream.from_state, (self.state,))

    def __eq__(self, other: object) -> bool:
        """Two streams are equal where everything they will ever draw is."""
        return isinstance(other, Stream) and self.state == other.state

    __hash__ = None  # type: ignore[assignment]  # it moves on with every draw

    def __repr__(self) -> str:
        """Names the four integers."""
        numbers = zip(("seed", "episode", "lane", "draws"), self.state, strict=True)
        return f"Stream({', '.join(f'{name}={number}' for name, number in numbers)})"

    def _wide(self, span: int, low: int, high: int) -> int:
        """A whole number in [0, span), span above 2**32: two words under the least mask for it."""
        if not 0 < span <= WIDEST:
            raise DrawError(
                "there is no whole number to draw" if span <= 0 else "the bounds are too far apart",
                where=f"integers({low}, {high})",
                expected="low < high, at most 2**63 apart",
                actual=f"{span} values",
                fix="give low below high",
            )
        mask = (1 << (span - 1).bit_length()) - 1
        while (drawn := (self.word() << 32 | self.word()) & mask) >= span:
            pass
        return drawn

    def _weighted(self, count: int, weights: Sequence[float]) -> int:
        """A position: where the weights, added up, pass a uniform part of their sum."""
        total = 0.0
        for weight in weights:
            total += weight if 0.0 <= weight < float("inf") else float("nan")
        if len(weights) != count or not 0.0 < total < float("inf"):
            raise DrawError(
                "the weights of a choice don't fit its items",
                expected=f"{count} finite numbers >= 0, not all 0",
                actual=repr(list(weights))[:200],
                fix="give one weight for each item, at least one of them above 0",
            )
        left = self.uniform() * total
        passed = 0.0
        likely = [at for at, weight in enumerate(weights) if weight > 0.0]
        for at in likely:
            passed += weights[at]
            if left < passed:
                return at
        return likely[-1]  # rounding only: the sum of the parts may fall short of the product


def _within(value: SupportsIndex, bound: int, name: str) -> int:
    """The value as an integer of [0, bound), or a DrawError that names it."""
    try:
        number = index(value)
    except TypeError:
        number = -1
    if not 0 <= number < bound:
        raise DrawError(
            f"a stream's {name} is out of range",
            where=name,
            expected=f"a whole number in [0, 2**{bound.bit_length() - 1})",
            actual=repr(value),
            fix="give a whole number of this range",
        )
    return number


Floats = NDArray[np.float64]
Words = NDArray[np.uint64]

# arrays without an axis: NumPy takes a third of a microsecond more to read a number
_WORD: Final = np.array(philox.WORD, np.uint64)
_HALF: Final = np.array(32, np.uint64)
_LOW: Final = int(sys.byteorder == "big")  # place of a product's low word
_FACTORS: Final = np.array([[philox.M0], [philox.M1]], np.uint64)


def words(stream: Stream, count: int) -> Words:
    """[count] the words that the stream would give next; it stays where it is.

    Args:
        count: at least 1.
    """
    first, skipped = stream.draws >> 2, stream.draws & 3
    drawn = words_from(stream, first, (skipped + count + 3) // 4)
    return drawn.reshape(-1)[skipped : skipped + count]


def words_from(stream: Stream, first: int, count: int) -> Words:
    """[count, 4] the words of the stream's blocks from one on."""
    blocks = np.arange(first, first + count, dtype=np.uint64)
    even = np.empty((2, count), np.uint64)  # c0 and c2
    even[0], even[1] = blocks & _WORD, stream.episode
    # of a round's products the high words go into the next c0 and c2, the low ones are c1 and c3:
    # both are read where they lie, so that a round takes three calls
    products = np.empty((2, 2, count), np.uint64)
    halves = products.view(np.uint32).reshape(2, 2, count, 2)[:, ::-1]
    high, low = halves[..., 1 - _LOW], halves[..., _LOW]
    low[1, 0], low[1, 1] = blocks >> _HALF, stream.lane
    for number, key in enumerate(np.array(stream._keys, np.uint64).reshape(-1, 2, 1)):
        now = number % 2
        np.multiply(even, _FACTORS, out=products[now])
        np.bitwise_xor(high[now], low[1 - now], out=even)
        np.bitwise_xor(even, key, out=even)
    odd = low[1]  # of the tenth round
    return np.stack((even[0], odd[0], even[1], odd[1]), axis=-1)


def _one_block(stream: Stream, block: int) -> tuple[int, int, int, int]:
    """A block's words as `philox4x32` gives them; without its masks, as Python's integers grow."""
    c0, c1, c2, c3 = block & WORD, block >> 32, stream.episode, stream.lane
    for k0, k1 in stream._keys:
        p0, p1 = philox.M0 * c0, philox.M1 * c2
        c0, c1, c2, c3 = p1 >> 32 ^ c1 ^ k0, p1 & WORD, p0 >> 32 ^ c3 ^ k1, p0 & WORD
    return c0, c1, c2, c3


def _keys_of(seed: int) -> tuple[tuple[int, int], ...]:
    """The two words of the key in each of the ten rounds."""
    k0, k1 = seed & WORD, seed >> 32
    return tuple([((k0 + a) & WORD, (k1 + b) & WORD) for a, b in _STEPS])


def units(stream: Stream, count: int) -> Floats:
    """[count] what `uniform()` would give next, in [0, 1)."""
    pairs = words(stream, 2 * count).reshape(-1, 2)
    whole = (pairs[:, 0] >> np.uint64(5)) * np.uint64(67108864) + (pairs[:, 1] >> np.uint64(6))
    return whole.astype(np.float64) * philox.STEP


def normals(stream: Stream, count: int) -> Floats:
    """[count] what `normal()` would give next."""
    pairs = words(stream, 2 * count).reshape(-1, 2)
    return _normals_of(pairs[:, 0], pairs[:, 1])


def _normals_of(first: Words, second: Words) -> Floats:
    """Normal numbers of pairs of words, branch by branch of `philox.normal_of`."""
    shifted = first * np.uint64(1048576) + (second >> np.uint64(12))
    nonconforming = (shifted * np.uint64(2) + np.uint64(1)).astype(np.float64)  # out of 2**53
    q = nonconforming * philox.STEP - 0.5
    found = q * _ratio(0.180625 - q * q, _MIDDLE)
    tail = np.flatnonzero(np.abs(q) > 0.425)
    nonconforming, q = nonconforming[tail], q[tail]
    r = np.sqrt(-_log(np.minimum(nonconforming, philox.STEPS - nonconforming) * philox.STEP))
    x = _ratio(r - 1.6, _TAIL)
    if (r > 5.0).any():  # one number in 10**11
        x = np.where(r <= 5.0, x, _ratio(r - 5.0, _FAR))
    found[tail] = np.where(q < 0.0, -x, x)
    return found


def _log(x: Floats) -> Floats:
    """As `philox.log_of`."""
    m, exponent = np.frexp(x)
    is_low = m < philox._SQRT_HALF
    m, exponent = np.where(is_low, m * 2.0, m), exponent - is_low
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = np.zeros_like(s)
    for term in _ATANH:
        total *= z
        total += term
    return exponent * philox._LN2 + 2.0 * s * total


def _columns(top: philox._Poly, low: philox._Poly) -> Floats:
    """[8, 2, 1] coefficients of two polynomials, the highest power first."""
    return np.array([top, low]).T[:, :, None]


_ATANH: Final = [np.array(term) for term in philox._ATANH]
_MIDDLE: Final = _columns(philox._MID_TOP, philox._MID_LOW)
_TAIL: Final = _columns(philox._TAIL_TOP, philox._TAIL_LOW)
_FAR: Final = _columns(philox._FAR_TOP, philox._FAR_LOW)


def _ratio(r: Floats, coefficients: Floats) -> Floats:
    """[numbers] as `philox._ratio`: both polynomials go side by side."""
    both = coefficients[0] * r
    both += coefficients[1]
    for each in coefficients[2:]:
        both *= r
        both += each
    quotient: Floats = both[0] / both[1]
    return quotient
