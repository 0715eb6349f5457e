"""BenchMARL's buffer holds the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import benchmarl_books, ledger
from tests.adapters.test_benchmarl import one_thread, pytestmark  # noqa: F401  # a fixture, and the marks

REFUSED = "refused: BenchMARL has no algorithm for such actions"


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_buffer_holds_the_log(cell: ledger.Cell) -> None:
    """Each decision: observation, action, mask, credited reward, both ends, what followed, seed."""
    is_vector = cell.form == "Box" and cell.api == "parallel"
    is_taken = cell.form == "Discrete" or is_vector
    assert benchmarl_books.buffer(cell) == ("" if is_taken else REFUSED)
