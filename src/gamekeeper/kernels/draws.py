"""Random numbers for rules: those of our Stream, from four integers in the state.

The same words, in the same order, as `gamekeeper.randomness.stream.Stream(seed)` gives.
"""

import types
from typing import Any, Final

from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.randomness import philox

FIELDS: Final = (
    ("seed", "i8"),
    ("episode", "i8"),
    ("lane", "i8"),
    ("draws", "i8"),
    ("block", "i8"),
    ("words", "i8", (4,)),
)
"""Fields of a copy's state that name its stream; the words of the last block stand beside."""
WORD: Final = philox.WORD
SPAN: Final = philox.SPAN


def _rule_of(function: Any, **callees: Any) -> Any:
    """A function of the core as a rule, those that it calls being rules too."""
    names = {**function.__globals__, **callees}
    return rule(types.FunctionType(function.__code__, names, function.__name__))


_philox = _rule_of(philox.philox4x32)
_unit_of = _rule_of(philox.unit_of)
_normal_of = _rule_of(
    philox.normal_of, log_of=_rule_of(philox.log_of), _ratio=_rule_of(philox._ratio)
)


@rule
def word(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """The next 32-bit word of the copy's stream."""
    drawn = s.draws
    s.draws = drawn + 1
    # A block is four words; the last one stands in the state until a draw leaves it.
    block = drawn >> 2
    if block != s.block:
        a, b, c, d = _philox(
            block & WORD, block >> 32, s.episode, s.lane, s.seed & WORD, (s.seed >> 32) & WORD
        )
        s.words[0] = a
        s.words[1] = b
        s.words[2] = c
        s.words[3] = d
        s.block = block
    return s.words[drawn & 3]


@rule
def integers(s, bound):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """A whole number in [0, bound), for bounds of at most 2**31; as `Stream.integers`.

    Source: Lemire 2019, "Fast random integer generation in an interval".
    """
    product = word(s) * bound
    # Refusing the first SPAN % bound places leaves each number equally many words; mostly no
    # division is needed to know that a product isn't among them.
    if (product & WORD) < bound:
        refused = SPAN % bound
        while (product & WORD) < refused:
            product = word(s) * bound
    return product >> 32


@rule
def uniform(s, low, high):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """A number in [low, high); as `Stream.uniform`."""
    first = word(s)
    return low + (high - low) * _unit_of(first, word(s))


@rule
def normal(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """A standard normal number; as `Stream.normal`."""
    first = word(s)
    return _normal_of(first, word(s))
