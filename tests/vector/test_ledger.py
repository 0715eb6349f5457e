"""Arrays of a vector environment hold the transitions of a log worked out by hand."""

import pytest

from tests.adapters import ledger, vector_books


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_arrays_hold_the_log(cell: ledger.Cell) -> None:
    """Each decision's observation, mask, reward, end, final observation; seeds by episode."""
    assert vector_books.arrays(cell) == ""
