"""Stable-Baselines3's buffers hold the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import ledger, sb3_books

pytestmark = pytest.mark.trainer


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_rollout_buffer_holds_the_log(cell: ledger.Cell) -> None:
    """Observation, action, mask, credited reward, end, final observation and seed of each decision."""
    assert sb3_books.on_policy(cell) == sb3_books.EXPECTED.get(cell.seen, "")
