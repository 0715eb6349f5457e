"""One agent's `gymnasium.Env` gives the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import gymnasium_books, ledger


@pytest.mark.parametrize("form", ledger.SEEN)
def test_agent_is_given_the_log(form: str) -> None:
    """Each decision: observation, action, mask, credited reward, both ends, what followed, seed."""
    for cell in ledger.COVERING:
        if cell.seen == form:
            assert gymnasium_books.single(cell) == "", str(cell)
