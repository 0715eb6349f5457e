import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.errors import DependencyError, GamekeeperError
from gamekeeper.rollouts.executors import ray as ray_executor
from gamekeeper.rollouts.executors import ray_cluster
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.ray import LOSSES, RayExecutor
from gamekeeper.rollouts.executors.ray_cluster import AHEAD
from gamekeeper.rollouts.executors.task import Done, Limits, WorkTask, stopped_after

TRIES = 4
"""Kills of a node until one hits it at work."""

pytest.importorskip("ray")
pytestmark = pytest.mark.trainer


def task(key: str, name: str, **arguments: Any) -> WorkTask:
    """One of the tasks that every executor is tried with."""
    return WorkTask(key, f"tests.rollouts.executors.executor_tasks:{name}", arguments)


def on_node(key: str, name: str, **arguments: Any) -> WorkTask:
    """One of the tasks for nodes."""
    return WorkTask(key, f"tests.rollouts.executors.ray_tasks:{name}", arguments)


@pytest.fixture(scope="module")
def executor() -> Iterator[RayExecutor]:
    """Two cores of a cluster of this machine's."""
    with RayExecutor(workers=2) as found:
        yield found


def played(executor: RayExecutor, tasks: list[WorkTask], **options: Any) -> dict[str, Done]:
    """Every task's end, by key."""
    ends = list(executor.map(tasks, **options))
    assert len(ends) == len({end.key for end in ends}) == len(tasks)
    return {end.key: end for end in ends}


def test_ray_plays_each_task_once_as_local_processes_do(executor: RayExecutor) -> None:
    """Forty tasks, forty answers, in few processes, the same answers as without Ray."""
    tasks = [task(f"t{n}", "twice", number=n) for n in range(30)]
    ends = played(executor, [*tasks, *(task(f"p{n}", "process") for n in range(10))])
    processes = {ends.pop(f"p{n}").outcome.value for n in range(10)}
    assert {key: end.outcome.value for key, end in ends.items()} == {
        end.key: end.outcome.value for end in LocalExecutor(2).map(tasks)
    }
    assert {end.attempts for end in ends.values()} == {1}
    assert 1 <= len(processes) <= 4
    assert os.getpid() not in processes


def test_ray_draws_tasks_as_they_are_played(executor: RayExecutor) -> None:
    """A source of any length is asked for little more than what is played."""
    drawn = []

    def tasks() -> Iterator[WorkTask]:
        for number in range(1_000_000):
            drawn.append(number)
            yield task(f"t{number}", "twice", number=number)

    with stopped_after(executor.map(tasks())) as ends:
        next(ends)
    assert len(drawn) <= 3 * AHEAD * 2


def test_ray_tells_crashes_and_hangs_as_data(executor: RayExecutor, tmp_path: Path) -> None:
    """A killed task is played anew; one that always dies, raises or hangs is told why."""
    often = tmp_path / "often"
    ends = played(
        executor,
        [
            task("once", "die_once", mark=str(tmp_path / "once")),
            task("always", "die", mark=str(often)),
            task("raises", "refuse", why="no such level"),
            task("hangs", "be_silent"),
            task("after", "twice", number=4),
        ],
        limits=Limits(silence_s=2.0),
    )
    assert (ends["once"].outcome.status, ends["once"].outcome.value, ends["once"].attempts) == (
        "done",
        "played",
        2,
    )
    assert (ends["always"].outcome.status, ends["always"].attempts, often.read_text()) == (
        "died",
        3,
        "xxx",
    )
    assert "exit code 7" in str(ends["always"].outcome.error)
    assert (ends["raises"].outcome.status, ends["raises"].attempts) == ("raised", 1)
    assert "ValueError: no such level" in str(ends["raises"].outcome.error)
    assert (ends["hangs"].outcome.status, ends["hangs"].attempts) == ("hung", 1)
    assert "be_silent" in str(ends["hangs"].outcome.error)
    assert ends["after"].outcome.value == 8


def test_ray_places_anew_what_a_lost_node_played(
    executor: RayExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It doesn't count towards the task's own attempts; what ruins every node ends all the same."""
    monkeypatch.setattr(ray_executor, "LOSSES", 2)
    assert LOSSES > 2
    ends = played(
        executor,
        [
            on_node("once", "lose_node", tried=str(tmp_path / "once"), losses=1),
            on_node("always", "lose_node", tried=str(tmp_path / "always"), losses=99),
        ],
        limits=Limits(attempts=1),
    )
    assert (ends["once"].outcome.status, ends["once"].outcome.value, ends["once"].attempts) == (
        "done",
        "played",
        2,
    )
    assert (ends["always"].outcome.status, ends["always"].attempts) == ("died", 2)
    assert "the node was lost 2 times" in str(ends["always"].outcome.error)


def test_ray_interrupts_what_is_in_flight(executor: RayExecutor, tmp_path: Path) -> None:
    """Where the loop is left, a task gets its Ctrl-C, and what waits behind it is never played."""
    waits = [
        task(f"wait{n}", "wait", begun=f"{tmp_path}/begun{n}", ended=f"{tmp_path}/ended{n}")
        for n in range(3)
    ]
    with stopped_after(executor.map([task("first", "twice", number=1), *waits])) as ends:
        assert next(ends).key == "first"
        deadline_s = time.monotonic() + 30
        while len(list(tmp_path.glob("begun*"))) < 2:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
    assert len(list(tmp_path.glob("begun*"))) == 2
    assert [path.read_text() for path in tmp_path.glob("ended*")] == ["interrupted"] * 2


def test_ray_nodes_take_over_what_results_hang_on(
    executor: RayExecutor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder, the hash seed and the number of threads; of the last, also that it isn't set."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONHASHSEED", "12")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    asked = on_node("where", "place", names=["PYTHONHASHSEED", "OMP_NUM_THREADS"])
    found = played(executor, [asked])["where"].outcome.value
    assert [str(tmp_path), {"PYTHONHASHSEED": "12", "OMP_NUM_THREADS": None}] == found


def test_ray_keeps_what_environments_print_on_their_nodes(
    executor: RayExecutor, capfd: pytest.CaptureFixture[str]
) -> None:
    """Nothing of it comes to the driver's screen."""
    assert played(executor, [on_node("talk", "talk", lines=50)])["talk"].outcome.status == "done"
    assert capfd.readouterr() == ("", "")


def test_ray_refuses_a_node_with_another_gamekeeper(
    executor: RayExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two versions would record two kinds of evidence."""
    monkeypatch.setattr(ray_cluster, "version", lambda: "9.9")
    with pytest.raises(DependencyError, match="another Gamekeeper"):
        played(executor, [task("t", "twice", number=1)])


def test_ray_nodes_show_that_they_reach_the_storage(executor: RayExecutor, tmp_path: Path) -> None:
    """Each writes a file that the driver finds; nothing of that stays."""
    storage = tmp_path / "storage"
    executor.check_storage(str(storage))
    assert list(storage.iterdir()) == []


def test_ray_refuses_storage_that_a_node_does_not_reach(
    executor: RayExecutor, tmp_path: Path
) -> None:
    """The node's own reason is told."""
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    with pytest.raises(GamekeeperError, match="not every node reaches the storage") as caught:
        executor.check_storage(str(blocked / "storage"))
    assert caught.value.expected == "all of 1 nodes"
    assert "failed" in caught.value.actual


def test_ray_cluster_keeps_its_evidence_when_a_node_is_killed(tmp_path: Path) -> None:
    """Of two nodes on loopback one is killed in mid-run: nothing is lost, and nothing twice."""
    from benchmarks import ray_cluster

    if not is_permitted(ray_cluster):
        pytest.skip("a network namespace takes root (unshare --net)")
    script = [sys.executable, str(ray_cluster.HERE), "--runs", "killed"]
    spec, _, kwargs = ray_cluster.ENV
    plain = gk.rollout(spec, episodes=40, seed=7, out=tmp_path, env_kwargs=json.loads(kwargs))
    for _ in range(TRIES):
        found = ray_cluster.inside(
            [*script, "--episodes", "40", "--tasks", "0"],
            text=True,
            capture_output=True,
            timeout=300,
        )
        killed, _same = ray_cluster.read(found.stdout)
        assert killed["fingerprint"] == plain.fingerprint, found.stdout + found.stderr
        assert killed["in_order"]
        assert killed["parts_at_kill"] < 40
        if killed["died"]:  # else the node had just handed in all that it had
            return
    pytest.fail(f"the killed node held nothing, {TRIES} times")


def is_permitted(cluster: Any) -> bool:
    """Whether this account may make a network namespace, and the tools for it are here."""
    try:
        return bool(cluster.inside(["true"], capture_output=True).returncode == 0)
    except (OSError, subprocess.SubprocessError):
        return False
