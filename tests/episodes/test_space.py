"""Leaves of spaces, and values packed into them and back."""

import copy
import pickle
from collections import OrderedDict, namedtuple
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    Graph,
    GraphInstance,
    MultiBinary,
    MultiDiscrete,
    OneOf,
    Sequence,
    Space,
    Text,
    Tuple,
)
from hypothesis import assume, given
from hypothesis import strategies as st

from gamekeeper.episodes.spaces import Codec, Leaf, leaves
from gamekeeper.errors import EvidenceError
from tests.episodes.drawn_spaces import FIXED, SPACES, sample
from tests.episodes.sameness import same

F4, I8 = np.dtype("<f4"), np.dtype("<i8")
Pair = namedtuple("Pair", ["a", "b"])
OBSERVATION = Dict({"action_mask": Box(0, 1, (3,), np.int8), "seen": Tuple([Discrete(3), Text(4)])})


class Odds(Space[Any]):
    """A space class that nobody knows: odd numbers, and an error for all that is no number."""

    def contains(self, x: Any) -> bool:
        """Whether x is odd."""
        return bool(x % 2 == 1)


class NonconformingNumber(int):
    """An int that only its own code can build."""


def equal(value: Any, unpacked: Any, space: Space[Any]) -> bool:
    """Sameness, but that a numpy scalar may stand for an array without dimensions."""
    if isinstance(space, Dict):
        return all(equal(value[key], unpacked[key], space[key]) for key in space)
    if isinstance(space, Tuple):
        return all(map(equal, value, unpacked, space.spaces))
    if isinstance(space, Box) and space.shape == ():
        value = np.asarray(value, space.dtype)
    return same(value, unpacked)


def floats(*values: float) -> Any:
    """An array of float32."""
    return np.array(values, np.float32)


@given(SPACES, st.integers(0, 3))
def test_codec_gives_back_what_it_packed(space: Space[Any], seed: int) -> None:
    """Every sample of every space comes back equal, with its types, dtypes and shapes."""
    codec = Codec(space)
    value = sample(space, seed)
    payloads = codec.pack(value)
    assert payloads is not None
    assert len(codec.leaves) == len(payloads)
    assert equal(value, codec.unpack(payloads), space)
    assert payloads == codec.pack(codec.unpack(payloads))


@given(SPACES, st.integers(0, 3))
def test_codec_packs_one_leaf_bare(space: Space[Any], seed: int) -> None:
    """`pack_one` is there for one leaf only, and gives what `pack` gives."""
    codec = Codec(space)
    value = sample(space, seed)
    if len(codec.leaves) == 1:
        assert codec.pack_one is not None
        assert codec.pack(value) == (codec.pack_one(value),)
        assert codec.pack_one(object()) is None
    else:
        assert codec.pack_one is None


@given(FIXED, FIXED, st.integers(0, 3))
def test_codec_refuses_values_of_another_structure(
    space: Space[Any], other: Space[Any], seed: int
) -> None:
    """A value conforms to exactly the spaces of its leaves."""
    assume(described(space) != described(other))
    assert Codec(space).pack(sample(other, seed)) is None


def described(space: Space[Any]) -> object:
    """What makes two spaces hold values of different structure."""
    if isinstance(space, Dict):
        return {key: described(inner) for key, inner in space.spaces.items()}
    if isinstance(space, Tuple):
        return [described(inner) for inner in space.spaces]
    if isinstance(space, Text):
        return "text"
    return (space.dtype, space.shape)


@given(SPACES)
def test_codec_of_an_equal_space_has_the_same_signature(space: Space[Any]) -> None:
    """Equal spaces have equal leaves; copies and pickles of a codec are as good as it."""
    codec = Codec(space)
    assert leaves(space) == codec.leaves
    assert len(codec.leaves) == len({leaf.path for leaf in codec.leaves})
    for counterfactual in (
        Codec(copy.deepcopy(space)),
        copy.deepcopy(codec),
        pickle.loads(pickle.dumps(codec)),
    ):
        assert codec.signature == counterfactual.signature
        assert codec.leaves == counterfactual.leaves


@pytest.mark.parametrize(
    ("space", "expected"),
    [
        (Box(0, 1, (2, 3)), [Leaf("", "list", "<f4", (2, 3))]),
        (Box(0, 1, (2,), ">f8"), [Leaf("", "list", "<f8", (2,))]),
        (Box(0, 9, (16, 16), np.int16), [Leaf("", "list", "<i2", (16, 16))]),
        (Box(0, 9, (16, 17), np.int16), [Leaf("", "bytes", "<i2", (16, 17))]),
        (Box(0, 9, (2,), np.uint8), [Leaf("", "bytes", "|u1", (2,))]),
        (Box(0, 1, (2,), np.bool_), [Leaf("", "bytes", "|b1", (2,))]),
        (Box(0, 1, (0, 3)), [Leaf("", "bytes", "<f4", (0, 3))]),
        (Box(0, 1, (2,), np.longdouble), [Leaf("", "json", "", ())]),
        (Discrete(3), [Leaf("", "int", "<i8", ())]),
        (Discrete(3, dtype=np.uint8), [Leaf("", "int", "|u1", ())]),
        (MultiBinary([2, 2]), [Leaf("", "list", "|i1", (2, 2))]),
        (MultiDiscrete([2, 3], np.int32), [Leaf("", "list", "<i4", (2,))]),
        (Text(3), [Leaf("", "text", "", ())]),
        (Sequence(Discrete(2)), [Leaf("", "json", "", ())]),
        (Odds(), [Leaf("", "json", "", ())]),
        (Dict(), []),
        (
            Dict(OrderedDict(b=Discrete(2), a=Tuple([Text(1), Discrete(2)]))),
            [Leaf("a/0", "text", "", ()), *(Leaf(path, "int", "<i8", ()) for path in ("a/1", "b"))],
        ),
    ],
)
def test_leaves_are_columns_in_sorted_order(space: Space[Any], expected: list[Leaf]) -> None:
    """Kind, dtype and shape of each leaf follow from its space."""
    assert expected == list(leaves(space))


def test_leaves_have_paths_that_tell_keys_apart() -> None:
    """What means something in a path or in a file is encoded in a key."""
    keys = ["", "%", "/", "@", "a/b", "a%2Fb", "\n", "\ud800", "é", 1, "1", "%:1", (1, "/")]
    space = Dict({key: Discrete(2) for key in keys})
    paths = [leaf.path for leaf in leaves(space)]
    assert len(keys) == len(set(paths))
    assert {"%", "%25", "%2F", "%40", "a%2Fb", "a%252Fb", "%0A", "%uD800", "é"} < set(paths)
    assert {"1", "%:1", "%25:1"} < set(paths)
    "".join(paths).encode()
    assert not any("/" in path or "@" in path for path in paths)
    assert Codec(space).unpack([1] * len(keys)) == dict.fromkeys(keys, 1)


@pytest.mark.parametrize(
    ("space", "value"),
    [
        (Box(0, 1, (2,)), [0.0, 1.0]),
        (Box(0, 1, (2,)), np.zeros(2)),
        (Box(0, 1, (2,)), np.zeros((2, 1), np.float32)),
        (Box(0, 1, (2,)), np.zeros(2, ">f4")),
        (Box(0, 1, (2,)), np.ma.zeros(2, np.float32)),
        (Box(0, 1, (2,)), None),
        (Box(0, 1, ()), 0.5),
        (Box(0, 1, ()), np.float64(0.5)),
        (Box(0, 1, (2,), np.longdouble), np.zeros(2)),
        (MultiBinary(2), np.zeros(2, np.int64)),
        (MultiBinary(2), [0, 1]),
        (MultiDiscrete([2, 2]), np.zeros(2, np.int32)),
        (Discrete(3), True),
        (Discrete(3), np.True_),
        (Discrete(3), np.int32(1)),
        (Discrete(3), 1.0),
        (Discrete(3), np.array(1)),
        (Discrete(3), "1"),
        (Discrete(3), 2**63),
        (Discrete(3, dtype=np.int8), 200),
        (Discrete(3, dtype=np.uint64), np.uint64(2**63)),
        (Text(3), b"abc"),
        (Text(3), np.str_("abc")),
        (Text(3), "\ud800"),
        (OBSERVATION, {"action_mask": np.zeros(3, np.int8)}),
        (OBSERVATION, {"action_mask": np.zeros(3, np.int8), "seen": (1, "a"), "more": 1}),
        (OBSERVATION, {"action_mask": np.zeros(3, np.int8), "Seen": (1, "a")}),
        (OBSERVATION, {"action_mask": np.zeros(3, np.int8), "seen": [1, "a"]}),
        (OBSERVATION, {"action_mask": np.zeros(3, np.int8), "seen": Pair(1, "a")}),
        (OBSERVATION, {"action_mask": np.zeros(3, np.int8), "seen": (1,)}),
        (OBSERVATION, np.zeros(3)),
        (Sequence(Discrete(3)), [1]),
        (Sequence(Discrete(3)), (1, 1.0)),
        (Sequence(Discrete(3), stack=True), (1,)),
        (Sequence(Discrete(3), stack=True), np.zeros((2, 2), np.int64)),
        (
            Sequence(Dict(a=Box(0, 1), b=Discrete(2)), stack=True),
            {"a": np.zeros((2, 1), np.float32), "b": np.zeros(3, np.int64)},
        ),
        (OneOf([Discrete(3), Text(2)]), (1, 1)),
        (OneOf([Discrete(3), Text(2)]), (2, 1)),
        (OneOf([Discrete(3), Text(2)]), (-1, "a")),
        (OneOf([Discrete(3), Text(2)]), (0, 1, 2)),
        (Graph(Box(0, 1, (1,)), None), GraphInstance(np.zeros((2, 2), np.float32), None, None)),
        (
            Graph(Box(0, 1, (1,)), Discrete(2)),
            GraphInstance(floats(0)[None], np.zeros(2, np.int64), np.zeros((1, 2), np.int64)),
        ),
        (
            Graph(Box(0, 1, (1,)), Discrete(2)),
            GraphInstance(floats(0)[None], np.zeros(1, np.int64), None),
        ),
        (Odds(), 2),
        (Odds(), "no number"),
        (Odds(), NonconformingNumber(3)),
    ],
)
def test_codec_refuses_what_is_not_exactly_declared(space: Space[Any], value: Any) -> None:
    """Nothing is coerced: another type, dtype, shape or key isn't packed, and nothing warns."""
    assert Codec(space).pack(value) is None


@pytest.mark.parametrize(
    ("space", "value"),
    [
        (Box(0, 1, (2,)), floats(np.nan, 5)),
        (Box(0, 1, (2, 2)), np.asfortranarray(np.arange(4, dtype=np.float32).reshape(2, 2))),
        (Box(0, 1, (2,)), np.arange(4, dtype=np.float32)[::2]),
        (Box(0, 1, (2,), ">f4"), np.array([1, 2], ">f4")),
        (Box(0, 1, (2,), np.longdouble), np.array(["1.1", "nan"], np.longdouble)),
        (Discrete(3), np.int64(-7)),
        (Discrete(3, dtype=np.int16), np.int16(300)),
        (Text(2), "far too long, and é"),
        (OBSERVATION, {"seen": (np.int64(1), ""), "action_mask": np.zeros(3, np.int8)}),
        (Sequence(Discrete(3)), ()),
        (Sequence(Discrete(3), stack=True), np.zeros(0, np.int64)),
        (Odds(), 7),
    ],
)
def test_codec_packs_what_is_out_of_bounds_as_it_is(space: Space[Any], value: Any) -> None:
    """NaN, numbers out of bounds, odd strides and orders of keys are no reason to refuse."""
    payloads = Codec(space).pack(value)
    assert payloads is not None
    assert same(value, Codec(space).unpack(payloads))


def test_codec_grants_what_loses_nothing() -> None:
    """An int for Discrete, an OrderedDict, a scalar for an array without dimensions."""
    assert same(np.int8(2), unpacked(Discrete(3, dtype=np.int8), 2))
    assert same(np.int64(2), unpacked(Discrete(3), np.longlong(2)))
    assert same({"a": np.int64(1)}, unpacked(Dict(a=Discrete(3)), OrderedDict(a=1)))
    assert same(np.array(0.5, "<f4"), unpacked(Box(0, 1, ()), np.float32(0.5)))
    assert same(np.array(0.5, ">f4"), unpacked(Box(0, 1, (), ">f4"), np.float32(0.5)))


def unpacked(space: Space[Any], value: Any) -> Any:
    """The value after both ways."""
    return Codec(space).unpack(Codec(space).pack(value) or ())


def test_codec_packs_little_endian_c_bytes() -> None:
    """Payloads are what a reader without this library expects."""
    array = np.array([[1, 2], [3, 4]], ">i2")
    assert Codec(Box(0, 9, (2, 2), ">i2")).pack(array) == (bytes([1, 0, 2, 0, 3, 0, 4, 0]),)
    assert Codec(Discrete(3)).pack(np.int64(2)) == (2,)
    assert Codec(Sequence(Text(2))).pack(("a", "b")) == ('{"$":"tuple","v":["a","b"]}',)


def test_codec_unpacks_arrays_that_are_free() -> None:
    """What is unpacked can be written to, and isn't the payload's memory."""
    codec = Codec(Box(0, 1, (2,)))
    payloads = codec.pack(floats(1, 2))
    assert payloads is not None
    codec.unpack(payloads)[0] = 9
    assert same(floats(1, 2), codec.unpack(payloads))


@pytest.mark.parametrize(
    ("space", "payloads"),
    [
        (Box(0, 1, (2,)), ()),
        (Box(0, 1, (2,)), (b"1234",)),
        (Box(0, 1, (2,)), ("12345678",)),
        (Discrete(3), (True,)),
        (Discrete(3, dtype=np.int8), (300,)),
        (Text(3), (3,)),
        (Sequence(Discrete(2)), ("3",)),
        (Sequence(Discrete(2)), ('["a"]',)),
        (OneOf([Discrete(2)]), ('{"$":"tuple","v":[5,1]}',)),
        (Graph(Discrete(2), None), ("{}",)),
        (Tuple([Discrete(2), Discrete(2)]), (1, 1, 1)),
    ],
)
def test_codec_refuses_payloads_of_another_space(space: Space[Any], payloads: Any) -> None:
    """A payload that can't be one of the space is an EvidenceError."""
    with pytest.raises(EvidenceError, match="space"):
        Codec(space).unpack(payloads)
