"""TorchRL's batches hold the transitions of a log worked out by hand."""

from __future__ import annotations

import pytest

from tests.adapters import ledger, torchrl_books

pytestmark = [
    pytest.mark.trainer,
    # Of TorchRL's own classes, as they are imported.
    pytest.mark.filterwarnings(
        "ignore:Creating .* which inherits from WeightUpdaterBase:DeprecationWarning"
    ),
]


@pytest.mark.parametrize("cell", ledger.COVERING, ids=str)
def test_batch_holds_the_log(cell: ledger.Cell) -> None:
    """Each decision: observation, action, mask, credited reward, both ends, what followed, seed."""
    assert torchrl_books.batches(cell) == ""
