"""Gymnasium spaces of every kind, drawn by Hypothesis, with values of them."""

from typing import Any

import numpy as np
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    Graph,
    MultiBinary,
    MultiDiscrete,
    OneOf,
    Sequence,
    Space,
    Text,
    Tuple,
)
from hypothesis import strategies as st

INTS = st.sampled_from(["i1", "u1", "i2", "u2", "<i4", ">i4", "u4", "i8"]).map(np.dtype)
FLOATS = st.sampled_from(["f2", "<f4", ">f4", "f8"]).map(np.dtype)
SHAPES = st.lists(st.integers(1, 4), max_size=3).map(tuple)
KEYS = st.text(max_size=3) | st.sampled_from(["a/b", "@", "%25", "0", "a%2Fb"])
CHARSETS = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=9)


@st.composite
def boxes(draw: st.DrawFn) -> Box:
    """Boxes of every dtype, bounds the same everywhere or not, finite or not."""
    dtype = draw(INTS | FLOATS | st.just(np.dtype(bool)))
    shape = draw(SHAPES)
    if dtype.kind == "b":
        return Box(0, 1, shape, dtype)
    low = np.array(draw(st.integers(0, 9)) + np.zeros(shape), dtype)
    high = low + np.array(draw(st.integers(0, 9)), dtype)
    if low.size > 1 and draw(st.booleans()):
        high.flat[0] = high.flat[0] + 1
    may_be_infinite = dtype.kind == "f" or (dtype.kind == "i" and dtype.itemsize < 8)
    # Gymnasium can't sample int64 without bounds.
    is_low, is_high = draw(st.tuples(*[st.booleans()] * 2)) if may_be_infinite else (False, False)
    return Box(-np.inf if is_low else low, np.inf if is_high else high, shape, dtype)


@st.composite
def multi_discretes(draw: st.DrawFn) -> MultiDiscrete:
    """MultiDiscrete of one or two dimensions, some with a start."""
    shape = draw(st.lists(st.integers(1, 3), min_size=1, max_size=2).map(tuple))
    count = int(np.prod(shape))
    nvec = draw(st.lists(st.integers(1, 9), min_size=count, max_size=count))
    start = draw(st.lists(st.integers(-9, 9), min_size=count, max_size=count))
    dtype = draw(st.sampled_from([np.int8, np.int32, np.int64]))
    return MultiDiscrete(np.array(nvec).reshape(shape), dtype, start=np.array(start).reshape(shape))


DISCRETES = st.builds(
    lambda n, start, dtype: Discrete(n, start=start if dtype.kind == "i" else 0, dtype=dtype.type),
    st.integers(1, 99),
    st.integers(-20, 20),
    INTS.filter(lambda dtype: dtype.isnative),
)
PLAIN = (
    boxes()
    | multi_discretes()
    | DISCRETES
    | st.builds(
        MultiBinary, st.integers(1, 5) | st.lists(st.integers(1, 3), min_size=1, max_size=2)
    )
    | st.builds(Text, st.integers(1, 9), charset=CHARSETS)
)
FIXED = st.recursive(
    PLAIN,
    lambda inner: (
        st.dictionaries(KEYS, inner, max_size=3).map(Dict) | st.lists(inner, max_size=3).map(Tuple)
    ),
    max_leaves=5,
)
GRAPHS = st.builds(Graph, boxes() | DISCRETES, boxes() | DISCRETES | st.none())
SPACES = st.recursive(
    PLAIN | GRAPHS,
    lambda inner: (
        st.dictionaries(KEYS, inner, min_size=1, max_size=3).map(Dict)
        | st.lists(inner, min_size=1, max_size=3).map(Tuple)
        | st.lists(inner, min_size=1, max_size=3).map(OneOf)
        | st.builds(Sequence, inner, stack=st.booleans())
    ),
    max_leaves=5,
)


def sample(space: Space[Any], seed: int = 0) -> Any:
    """A value of the space, the same for the same seed."""
    space.seed(seed)
    return space.sample()
