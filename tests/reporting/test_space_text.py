import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.reporting.text_columns import cut, space_text


@pytest.mark.parametrize(
    ("space", "expected"),
    [
        (None, "?"),
        (spaces.Discrete(3), "Discrete(3)"),
        (spaces.Discrete(3, start=-1), "Discrete(3, from -1)"),
        (spaces.Box(0, 4, (1,), np.int64), "Box(0 to 4, [1], int64)"),
        (spaces.Box(-np.inf, np.inf, (2, 3), np.float32), "Box(-inf to inf, [2, 3], float32)"),
        (
            spaces.Box(np.float32([0, 0]), np.float32([1, 2.5])),
            "Box(within 0 to 2.5, [2], float32)",
        ),
        (spaces.Box(0, 1, ()), "Box(0 to 1, [], float32)"),
        (spaces.Box(0, 1, (0,)), "Box(empty, [0], float32)"),
        (spaces.MultiDiscrete([2, 3]), "MultiDiscrete(2 3)"),
        (spaces.MultiDiscrete([2] * 9), "MultiDiscrete(2 2 2 2 2 2 …)"),
        (spaces.MultiBinary((2, 2)), "MultiBinary([2, 2])"),
        (spaces.Text(9), "Text(1 to 9 characters)"),
        (
            spaces.Dict(a=spaces.Discrete(2), b=spaces.Discrete(3)),
            "{a: Discrete(2), b: Discrete(3)}",
        ),
        (spaces.Tuple([spaces.Discrete(2)]), "(Discrete(2))"),
        (spaces.Sequence(spaces.Discrete(2)), "Sequence(Discrete(2))"),
        (
            spaces.OneOf([spaces.Discrete(2), spaces.Text(2)]),
            "one of Discrete(2) | Text(1 to 2 charac…",
        ),
        (spaces.Box(0, 1, (2,), np.bool_), "Box(0 to 1, [2], bool)"),
    ],
)
def test_space_text_says_the_space_in_a_few_words(space, expected):
    """Each kind of space has a short form, cut to the limit."""
    assert space_text(space, limit=40) == expected


def test_space_text_of_unknown_and_deep_spaces_stays_short():
    """A space of another library is its name; nesting ends somewhere."""

    class Nonconforming(spaces.Space):
        def __repr__(self):
            pytest.fail("foreign code isn't asked")

    assert space_text(Nonconforming()) == "Nonconforming"
    assert space_text(spaces.Graph(spaces.Discrete(2), None)).startswith("Graph(")
    deep = spaces.Discrete(2)
    for _ in range(30):
        deep = spaces.Tuple([deep])
    assert space_text(deep, limit=1_000) == "((((((((…))))))))"


def test_cut_keeps_to_its_limit():
    """A text of the limit stays whole, a longer one ends in an ellipsis."""
    assert cut("abcd", 4) == "abcd"
    assert cut("abcde", 4) == "abc…"
    assert cut("abc", 1) == "…"
