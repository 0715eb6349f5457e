"""In what way a value isn't one of its space."""

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.episodes.spaces.misfit import faults, kept, misfits, same, suspects

SPACES = [
    spaces.Box(-1.0, 1.0, (2, 3), np.float32),
    spaces.Box(0, 255, (4, 4, 3), np.uint8),
    spaces.Box(-np.inf, np.inf, (), np.float64),
    spaces.Discrete(4, start=-1),
    spaces.MultiDiscrete([3, 2], start=[1, 0]),
    spaces.MultiBinary((2, 2)),
    spaces.Text(4),
    spaces.Tuple((spaces.Discrete(2), spaces.Text(3))),
    spaces.Dict(a=spaces.Discrete(3), b=spaces.Dict(c=spaces.Box(0, 1, (2,), np.int8))),
    spaces.Sequence(spaces.Discrete(3)),
    spaces.OneOf((spaces.Discrete(2), spaces.Box(0, 1, (2,), np.float32))),
    spaces.Graph(spaces.Box(0, 1, (2,), np.float32), spaces.Discrete(3)),
]


@pytest.mark.parametrize("space", SPACES, ids=str)
@given(seed=st.integers(0, 2**31 - 1))
def test_misfits_are_none_for_what_a_space_samples(space: Any, seed: int) -> None:
    """What is drawn from a space is in it, alone and in a batch."""
    space.seed(seed)
    values = [space.sample() for _ in range(3)]
    assert [each for value in values for each in misfits(space, value)] == []
    assert suspects(space, values, "bounds") == suspects(space, values, "nan") == frozenset()


@given(at=st.integers(0, 5), value=st.floats(width=32), count=st.integers(1, 5))
def test_suspects_are_those_with_a_misfit(at: int, value: float, count: int) -> None:
    """A batch finds the same values as one by one."""
    space = spaces.Box(-1.0, 1.0, (6,), np.float32)
    values = [np.zeros(6, np.float32) for _ in range(count)]
    values[-1][at] = value
    for kind in ("bounds", "nan"):
        alone = {i for i, v in enumerate(values) if kind in {m.kind for m in misfits(space, v)}}
        assert set(suspects(space, values, kind)) == alone


@pytest.mark.parametrize(
    ("space", "value", "kind", "path"),
    [
        (SPACES[0], np.zeros((2, 3)), "dtype", ""),
        (SPACES[0], np.zeros((3, 2), np.float32), "shape", ""),
        (SPACES[0], np.full((2, 3), 2, np.float32), "bounds", ""),
        (SPACES[0], np.full((2, 3), np.nan, np.float32), "nan", ""),
        (SPACES[0], [[0.0] * 3] * 2, "structure", ""),
        (SPACES[0], None, "structure", ""),
        (SPACES[3], 3, "bounds", ""),
        (SPACES[3], 0.0, "structure", ""),
        (SPACES[3], np.zeros(1, np.int64), "shape", ""),
        (SPACES[3], np.uint64(1), "dtype", ""),
        (SPACES[4], np.array([0, 0]), "bounds", ""),
        (SPACES[5], np.full((2, 2), 2, np.int8), "bounds", ""),
        (SPACES[6], 3, "structure", ""),
        (SPACES[6], "longer than four", "bounds", ""),
        (SPACES[7], (0,), "structure", ""),
        (SPACES[7], (0, "äää"), "bounds", "[1]"),
        (SPACES[8], {"a": 1}, "structure", ""),
        (SPACES[8], {"a": 1, "b": {"c": np.zeros(2, bool)}}, "dtype", "['b']['c']"),
        (SPACES[9], (0, 3), "bounds", ""),
    ],
)
def test_misfits_name_the_kind_and_the_part(space: Any, value: Any, kind: str, path: str) -> None:
    """Each way of missing a space has its name, and its test fails for the value."""
    found = [each for each in misfits(space, value) if (each.kind, each.path) == (kind, path)]
    assert len(found) == 1
    with pytest.raises((AssertionError, AttributeError, TypeError)):
        exec(f"assert {found[0].test}", {"value": value, "space": space, "np": np})


def test_faults_are_told_of_bounds_and_of_samples() -> None:
    """A space the wrong way round, and one whose sample is outside of it, are told."""
    turned = spaces.Box(0.0, 1.0, (2,), np.float32)
    turned.low, turned.high = turned.high, turned.low
    assert faults(turned, sample=True) == ["low 1.0 is above high 0.0"]
    assert faults(spaces.Dict(a=turned), sample=False) == ["low 1.0 is above high 0.0 in ['a']"]
    strange = spaces.Discrete(3)
    strange.contains = lambda value: False  # type: ignore[method-assign]
    assert len(faults(strange, sample=True)) == 1
    assert [faults(space, sample=True) for space in SPACES] == [[]] * len(SPACES)


def test_kept_space_shows_a_change_in_place() -> None:
    """A copy isn't changed with the space that it was made of."""
    space = spaces.Discrete(3)
    copied = kept(space)
    assert copied is not None
    assert same(copied, space)
    space.n = np.int64(4)
    assert not same(copied, space)
