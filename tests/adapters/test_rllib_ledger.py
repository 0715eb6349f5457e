"""RLlib's own episodes hold the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import ledger, rllib_ledger

pytestmark = pytest.mark.trainer


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_episodes_hold_the_log(cell: ledger.Cell) -> None:
    """Each decision: observation, action, mask, credited reward, end, what followed, seed."""
    assert rllib_ledger.episodes(cell) == rllib_ledger.expected(cell)
