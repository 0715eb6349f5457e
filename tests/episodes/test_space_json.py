"""Spaces as plain JSON, and back."""

import contextlib
import copy
import json
from collections import OrderedDict
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Sequence, Space, Text
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.episodes.spaces import Codec, UnknownSpace, space_from_json, space_to_json
from gamekeeper.errors import EvidenceError
from tests.episodes.drawn_spaces import SPACES, sample
from tests.episodes.sameness import same

BOX = {"kind": "Box", "dtype": "<f4", "shape": [2], "low": 0.0, "high": 1.0}


class Hexagons(Space[Any]):
    """A space class that nobody knows."""

    def __repr__(self) -> str:
        return "Hexagons(radius=3)"


class Pixels(Box):
    """A subclass of a space that everybody knows."""


def through_json(space: Space[Any]) -> Space[Any]:
    """The space after both ways, with a text of plain JSON between them."""
    return space_from_json(json.loads(json.dumps(space_to_json(space), allow_nan=False).encode()))


@given(SPACES, st.integers(0, 3))
def test_space_json_gives_back_an_equal_space(space: Space[Any], seed: int) -> None:
    """The space comes back equal, with the same JSON, and samples the same values."""
    back = through_json(space)
    assert space == back
    assert type(space) is type(back)
    assert space_to_json(space) == space_to_json(back) == space_to_json(copy.deepcopy(space))
    assert same(sample(space, seed), sample(back, seed))


@pytest.mark.parametrize(
    "space",
    [
        Box(-np.inf, np.inf, (2,), np.int64),
        Box(np.array([-np.inf, -5.0]), np.array([7.0, np.inf]), dtype=np.int32),
        Box(np.array([-np.inf, 0.1, -0.0]), np.array([0.3, np.inf, 0.0]), dtype=np.float64),
        Box(np.arange(600.0).reshape(20, 30), 600.0, dtype=np.float64),
        Box(0, 2**63 - 1, (1,), np.int64),
        Box(0, 2**64 - 1, (1,), np.uint64),
        Box(np.array([0, 1]), np.array([1, 1]), dtype=np.bool_),
        Box(0, 1, (0, 3)),
        Box(np.array(["0.1", "0.2"], np.longdouble), np.longdouble(1), dtype=np.longdouble),
    ],
    ids=repr,
)
def test_space_json_keeps_bounds_exactly(space: Box) -> None:
    """Every bit of a bound comes back, and which bounds are none."""
    back = through_json(space)
    assert isinstance(back, Box)
    for name in ("low", "high", "bounded_below", "bounded_above"):
        assert same(getattr(space, name), getattr(back, name))


@pytest.mark.parametrize(
    ("expected", "space"),
    [
        (
            {"dtype": "<f4", "high": "inf", "kind": "Box", "low": [0.0, -1.0], "shape": [2]},
            Box(np.array([0, -1], np.float32), np.float32(np.inf)),
        ),
        ({"dtype": "<i8", "kind": "Discrete", "n": 3, "start": -1}, Discrete(3, start=-1)),
        (
            {"dtype": "<i4", "kind": "MultiDiscrete", "nvec": [2, 3], "shape": [2], "start": 0},
            MultiDiscrete([2, 3], np.int32),
        ),
        ({"kind": "MultiBinary", "n": 3}, MultiBinary(3)),
        ({"kind": "MultiBinary", "n": [3]}, MultiBinary([3])),
        ({"charset": "cab", "kind": "Text", "max": 5, "min": 1}, Text(5, charset="cab")),
        (
            {"charset": [233, 97], "kind": "Text", "max": 5, "min": 0},
            Text(5, min_length=0, charset="éa"),
        ),
        (
            {
                "kind": "Dict",
                "spaces": [
                    ["b", {"kind": "MultiBinary", "n": 1}],
                    [{"json": "1"}, {"kind": "MultiBinary", "n": 2}],
                ],
            },
            Dict({"b": MultiBinary(1), 1: MultiBinary(2)}),
        ),
    ],
)
def test_space_json_stays_as_it_is(expected: dict[str, Any], space: Space[Any]) -> None:
    """Fingerprints of old recordings hang on these forms: they never change."""
    assert expected == space_to_json(space)
    assert list(expected) == list(space_to_json(space))


def test_space_json_keeps_the_order_of_keys() -> None:
    """Keys of a Dict stay in the order in which it samples and flattens them."""
    space = Dict(OrderedDict(b=Discrete(2), a=Discrete(3)))
    assert list(space.spaces) == list(through_json(space).spaces)  # type: ignore[attr-defined]
    unsorted = Dict({"b": Discrete(2), "a": Discrete(3)}, sort_keys=False)
    assert through_json(unsorted).sort_keys is False  # type: ignore[attr-defined]


def test_space_json_knows_a_subclass_by_its_base() -> None:
    """A subclass comes back as the space it extends, and its JSON still tells them apart."""
    space = Pixels(0, 255, (2,), np.uint8)
    back = through_json(space)
    assert type(back) is Box
    assert back == space
    assert space_to_json(space)["class"] == f"{__name__}.Pixels"


def test_space_json_of_an_unknown_class_comes_back_as_a_stand_in() -> None:
    """An UnknownSpace names the class, reads what was recorded, and judges nothing."""
    described = space_to_json(Hexagons())
    expected = {"class": f"{__name__}.Hexagons", "kind": "unknown", "repr": "Hexagons(radius=3)"}
    assert expected == described
    back = through_json(Sequence(Hexagons()))
    assert back == Sequence(UnknownSpace(f"{__name__}.Hexagons", "Hexagons(radius=3)"))
    assert back != Sequence(UnknownSpace(f"{__name__}.Hexagons", "Hexagons(radius=4)"))
    assert Codec(back).unpack(('{"$":"tuple","v":[1,"a"]}',)) == (1, "a")
    assert Codec(back).pack((1, "a")) == ('{"$":"tuple","v":[1,"a"]}',)
    stand_in = space_from_json(described)
    assert described == space_to_json(stand_in)
    with pytest.raises(NotImplementedError):
        stand_in.sample()


@pytest.mark.parametrize(
    "described",
    [
        None,
        [],
        {},
        {"kind": "Nope"},
        {"kind": []},
        {"kind": "Box"},
        BOX | {"shape": [-1]},
        BOX | {"shape": [2.0]},
        BOX | {"shape": [2**40], "low": 0.0},
        BOX | {"shape": [1] * 99},
        BOX | {"shape": [2**20, 2**20]},
        BOX | {"dtype": "O"},
        BOX | {"dtype": "<M8"},
        BOX | {"dtype": "<f4,<f4"},
        BOX | {"dtype": 4},
        BOX | {"dtype": "<f5"},
        BOX | {"low": 2.0},
        BOX | {"low": "nan"},
        BOX | {"low": [0.0]},
        BOX | {"low": {"base64": "AAAA"}},
        BOX | {"dtype": "<f16", "low": "-1e9999", "high": "1"},
        BOX | {"low": True},
        BOX | {"dtype": "<i4"},
        BOX | {"low": {"base64": "?"}},
        BOX | {"low": -1e300},
        BOX | {"dtype": "|i1", "low": 0, "high": 300},
        {"kind": "Discrete", "n": 0, "start": 0, "dtype": "<i8"},
        {"kind": "Discrete", "n": True, "start": 0, "dtype": "<i8"},
        {"kind": "Discrete", "n": 2**70, "start": 0, "dtype": "<i8"},
        {"kind": "MultiBinary", "n": [2**20, 2**20]},
        {"kind": "MultiBinary", "n": 2**40},
        {"kind": "Text", "max": 1, "min": 2, "charset": "a"},
        {"kind": "Text", "max": 1, "min": 0, "charset": [-1]},
        {"kind": "Tuple", "spaces": [BOX, BOX | {"shape": [2**28 - 3]}]},
        {"kind": "Tuple", "spaces": 3},
        {"kind": "OneOf", "spaces": []},
        {"kind": "Dict", "spaces": [["a"]]},
        {"kind": "Dict", "spaces": [[{"json": "["}, BOX]]},
        {"kind": "Sequence", "space": BOX},
        {"kind": "Graph", "node": BOX},
    ],
)
def test_space_json_refuses_what_it_does_not_write(described: Any) -> None:
    """A damaged or hostile description is an EvidenceError, before anything large is built."""
    with pytest.raises(EvidenceError, match="JSON can't be read"):
        space_from_json(described)


def test_space_json_refuses_deep_nesting() -> None:
    """A description nested beyond reason doesn't reach the end of the stack."""
    described: dict[str, Any] = BOX
    for _ in range(3000):
        described = {"kind": "Sequence", "space": described, "stack": False}
    with pytest.raises(EvidenceError, match="deeper than 64"):
        space_from_json(described)


@given(SPACES, st.data())
def test_space_json_survives_damage(space: Space[Any], data: st.DataObject) -> None:
    """A description with one field exchanged is read or refused, nothing else."""
    described = space_to_json(space)
    field = data.draw(st.sampled_from(sorted(described)))
    junk = st.none() | st.integers(-9, 9) | st.floats() | st.text(max_size=3) | st.just([BOX])
    described[field] = data.draw(junk | st.lists(junk, max_size=2))
    with contextlib.suppress(EvidenceError):
        space_from_json(described)
