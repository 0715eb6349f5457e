"""Canonical JSON: one text for a value, and the value back."""

import contextlib
import dataclasses
import enum
import json
import subprocess
import sys
import types
from collections import Counter, OrderedDict, defaultdict, deque, namedtuple
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from gymnasium.spaces import GraphInstance
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.episodes.canonical import (
    Opaque,
    drop,
    from_json,
    is_exact,
    shown,
    to_json,
    type_name,
)
from gamekeeper.episodes.canonical import json_values as canon_write
from gamekeeper.errors import EvidenceError
from tests.episodes.sameness import same

TEXT = st.text(st.characters(codec=None), max_size=8)  # lone surrogates too
FLAT = st.none() | st.booleans() | st.integers() | st.floats() | TEXT
HASHABLE = FLAT | st.binary(max_size=8) | st.complex_numbers()
NUMBERS = hnp.boolean_dtypes() | hnp.integer_dtypes() | hnp.floating_dtypes()
DTYPES = (
    NUMBERS
    | hnp.complex_number_dtypes()
    | hnp.datetime64_dtypes()
    | hnp.timedelta64_dtypes()
    | hnp.unicode_string_dtypes()
    | hnp.byte_string_dtypes()
)
SIDES = hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=6)
ARRAYS = hnp.arrays(DTYPES.map(lambda dtype: dtype.newbyteorder("<")), SIDES) | hnp.arrays(
    st.sampled_from([np.float64, np.complex128]), SIDES
).map(lambda array: array.astype(np.result_type(array, np.longdouble)))
FIELD = st.tuples(NUMBERS.map(lambda dtype: dtype.newbyteorder("<")), SIDES)
RECORDS = hnp.arrays(
    st.dictionaries(TEXT.filter(len), FIELD, min_size=1, max_size=3).map(
        lambda fields: np.dtype([(name, *field) for name, field in fields.items()])
    ),
    hnp.array_shapes(max_dims=2, max_side=3),
)
SCALARS = ARRAYS.filter(lambda array: array.size and array.dtype.kind not in "US").map(
    lambda array: array.flat[0]
)
VALUES = st.recursive(
    HASHABLE | st.binary(max_size=8).map(bytearray) | ARRAYS | RECORDS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.lists(inner, max_size=4).map(tuple)
        | st.dictionaries(TEXT | st.just("$"), inner, max_size=4)
        | st.dictionaries(HASHABLE, inner, max_size=3)
        | st.sets(HASHABLE, max_size=4)
        | st.frozensets(HASHABLE, max_size=4)
    ),
    max_leaves=12,
)


class Compass(enum.IntEnum):
    """An enum that json would write as a number."""

    NORTH = 0
    EAST = 1


@dataclasses.dataclass
class Cell:
    """A dataclass that holds an array."""

    row: int
    cost: Any = None


Place = namedtuple("Place", ["x", "y"])


class Name(str):
    """A subclass of a builtin."""

    __slots__ = ()


class Hostile:
    """Raises whatever is asked of it."""

    def __repr__(self) -> str:
        raise RuntimeError("no repr")

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("no equality")

    def __getattr__(self, name: str) -> Any:
        raise RuntimeError("no attributes")

    __hash__ = None  # type: ignore[assignment]  # unhashable on purpose


class LyingMeta(type):
    """A metaclass whose classes don't tell their name."""

    def __getattribute__(cls, name: str) -> Any:
        if name == "__qualname__":
            raise RuntimeError("no name")
        return super().__getattribute__(name)


def nonconforming_values() -> list[object]:
    """Values that aren't built again from their text."""
    inside: list[object] = [1]
    inside.append(inside)
    both = {"a": inside}
    inside.append(both)
    return [
        Compass.EAST,
        Cell(1, np.zeros(2)),
        Cell(1, Hostile()),
        Place(1, (2,)),
        Name("wolf"),
        OrderedDict(b=1, a=2),
        defaultdict(list, a=[1]),
        Counter("aab"),
        deque([1, 2]),
        types.MappingProxyType({"a": 1}),
        np.ma.array([1, 2], mask=[False, True]),
        np.zeros((1, 2)).view(np.memmap),
        np.rec.array([(1, 2.0)], names=["a", "b"]),
        object(),
        Hostile(),
        LyingMeta("Liar", (), {})(),
        len,
        int,
        inside,
        both,
        [Name("\ud83d\ude00")],
        np.array([object(), len]),
        np.zeros(2, np.dtype([("a", "i1"), ("b", "<i8")], align=True)),
        {Compass.EAST: 1, Place(1, 2): 2},
        np.zeros(1, "V70000"),
        (i for i in ()),
    ]


def nested(depth: int) -> list[Any]:
    """A list within lists."""
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


@given(VALUES | SCALARS)
def test_canon_gives_back_builtins_and_numpy(value: Any) -> None:
    """Every value but numpy's plain scalars comes back equal and of its own types."""
    text = to_json(value)
    plain = np.bool_ | np.int64 | np.float64
    expected = value.item() if isinstance(value, plain) else value
    assert same(expected, from_json(text))
    assert is_exact(text)


@given(VALUES | SCALARS)
def test_canon_is_strict_json_that_utf8_carries_and_a_fixed_point(value: Any) -> None:
    """The text is JSON by the letter, and reading and writing it again changes nothing."""

    def refuse(word: str) -> None:
        pytest.fail(word)

    text = to_json(value)
    json.loads(text.encode(), parse_constant=refuse)
    assert text == to_json(from_json(text))


@given(st.dictionaries(TEXT, FLAT, max_size=5), st.randoms(use_true_random=False))
def test_canon_has_one_text_whatever_the_order_and_the_way(value: Any, random: Any) -> None:
    """The short way for flat dicts and the long way through containers write the same."""
    keys = list(value)
    random.shuffle(keys)
    text = to_json({key: value[key] for key in keys})
    assert text == to_json(value)
    assert f"[{text}]" == to_json([value])
    assert f'{{"$":"tuple","v":[{text},{{"$":"set","v":[]}}]}}' == to_json((value, set()))


@pytest.mark.parametrize("value", nonconforming_values(), ids=type_name)
def test_canon_writes_what_it_cannot_build(value: object) -> None:
    """Foreign values never raise, have no address in them, and their text is a fixed point."""
    text = to_json(value)
    assert not is_exact(text)
    assert text == to_json(from_json(text))
    assert "0x7" not in text


@pytest.mark.parametrize(
    ("expected", "value"),
    [
        ('{"a":-0.0,"b":[1,null,true]}', {"b": [1, None, True], "a": -0.0}),
        (
            '{"a":1,"b":false,"c":0.5,"d":"x"}',
            {"a": np.int64(1), "b": np.bool_(False), "c": np.float64(0.5), "d": np.str_("x")},
        ),
        ("[1,true]", [np.longlong(1), np.True_]),
        ('{"x":{"$":"nan"},"y":{"$":"-inf"}}', {"x": float("nan"), "y": float("-inf")}),
        ('{"$":"dict","v":[["a",1],[1,2]]}', {"a": 1, 1: 2}),
        ('{"$":"dict","v":[["$",1]]}', {"$": 1}),
        ('{"$":"set","v":["a",1,{"$":"tuple","v":[]}]}', {(), "a", 1}),
        ('{"$":"float32","v":0.10000000149011612}', np.float32(0.1)),
        ('{"$":"int8","v":-3}', np.int8(-3)),
        ('{"$":"complex64","v":[1.0,"nan"]}', np.complex64(complex(1, float("nan")))),
        ('{"$":"ndarray","dtype":"<f4","shape":[2],"v":[1.0,"inf"]}', np.array([1, np.inf], ">f4")),
        ('{"$":"ndarray","dtype":"|b1","shape":[1,1],"v":[true]}', np.array([[True]])),
        ('{"$":"ndarray","dtype":"|O","shape":[2],"v":[null,[1]]}', np.array([None, [1]], object)),
        ('{"$":"bytes","v":"AP8="}', b"\0\xff"),
        ('{"$":"range","v":[0,3,1]}', range(3)),
        ('["é\\ud800",{"$":"str","v":"7aC97biA"}]', ["é\ud800", "\ud83d\ude00"]),
        ('{"$":"object","type":"collections.OrderedDict","v":{"a":1}}', OrderedDict(a=1)),
        ('{"$":"object","repr":"<object object at 0x?>","type":"object"}', object()),
        (
            '[{"$":"object","repr":"<built-in function len>","type":"builtin_function_or_method"}]',
            [len],
        ),
    ],
)
def test_canon_texts_stay_as_they_are(expected: str, value: object) -> None:
    """Fingerprints of old recordings hang on these texts: they never change."""
    assert expected == to_json(value)


def test_canon_does_not_depend_on_the_hash_seed() -> None:
    """Sets of texts, and all that holds them, read the same in processes of other hash seeds."""
    code = (
        "from gamekeeper.episodes.canonical import to_json\n"
        "names = [f'wolf_{i}' for i in range(50)]\n"
        "print(to_json({'live': set(names), 'sides': {frozenset({a, 'b', 1}): a for a in names},"
        " 'who': dict.fromkeys(set(names), 1.5)}))"
    )
    source = str(Path(canon_write.__file__).parents[3])
    texts = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": source},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(texts) == 1


@pytest.mark.parametrize("shape", [(3, 4), (30, 4)], ids=["listed", "base64"])
def test_canon_does_not_see_strides_or_byte_order(shape: tuple[int, ...]) -> None:
    """Equal arrays have equal texts, however they lie in memory, whichever NaN they hold."""
    array = np.arange(np.prod(shape), dtype="<f8").reshape(shape)
    array[0, 0] = np.nan
    other_nan = array.copy()
    other_nan.view(np.uint64)[0, 0] = 0xFFF8_0000_0000_0001
    wide = np.zeros((shape[0], 2 * shape[1]))
    wide[:, ::2] = array
    forms = [array, np.asfortranarray(array), array.astype(">f8"), wide[:, ::2], other_nan]
    assert len({to_json(form) for form in forms}) == 1
    assert same(array, from_json(to_json(array)))


def test_canon_sees_cycles_depth_and_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """What has no end in JSON ends in an object that says why."""
    around: list[Any] = []
    around.append(around)
    assert to_json(around) == '[{"$":"object","repr":"<within itself>","type":"list"}]'
    assert is_exact(to_json(nested(63)))
    assert "<within 64 others>" in to_json(nested(64))
    assert "<within 64 others>" in to_json(nested(5000))
    monkeypatch.setattr(canon_write, "_CONTAINERS", 100)
    doubled: list[Any] = []
    for _ in range(40):
        doubled = [doubled, doubled]
    assert "<behind 100 others>" in to_json(doubled)


def test_canon_writes_long_ints_under_every_limit_of_digits() -> None:
    """Texts of ints don't depend on CPython's limit, which each process may set."""
    values = [-(1 << 1999), 1 << 2000, 10**5000, {"a": 1 << 2000}]
    texts = [to_json(value) for value in values]
    before = sys.get_int_max_str_digits()
    try:
        for limit in (0, 640):
            sys.set_int_max_str_digits(limit)
            assert texts == [to_json(value) for value in values]
            assert values == [from_json(text) for text in texts]
    finally:
        sys.set_int_max_str_digits(before)


def test_canon_reads_a_graph_as_a_graph() -> None:
    """Gymnasium's GraphInstance is the one foreign class that is built again."""
    graph = GraphInstance(np.zeros((2, 1), np.float32), None, None)
    assert same(graph, from_json(to_json(graph)))


def test_canon_tells_what_an_unknown_value_held() -> None:
    """An Opaque names the type, can be compared and hashed, and keeps the content as JSON."""
    read = from_json(to_json(Cell(3)))
    name = f"{__name__}.Cell"
    assert Opaque(name, content='{"cost":null,"row":3}') == read
    assert {read} == {from_json(to_json(Cell(3)))}
    assert name == type_name(read)


def test_canon_scrubs_addresses_and_cuts_reprs() -> None:
    """A repr is the same in every process, and never long."""
    assert shown(object()) == "<object object at 0x?>"
    assert shown(["0xFF00FF", "at 0x7f0000000000"]) == "['0xFF00FF', 'at 0x?']"
    assert len(shown("x" * 1000)) == 200
    assert shown(Hostile()) == "<repr raises>"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[1,]",
        "NaN",
        "[Infinity]",
        "1 2",
        '{"$":"nope"}',
        '{"$":1}',
        '{"$":[]}',
        '{"$":"tuple"}',
        '{"$":"tuple","v":"ab"}',
        '{"$":"set","v":[[]]}',
        '{"$":"bytes","v":"?"}',
        '{"$":"bytes","v":1}',
        '{"$":"int","v":"zz"}',
        '{"$":"dict","v":[1]}',
        '{"$":"int8","v":300}',
        '{"$":"int8","v":1.5}',
        '{"$":"float16","v":1e300}',
        '{"$":"complex","v":[1,2,3]}',
        '{"$":"scalar","v":1}',
        '{"$":"object","type":1}',
        '{"$":"ndarray","dtype":"<f4","shape":[3],"v":[1,2]}',
        '{"$":"ndarray","dtype":"<f4","shape":[1],"v":[1e300]}',
        '{"$":"ndarray","dtype":"<f4","shape":[-1],"v":[]}',
        '{"$":"ndarray","dtype":"<f4","shape":[1000000000000],"v":""}',
        '{"$":"ndarray","dtype":"<f4","shape":[0,1000000000000000000000],"v":[]}',
        '{"$":"ndarray","dtype":"|O","shape":[1],"v":"AAAAAAAAAAA="}',
        '{"$":"ndarray","dtype":"<U999999999","shape":[1],"v":["a"]}',
        '{"$":"ndarray","dtype":"(9,9)f4","shape":[1],"v":[1]}',
        '{"$":"ndarray","dtype":"<i4","shape":[1],"v":["1"]}',
        '{"$":"ndarray","dtype":"|i1","shape":[1],"v":[300]}',
        '{"$":"ndarray","dtype":"|b1","shape":[1],"v":[2]}',
        '{"$":"ndarray","dtype":"longdouble","shape":[1],"v":["1e9999"]}',
        '{"$":"ndarray","dtype":"longdouble","shape":[1],"v":[1]}',
        '{"$":"ndarray","dtype":"longdouble","shape":[1],"v":["one"]}',
        '{"$":"record","shape":[1],"v":[["a",1]]}',
        '{"$":"GraphInstance","v":[1]}',
        "[" * 100_000,
        "[" * 600 + "]" * 600,
        "1" * 10_000,
    ],
)
def test_canon_refuses_what_it_does_not_write(text: str) -> None:
    """Malformed text raises EvidenceError, before anything large is built."""
    with pytest.raises(EvidenceError, match="JSON can't be read"):
        from_json(text)


@given(VALUES, st.data())
def test_canon_survives_damaged_texts(value: Any, data: st.DataObject) -> None:
    """A text with a piece cut out or put in is read or refused, nothing else."""
    text = to_json(value)
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 4)))
    piece = data.draw(
        st.sampled_from(["", "0", '"', "[", "}", ",", "1e400", '{"$":"inf"}', "9" * 9])
    )
    with contextlib.suppress(EvidenceError):
        from_json(text[:start] + piece + text[end:])


def test_canon_is_exact_only_where_nothing_is_lost() -> None:
    """A text that merely speaks of objects is exact."""
    assert is_exact(to_json(['"$":"object"', {"$": "object"}]))
    assert not is_exact(to_json({"a": (object(),)}))


def test_drop_leaves_volatile_fields_out() -> None:
    """The named fields go, the rest stays, the info itself isn't touched."""
    info = {"wall_s": 0.1, "position": 3}
    assert drop(info, {"wall_s"}) == {"position": 3}
    assert info == {"wall_s": 0.1, "position": 3}


@pytest.mark.parametrize(
    ("expected", "make"),
    [
        ("list", list),
        ("NoneType", lambda: None),
        ("numpy.float32", np.float32),
        ("numpy.ndarray", lambda: np.zeros(1)),
        (f"{__name__}.Hostile", Hostile),
        ("object", LyingMeta("Liar", (), {})),
    ],
)
def test_type_name_is_what_a_reader_knows(expected: str, make: Callable[[], object]) -> None:
    """Builtins stand bare, all others with their module."""
    assert expected == type_name(make())
