import random
from pathlib import Path

import pytest

from benchmarks import kill, kill_apart


def test_kill_loses_nothing_that_is_old(tmp_path: Path) -> None:
    """After kill -9 every run opens, recovers and replays, and lost its newest turns alone.

    The bound here is loose, because tests run beside each other; the benchmark holds the tight one.
    """
    rng = random.Random(0)

    with kill.recorders(tmp_path, "full", "") as start:
        found = [kill.killed(start, tmp_path, n, after_s=rng.uniform(0.05, 0.4)) for n in range(5)]

    assert all(each.is_opened for each in found)
    assert all(each.is_recovered for each in found)
    assert all(each.is_replayed for each in found)
    assert all(each.lost_ms < 10 * kill.BOUND_MS for each in found)


@pytest.mark.parametrize("who", ["parent", "worker"])  # what merges: parts/test_apart.py
def test_killed_recording_by_workers_goes_on(who: str, tmp_path: Path) -> None:
    """Whichever process dies, the same command ends with the same evidence and nothing else."""
    figures, is_whole = kill_apart.kill(who, tmp_path, kills=1, rng=random.Random(1))

    assert is_whole, figures
