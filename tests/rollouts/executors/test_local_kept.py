from pathlib import Path

import pytest

from gamekeeper.rollouts.executors import local as worker
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.task import Limits, stopped_after
from tests.rollouts.executors.test_local import task


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine too a process may take its time to end by itself."""
    monkeypatch.setattr(worker, "FAREWELL_S", 60.0)


def processes(executor: LocalExecutor) -> set[object]:
    """The processes that play for one `map`."""
    tasks = [task(f"p{number}", "process") for number in range(4)]
    return {end.outcome.value for end in executor.map(tasks)}


def test_context_keeps_its_process_from_one_map_to_the_next() -> None:
    """What a process has imported needn't be imported again."""
    with LocalExecutor(1) as executor:
        first, second = processes(executor), processes(executor)
    assert len(first) == 1
    assert first == second


def test_context_that_is_left_ends_its_processes_in_order(tmp_path: Path) -> None:
    """What a task left to be closed at the end of its process is closed, and not before."""
    note = tmp_path / "note"
    with LocalExecutor(1) as executor:
        (end,) = executor.map([task("t", "leave_a_note", note=str(note))])
        processes(executor)
        assert end.outcome.status == "done"
        assert not note.exists()
    assert note.read_text() == "closed"


def test_process_with_other_limits_takes_the_place_of_the_one_before(tmp_path: Path) -> None:
    """A bound of memory holds for the whole of a process."""
    note = tmp_path / "note"
    with LocalExecutor(1) as executor:
        list(executor.map([task("t", "leave_a_note", note=str(note))]))
        limits = Limits(memory_bytes=1 << 33)
        (end,) = executor.map([task("p", "process")], limits=limits)
        assert end.outcome.status == "done"
        assert note.read_text() == "closed"


def test_context_plays_on_after_a_map_was_left(tmp_path: Path) -> None:
    """A loop that is left interrupts its own tasks alone; a death costs a process alone."""
    begun, ended = tmp_path / "begun", tmp_path / "ended"
    with LocalExecutor(1) as executor:
        waiting = task("waits", "wait", begun=str(begun), ended=str(ended))
        with stopped_after(executor.map([task("fine", "process"), waiting])) as ends:
            assert next(ends).key == "fine"
        assert len(processes(executor)) == 1
        ends = executor.map([task("died", "die_once", mark=str(tmp_path / "once"))])
        assert [end.attempts for end in ends] == [2]
