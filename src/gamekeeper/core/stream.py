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

from collections.abc import MutableSequence, Sequence
from operator import index
from typing import Any, Final, SupportsIndex, TypeVar

from gamekeeper.core.philox import SPAN, WORD, normal_of, philox4x32, unit_of
from gamekeeper.errors import DrawError

T = TypeVar("T")

SEEDS: Final = 1 << 64
WIDEST: Final = 1 << 63  # a kernel's integers are 64 bits wide, with a sign
NO_WORDS: Final = (0, 0, 0, 0)


class Stream:
    """The random numbers of one episode, in the order they are drawn, the same on every platform.

    `seed`, `episode` and `lane` name the stream, `draws` counts the words taken from it; all four
    may be read, and `draws` may be set to go back or ahead.
    """

    __slots__ = ("_block", "_words", "draws", "episode", "lane", "seed")

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
        self._block = -1
        self._words = NO_WORDS

    def word(self) -> int:
        """The next 32-bit word, which every other draw is made of."""
        draws = self.draws
        self.draws = draws + 1
        block = draws >> 2
        if block != self._block:
            seed = self.seed
            self._words = philox4x32(
                block & WORD, block >> 32, self.episode, self.lane, seed & WORD, seed >> 32
            )
            self._block = block
        return self._words[draws & 3]

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
        unit = unit_of(self.word(), self.word())
        low = float(low)
        return low + (float(high) - low) * unit

    def normal(self, mean: float = 0.0, deviation: float = 1.0) -> float:
        """A number from the normal distribution, mean + deviation * z, by inversion of two words.

        Raises:
            DrawError: the deviation is negative or not a number.
        Source: `gamekeeper.core.philox.normal_of`.
        """
        if not deviation >= 0.0:
            raise DrawError(
                "a standard deviation is negative",
                where="normal(deviation=...)",
                expected="0 or more",
                seen=repr(deviation),
            )
        return float(mean) + float(deviation) * normal_of(self.word(), self.word())

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
                seen=type(items).__name__,
                mend="hand over sorted(items): a set's order differs from process to process",
            )
        if weights is not None:
            return items[self._weighted(len(items), weights)]
        if not len(items):
            raise DrawError(
                "a choice was asked from nothing", seen=f"an empty {type(items).__name__}"
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
                seen=f"{getattr(items, 'ndim', '?')} axes",
                mend="shuffle a list of indices and take the rows by it",
            )
        for last in range(len(items) - 1, 0, -1):
            other = self.integers(last + 1)
            items[last], items[other] = items[other], items[last]

    def fork(self, lane: SupportsIndex) -> Stream:
        """The stream of another lane of the same seed and episode, at its beginning.

        What draws from a lane of its own (a knob's noise, say) leaves every other draw as it was.
        """
        return Stream(self.seed, self.episode, lane=lane)

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
                seen=repr(state),
            )
        stream = cls(state[0], state[1], lane=state[2])
        stream.draws = _within(state[3], 4 * SEEDS, "draws")
        return stream

    def copy(self) -> Stream:
        """Another stream at the same place; the two go on alike and apart."""
        twin = Stream(self.seed, self.episode, lane=self.lane)
        twin.draws, twin._block, twin._words = self.draws, self._block, self._words
        return twin

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
                seen=f"{span} values",
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
                seen=repr(list(weights))[:200],
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
            seen=repr(value),
        )
    return number
