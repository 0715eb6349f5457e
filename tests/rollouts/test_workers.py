import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.rollouts.warm_worker import WarmWorker
from gamekeeper.rollouts.worker_process import WorkerProcess, place
from gamekeeper.rollouts.workers import TaskOutcome, run_task


def run(name: str, arguments: dict[str, Any] | None = None, **options: Any) -> TaskOutcome:
    """Runs one of our tasks."""
    return run_task(f"tests.rollouts.worker_tasks:{name}", arguments or {}, **options)


def test_workers_hand_back_what_a_task_returned() -> None:
    """A task that returns is done, and its value is there."""
    outcome = run("add", {"first": 2, "second": 3})
    assert (outcome.status, outcome.value, outcome.error, outcome.traceback) == (
        "done",
        5,
        None,
        None,
    )
    assert 0 < outcome.seconds < 30.0


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)


@given(json_values)
@settings(max_examples=8)
def test_workers_carry_json_both_ways_unchanged(value: Any) -> None:
    """What goes in comes out, whatever text and numbers it holds."""
    assert value == run("echo", {"value": value}).value


def test_workers_carry_megabytes() -> None:
    """Arguments and results may be larger than any buffer of the system."""
    value = ["gamekeeper"] * 300_000
    assert value == run("echo", {"value": value}).value


def test_workers_hand_on_reports_in_their_order() -> None:
    """Every report with fields arrives, in order, before the outcome."""
    seen: list[dict[str, Any]] = []
    outcome = run("count", {"most": 5_000}, on_message=seen.append)
    assert outcome.value == "counted"
    assert [{"number": number} for number in range(5_000)] == seen


@pytest.mark.parametrize(
    ("name", "arguments", "error"),
    [
        ("raise_chained", {}, "ValueError: the effect"),
        ("raise_exit", {"code": 3}, "SystemExit: 3"),
        ("raise_exit", {"code": None}, "SystemExit: None"),
        ("raise_interrupt", {}, "KeyboardInterrupt"),
        ("raise_surrogate", {}, "ValueError: half a character: \udc80"),
        ("add", {"first": 1}, "TypeError: add() missing 1 required keyword-only argument"),
    ],
)
def test_workers_catch_everything_that_is_raised(
    name: str, arguments: dict[str, Any], error: str
) -> None:
    """Exceptions, also those that end programs, are data with a traceback."""
    outcome = run(name, arguments)
    assert outcome.status == "raised"
    assert outcome.error is not None
    assert outcome.error.startswith(error)
    assert outcome.traceback is not None
    assert "worker_main" not in outcome.traceback


def test_workers_keep_the_whole_chain_of_a_traceback() -> None:
    """The cause stands in the traceback too, with file and line."""
    traceback = run("raise_chained").traceback or ""
    assert "KeyError: 'the cause'" in traceback
    assert "direct cause" in traceback
    assert 'worker_tasks.py", line' in traceback


def test_workers_name_exceptions_that_cannot_be_shown() -> None:
    """An exception whose text raises is named all the same."""
    outcome = run("raise_speechless")
    assert outcome.status == "raised"
    assert "SpeechlessError: <no message: its __str__ raised RuntimeError>" in (outcome.error or "")
    assert "in raise_speechless" in (outcome.traceback or "")


def test_workers_show_frames_where_a_traceback_cannot_be_formatted() -> None:
    """An exception whose attributes raise still tells where it came from."""
    outcome = run("raise_prickly")
    assert outcome.error == "tests.rollouts.worker_tasks.PricklyError: ouch"
    assert "in raise_prickly" in (outcome.traceback or "")


def test_workers_cut_endless_messages() -> None:
    """Ten megabytes of message don't become ten megabytes of report."""
    outcome = run("raise_at_length")
    assert 11_000 > len(outcome.error or "") > 9_000
    assert "characters left out" in (outcome.error or "")


def test_workers_survive_endless_recursion() -> None:
    """A task that recurses for ever is data."""
    outcome = run("recurse")
    assert outcome.status == "raised"
    assert (outcome.error or "").startswith("RecursionError")


@pytest.mark.parametrize(
    ("task", "error"),
    [
        ("tests.rollouts.worker_tasks:nothing", "has no function 'nothing'"),
        ("tests.rollouts.worker_tasks:NOTHING", "has no function 'NOTHING'"),
        ("tests.rollouts.no_such_module:task", "No module named 'tests.rollouts.no_such_module'"),
        ("no colon", "a task is named 'module:function', not 'no colon'"),
    ],
)
def test_workers_say_that_a_task_cannot_be_found(task: str, error: str) -> None:
    """A wrong name is an outcome that says which part is wrong."""
    outcome = run_task(task, {})
    assert outcome.status == "raised"
    assert error in (outcome.error or "")


def test_workers_refuse_results_that_json_cannot_carry() -> None:
    """A set is no JSON: the task is named, and what is wrong with its result."""
    outcome = run("return_a_set")
    assert outcome.status == "raised"
    assert "returned what JSON can't carry: Object of type set" in (outcome.error or "")
    assert run("report_a_set").status == "raised"


def test_workers_refuse_arguments_that_json_cannot_carry() -> None:
    """The caller's own mistake is raised at the caller, before a process is started."""
    with pytest.raises(TypeError, match="set is not JSON serializable"):
        run("echo", {"value": {1, 2}})


def test_workers_name_the_crash_and_where_it_was() -> None:
    """A segmentation fault is data, with the Python stack that led to it."""
    outcome = run("crash")
    assert (outcome.status, outcome.error) == ("died", "killed by SIGSEGV")
    assert "worker_tasks.py" in (outcome.traceback or "")
    assert "in crash" in (outcome.traceback or "")


@pytest.mark.parametrize(
    ("name", "arguments", "error"),
    [
        ("leave", {"code": 3}, "exit code 3"),
        ("leave", {"code": 0}, "exit code 0, before the task returned"),
        ("crash_by_signal", {"number": int(signal.SIGTERM)}, "killed by SIGTERM"),
        ("crash_by_signal", {"number": int(signal.SIGKILL)}, "killed by SIGKILL (from outside"),
        ("close_descriptors", {}, "exit code 1"),
    ],
)
def test_workers_name_what_ended_a_process(
    name: str, arguments: dict[str, Any], error: str
) -> None:
    """A process that ends without an answer has died, and is told by what."""
    outcome = run(name, arguments)
    assert outcome.status == "died"
    assert (outcome.error or "").startswith(error)


@pytest.mark.parametrize("name", ["wait_for_ever", "sleep_in_c"])
def test_workers_end_a_task_that_hangs_and_tell_where(name: str) -> None:
    """Silence ends the task; the error and the stacks say where it was, also in C."""
    outcome = run(name, silence_s=1.0)
    assert outcome.status == "hung"
    assert (outcome.error or "").startswith(f"no sign of life for 1 s in {name} (")
    assert f"in {name}" in (outcome.traceback or "")
    assert "worker_main" not in (outcome.traceback or "")


def test_workers_take_waits_of_ours_as_signs_of_life() -> None:
    """A kernel that compiles for longer than an environment may be silent isn't one that hangs."""
    outcome = run("wait_and_return", {"seconds": 4.0}, silence_s=2.0)
    assert outcome.value == "compiled", outcome.error


def test_workers_take_reports_as_signs_of_life() -> None:
    """A task that reports isn't silent; only the limit in all ends it."""
    outcome = run("spin_for_ever", silence_s=0.5, limit_s=1.2)
    assert outcome.status == "hung"
    assert (outcome.error or "").startswith("not done after 1.2 s in ")
    assert outcome.seconds > 1.2


def test_workers_bound_memory() -> None:
    """A task that takes too much gets a MemoryError that names the limit; others don't."""
    limit = 256 << 20
    outcome = run("take_memory", {"size_bytes": 1 << 30}, memory_bytes=limit)
    assert (outcome.status, outcome.error) == (
        "raised",
        "MemoryError (memory limit: 268,435,456 bytes)",
    )
    assert run("take_memory", {"size_bytes": 1 << 20}, memory_bytes=limit).value == 1 << 20


def test_workers_send_prints_to_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    """Whatever a task, its C code and its children print stays out of standard output."""
    assert run("print_everywhere").value == "printed"
    out, err = capfd.readouterr()
    assert out == ""
    assert {"python", "the descriptor", "a child", "C"} == {
        line.partition(" says")[0] for line in err.splitlines()
    }


def test_workers_keep_what_was_printed_before_a_crash(capfd: pytest.CaptureFixture[str]) -> None:
    """Last words aren't lost in a buffer."""
    run("print_then_crash")
    assert capfd.readouterr().err == "last words\n"


def test_workers_give_a_task_nothing_to_read() -> None:
    """Standard input is empty: a task that asks doesn't wait for ever."""
    assert run("read_input").value == ""


def test_workers_load_only_the_standard_library_before_the_task() -> None:
    """No numpy, no gamekeeper, no argument of ours and no thread stands beside the task."""
    facts = run("facts").value
    assert isinstance(facts, dict)
    assert not [name for name in facts["loaded"] if name.startswith(("numpy", "gamekeeper"))]
    assert facts["argv"] == []
    if sys.platform == "linux":
        assert facts["threads"] == 1


@pytest.mark.parametrize("modules", [None, ["json"]], ids=["fresh", "warm"])
def test_workers_look_for_garbage_in_what_a_task_makes_alone(modules: list[str] | None) -> None:
    """What was imported before a task is left out of the garbage collector's later searches."""
    if modules is None:
        facts = run("facts").value
    else:
        with WarmWorker(modules) as worker:
            facts = worker.run("tests.rollouts.worker_tasks:facts", {}).value
    assert isinstance(facts, dict)
    assert facts["collects"]
    assert facts["frozen"] > 1_000


def test_workers_import_modules_beside_the_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The parent's path is handed on as it is at the moment of the call."""
    (tmp_path / "beside.py").write_text("def task(report):\n    return 'found'\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert run_task("beside:task", {}).value == "found"


def test_workers_set_hash_seed_and_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal hash seeds give equal hashes, others don't; variables are those of now."""
    monkeypatch.setenv("GAMEKEEPER_TEST", "on")
    facts: list[Any] = [run("facts", hash_seed=seed).value for seed in (1, 1, 2)]
    assert facts[0]["hash"] == facts[1]["hash"] != facts[2]["hash"]
    assert facts[0]["variable"] == "on"
    with pytest.raises(ValueError, match="hash_seed is -1"):
        run("facts", hash_seed=-1)


def test_workers_let_a_task_use_multiprocessing() -> None:
    """Environments that spawn processes of their own work inside a worker."""
    assert run("spawn_with_multiprocessing").value == 3


def test_workers_skip_lines_that_are_no_messages() -> None:
    """What an interrupt cut short, or a stranger wrote, spoils no other message."""
    order = {
        "task": "tests.rollouts.worker_tasks:facts",
        "arguments": {},
        "path": sys.path,
        "memory_bytes": None,
    }
    with WorkerProcess(order, os.environ) as worker:
        for line in (b'["report", {"cut', b"", b"[1, 2, 3]", b"\xff", b"[" * 100_000):
            worker._accept(line)
        assert [message for message in worker.messages(0.0) if message[0] == "report"] == []


def test_stacks_name_the_place_outside_the_library() -> None:
    """The innermost frame of foreign code is named, else the innermost of all."""
    frames = [
        "Current thread 0x1 (most recent call first):",
        f'  File "{threading.__file__}", line 320 in wait',
        '  File "/home/me/env.py", line 12 in step',
    ]
    assert place("\n".join(frames)) == "step (/home/me/env.py:12)"
    assert f"wait ({threading.__file__}:320)" == place("\n".join(frames[:2]))
    assert place(None) is None
    assert place("Current thread 0x1 (most recent call first):\n  <no Python frame>") is None
