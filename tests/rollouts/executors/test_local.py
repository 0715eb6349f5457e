import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.executors import executor_of
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.task import Done, Limits, WorkTask, stopped_after


def task(key: str, name: str, **arguments: Any) -> WorkTask:
    """One of our tasks."""
    return WorkTask(key, f"tests.rollouts.executors.executor_tasks:{name}", arguments)


def played(tasks: list[WorkTask], workers: int = 2, **options: Any) -> dict[str, Done]:
    """Every task's end, by key."""
    ends = list(LocalExecutor(workers).map(tasks, **options))
    assert len(ends) == len({end.key for end in ends})
    return {end.key: end for end in ends}


def test_tasks_are_each_played_once_in_few_processes() -> None:
    """Forty tasks, forty answers, two processes."""
    ends = played(
        [task(f"t{n}", "twice", number=n) for n in range(30)]
        + [task(f"p{n}", "process") for n in range(10)]
    )
    assert {f"t{n}": 2 * n for n in range(30)} == {
        key: end.outcome.value for key, end in ends.items() if key.startswith("t")
    }
    processes = {end.outcome.value for key, end in ends.items() if key.startswith("p")}
    assert 1 <= len(processes) <= 2
    assert os.getpid() not in processes
    assert {end.attempts for end in ends.values()} == {1}


def test_tasks_are_drawn_as_workers_get_free() -> None:
    """A source of any length is asked for little more than what is played."""
    drawn = []

    def tasks() -> Iterator[WorkTask]:
        for number in range(1_000_000):
            drawn.append(number)
            yield task(f"t{number}", "twice", number=number)

    ends = LocalExecutor(2).map(tasks())
    with stopped_after(ends):
        next(ends)
    assert len(drawn) < 50


def test_death_is_tried_again_and_an_error_is_not(tmp_path: Path) -> None:
    """A killed task is played anew; one that dies each time or raises is told with its reason."""
    often = tmp_path / "often"
    ends = played(
        [
            task("once", "die_once", mark=str(tmp_path / "once")),
            task("raises", "refuse", why="no"),
            task("dies", "die", mark=str(often)),
            task("fine", "twice", number=4),
        ]
    )
    assert (ends["once"].outcome.value, ends["once"].attempts) == ("played", 2)
    assert (ends["raises"].outcome.status, ends["raises"].attempts) == ("raised", 1)
    assert ends["raises"].outcome.error == "ValueError: no"
    assert (ends["dies"].outcome.status, ends["dies"].attempts) == ("died", 3)
    assert ends["dies"].outcome.error == "exit code 7"
    assert often.read_text() == "xxx"
    assert ends["fine"].outcome.value == 8


def test_silence_ends_a_task_and_not_those_after_it() -> None:
    """A hung task is told as hung, once; its worker gets a fresh process."""
    ends = played(
        [task("hangs", "be_silent"), task("fine", "twice", number=1)],
        workers=1,
        limits=Limits(silence_s=1.5),
    )
    assert (ends["hangs"].outcome.status, ends["hangs"].attempts) == ("hung", 1)
    assert ends["fine"].outcome.value == 2


def test_reports_come_with_their_keys() -> None:
    """What a task reports is handed on under its key."""
    heard = []
    played(
        [task(f"t{n}", "said", number=n) for n in range(6)],
        on_report=lambda key, fields: heard.append((key, fields)),
    )
    assert sorted(heard) == [(f"t{n}", {"number": n}) for n in range(6)]


def test_leaving_the_loop_interrupts_what_is_played(tmp_path: Path) -> None:
    """A task in flight gets its interrupt and can end in order, at once."""
    begun, ended = tmp_path / "begun", tmp_path / "ended"
    tasks = [
        task("fine", "twice", number=1),
        task("waits", "wait", begun=str(begun), ended=str(ended)),
    ]
    with stopped_after(LocalExecutor(2).map(tasks)) as ends:
        assert next(ends).key == "fine"
        deadline_s = time.monotonic() + 20
        while not begun.exists() and time.monotonic() < deadline_s:
            os.sched_yield()
    assert ended.read_text() == "interrupted"


def test_processes_end_by_themselves_when_nothing_is_left(tmp_path: Path) -> None:
    """What a task left to be closed at the end of its process is closed."""
    note = tmp_path / "note"
    played([task("t", "leave_a_note", note=str(note))], workers=1)
    assert note.read_text() == "closed"


def test_errors_of_the_source_and_of_the_listener_come_out() -> None:
    """What raises while tasks are drawn or reports are taken ends the map with that error."""

    def tasks() -> Iterator[WorkTask]:
        yield task("t", "said", number=1)
        raise RuntimeError("no more script")

    def listen(key: str, fields: dict[str, Any]) -> None:
        raise LookupError("deaf")

    with pytest.raises(RuntimeError, match="no more script"):
        list(LocalExecutor(1).map(tasks()))
    with pytest.raises(LookupError, match="deaf"):
        list(LocalExecutor(1).map([task("t", "said", number=1)], on_report=listen))


@pytest.mark.parametrize(
    ("text", "workers", "said_"),
    [
        ("local", 0, "number of workers"),
        ("local:3", 1, "no such executor"),
        ("dask", 1, "no such executor"),
    ],
)
def test_executors_that_there_are_not_are_refused(text: str, workers: int, said_: str) -> None:
    """A wrong name or number is told before anything is started."""
    with pytest.raises(GamekeeperError, match=said_):
        executor_of(text, workers)


@pytest.mark.parametrize("key", ["", "a/b", "../up", ".hidden", "a b", "x" * 201])
def test_keys_that_name_no_file_are_refused(key: str) -> None:
    """A key becomes a file's name in storage, so it has to be one."""
    with pytest.raises(GamekeeperError, match="key"):
        WorkTask(key, "a:b")
