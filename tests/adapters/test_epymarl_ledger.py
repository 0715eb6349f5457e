"""Episodes in EPyMARL's form hold the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import epymarl_books, ledger


@pytest.mark.parametrize("form", ledger.SEEN)
def test_episodes_hold_the_log(form: str) -> None:
    """Each decision: observation, action, mask, credited reward, both ends, what followed, seed."""
    for cell in ledger.COVERING:
        if cell.seen == form:
            assert epymarl_books.episodes(cell) == epymarl_books.expected(cell), str(cell)
