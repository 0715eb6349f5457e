"""Stable-Baselines3's buffers hold the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import ledger, sb3_books

pytestmark = pytest.mark.trainer


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_rollout_buffer_holds_the_log(cell: ledger.Cell) -> None:
    """Each decision: observation, action, mask, credited reward, end, final observation, seed."""
    assert sb3_books.on_policy(cell) == sb3_books.EXPECTED.get(cell.seen, "")


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_replay_buffer_holds_the_log(cell: ledger.Cell) -> None:
    """The same of DQN and SAC, and what followed each decision."""
    says = sb3_books.off_policy(cell)
    assert says == sb3_books.EXPECTED.get(cell.seen, "") or says.startswith("no algorithm")
