"""Snapshots of values, and whether they still hold."""

import numpy as np
import pytest

from gamekeeper.rollouts.snapshots import is_same, snapshot


@pytest.mark.parametrize("at", [0, 1])
def test_snapshots_of_arrays_of_arrays_are_compared_by_element(at: int) -> None:
    """An array of objects that are arrays is compared without an exception."""
    value = np.empty(2, object)
    value[:] = [np.zeros(2), np.ones(3)]
    kept = np.empty(2, object)
    kept[:] = [np.zeros(2), np.ones(3)]
    assert is_same(value, kept)
    value[at][0] = 7.0
    assert not is_same(value, kept)
    assert is_same(value, snapshot(value))
