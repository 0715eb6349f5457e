from __future__ import annotations

import random
from pathlib import Path

import pytest

from benchmarks import kill


@pytest.mark.slow
def test_kill_loses_nothing_that_is_old(tmp_path: Path) -> None:
    """After kill -9 every bundle opens, recovers and replays, and lost its newest turns alone.

    The bound here is loose, because tests run beside each other; the benchmark holds the tight one.
    """
    rng = random.Random(0)

    found = [kill.killed(tmp_path / str(n), after_s=rng.uniform(0.05, 0.4)) for n in range(5)]

    assert all(each.is_opened for each in found)
    assert all(each.is_recovered for each in found)
    assert all(each.is_replayed for each in found)
    assert all(each.lost_ms < 10 * kill.BOUND_MS for each in found)
