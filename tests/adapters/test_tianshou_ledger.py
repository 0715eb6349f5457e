"""Tianshou's buffer holds the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import ledger, tianshou_books

pytestmark = [
    pytest.mark.trainer,
    # Of Tianshou itself and what it stands on, as they are imported.
    pytest.mark.filterwarnings("ignore::DeprecationWarning:tianshou.*"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:sensai.*"),
]


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_buffer_holds_the_log(cell: ledger.Cell) -> None:
    """Each decision: observation, action, mask, credited reward, both ends, what followed, seed."""
    assert tianshou_books.buffer(cell) == tianshou_books.expected(cell)
