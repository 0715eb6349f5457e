"""Workers that fork for each task."""

from collections.abc import Iterator

import pytest

from gamekeeper.rollouts.warm_worker import WarmWorker

TASKS = "tests.rollouts.worker_tasks:"


@pytest.fixture
def worker() -> Iterator[WarmWorker]:
    """A worker that has loaded NumPy, with a hash seed of its own."""
    with WarmWorker(["numpy"], hash_seed=7) as worker:
        yield worker


def test_warm_worker_forgets_what_a_task_left(worker: WarmWorker) -> None:
    """Each task finds what the modules loaded, and nothing that an earlier task did."""
    counts = [worker.run(f"{TASKS}count_calls", {}).value for _ in range(2)]
    assert counts == [1, 1]


def test_warm_worker_seeds_each_fork_apart_under_one_hash_seed(worker: WarmWorker) -> None:
    """Global generators differ from fork to fork, hashes don't."""
    one, other = (worker.run(f"{TASKS}draw_globals", {}).value for _ in range(2))
    assert isinstance(one, dict)
    assert isinstance(other, dict)
    assert one["hash"] == other["hash"]
    assert one["numpy"] != other["numpy"]
    assert one["random"] != other["random"]


def test_warm_worker_tells_how_a_fork_ended(worker: WarmWorker) -> None:
    """Exceptions, crashes and hangs of a task are data, and the next task runs all the same."""
    raised = worker.run(f"{TASKS}raise_exit", {"code": "broken"})
    assert (raised.status, raised.error) == ("raised", "SystemExit: broken")
    crashed = worker.run(f"{TASKS}crash", {})
    assert (crashed.status, crashed.error) == ("died", "killed by SIGSEGV")
    left = worker.run(f"{TASKS}leave", {"code": 0})
    assert (left.status, left.error) == ("died", "exit code 0, before the task returned")
    silent = worker.run(f"{TASKS}wait_for_ever", {}, silence_s=0.5)
    assert (silent.status, silent.error) == ("hung", "no sign of life for 0.5 s")
    late = worker.run(f"{TASKS}spin_for_ever", {}, limit_s=1.0)
    assert (late.status, late.error) == ("hung", "not done after 1 s")
    assert worker.run(f"{TASKS}count_calls", {}).value == 1


def test_warm_worker_says_that_a_module_is_missing() -> None:
    """A module that can't be imported is named by the task that needs it, and by no other."""
    with WarmWorker(["no_such_module"]) as worker:
        outcome = worker.run("no_such_module:task", {})
        other = worker.run(f"{TASKS}count_calls", {})
    assert outcome.status == "raised"
    assert "no_such_module" in (outcome.error or "")
    assert other.status == "done"
