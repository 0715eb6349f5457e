from fnmatch import fnmatchcase
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract.pattern import exact, is_exact, matches, overlap

patterns = st.text("ab*?[]!-", max_size=7)
names = st.text("ab-![]*", max_size=6)


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        ("picker_*", "carrier_*", False),
        ("picker_*", "*", True),
        ("picker_*", "picker_1", True),
        ("picker_?", "picker_10", False),
        ("*_1", "picker_*", True),
        ("a*b", "*c", False),
        ("a*b", "*cb", True),
        ("[ab]x", "[bc]x", True),
        ("[ab]x", "[!a-m]x", False),
        ("[!a]", "[!b]", True),
        ("", "*", True),
        ("", "?", False),
        ("[b-a]", "*", False),
        ("[", "[[]", True),
        ("Picker", "picker", False),
    ],
)
def test_overlap_is_known_for_usual_patterns(one, other, expected):
    """Two patterns overlap where one name fits both, told in either order."""
    assert overlap(one, other) is expected
    assert overlap(other, one) is expected


@given(patterns, patterns, names)
def test_overlap_never_denies_a_common_name(one, other, name):
    """Where a name fits both patterns, they overlap."""
    if fnmatchcase(name, one) and fnmatchcase(name, other):
        assert overlap(one, other)


EVERY = ["".join(chars) for size in range(5) for chars in product("abc[]!?*", repeat=size)]


@given(st.text("ab?[]!", max_size=4), st.text("ab?[]!", max_size=4))
def test_overlap_finds_a_name_where_it_claims_one(one, other):
    """Where patterns without a star overlap, one of all short names fits both."""
    common = any(fnmatchcase(name, one) and fnmatchcase(name, other) for name in EVERY)
    assert overlap(one, other) is common


@given(st.text("ab*[]!", max_size=3), st.text("ab*", max_size=3))
def test_overlap_of_stars_finds_a_name_too(one, other):
    """A common name of patterns with stars needs no more characters than both have signs."""
    common = any(fnmatchcase(name, one) and fnmatchcase(name, other) for name in EVERY)
    assert overlap(one, other) is common


@given(st.text(max_size=8), st.text(max_size=8))
def test_exact_pattern_covers_its_name_alone(name, other):
    """Signs of patterns in a name stand for themselves."""
    assert matches(exact(name), name)
    assert matches(exact(name), other) == (name == other)


def test_is_exact_tells_names_from_patterns():
    """Only a text without signs of patterns is one name."""
    assert is_exact("picker_0")
    assert not any(map(is_exact, ("picker_*", "picker_?", "picker_[01]")))
