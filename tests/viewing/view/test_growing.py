"""A run that is looked at while it is recorded, killed and recovered: every state is shown."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.reporting.page.episode_list import packed_of
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recording import record
from gamekeeper.runs.run_check import recover
from gamekeeper.viewing import viewer_runs as book
from gamekeeper.viewing.viewer import Viewer
from tests.cli.lines import SURROUNDINGS
from tests.viewing.view import growing
from tests.viewing.view.growing import Walk
from tests.viewing.view.visiting import Visitor

PATIENCE_S = 60.0
LOOKERS = 4
RECORDING = Path(growing.__file__)


class Recorder:
    """A recording in a process of its own, turn by turn."""

    def __init__(self, run: Path) -> None:
        line = [sys.executable, str(RECORDING), str(run)]
        self.process = subprocess.Popen(
            line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=SURROUNDINGS
        )

    def say(self, word: object) -> None:
        """Has it do something, and waits until that is done."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{word}\n")
        self.process.stdin.flush()
        if word != "close":
            assert self.process.stdout.readline() == "done\n"


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    """Records into `run`."""
    found = Recorder(tmp_path / "run")
    yield found
    found.process.kill()
    found.process.communicate()


def until(look: Callable[[], Any], holds: Callable[[Any], bool]) -> Any:
    """What `look` gives once it holds; a recording is written some milliseconds after its turns."""
    end = time.monotonic() + PATIENCE_S
    while not holds(found := look()):
        assert time.monotonic() < end, found
    return found


def entry(visitor: Visitor, number: int) -> dict[str, Any]:
    """The line of an episode in the index; an empty one where it isn't there."""
    found = visitor.get("/index.json").document["episodes"]
    return next((each for each in found if each["episode"] == number), {})


@contextmanager
def looking(visitor: Visitor, *targets: str) -> Iterator[list[int]]:
    """Threads that ask for these all the while; the statuses of their answers."""
    statuses: list[int] = []
    is_over = threading.Event()

    def look() -> None:
        while not is_over.is_set():
            statuses.extend(visitor.get(target).status for target in targets)

    threads = [threading.Thread(target=look) for _ in range(LOOKERS)]
    for thread in threads:
        thread.start()
    try:
        yield statuses
    finally:
        is_over.set()
        for thread in threads:
            thread.join()


def test_every_state_of_a_recording_is_shown(
    recorder: Recorder, tmp_path: Path, eager: None
) -> None:
    """Open and growing, a second episode, killed, recovered; never a fault in between."""
    run = tmp_path / "run"
    recorder.say(3)
    until(lambda: (run / "agent_steps-0000.arrows").exists(), bool)
    with Viewer([run]) as view:
        visitor = Visitor(view)
        with looking(visitor, "/index.json", "/episode/a/0", "/episode/a/1", "/") as statuses:
            first = until(lambda: entry(visitor, 0), lambda found: found["turns"] == 3)
            assert first["end"] == "open"
            recorder.say(40)
            until(lambda: entry(visitor, 0), lambda found: found["turns"] == 43)
            assert visitor.get("/episode/a/0").document["turns"] == 43
            recorder.say("reset")
            recorder.say(7)
            until(lambda: entry(visitor, 1), lambda found: found.get("turns") == 7)
            assert entry(visitor, 0)["end"] == "cut"
            recorder.process.kill()
            recorder.process.wait()
            assert visitor.get("/index.json").document["runs"][0]["status"] == "open"
            recover(run)
            until(
                lambda: visitor.get("/index.json").document["runs"][0],
                lambda found: found["status"] == "recovered" and found["error"] is None,
            )
        assert entry(visitor, 1)["end"] == "torn"
        assert set(statuses) <= {200, 404}  # 404: episode 1, before it began


def test_recording_that_ends_is_finalized_on_the_page(tmp_path: Path, eager: None) -> None:
    """While somebody looks, the segments go and the tables come; then it is as it was finalized."""
    run = tmp_path / "run"
    env = record(Walk(), run)
    played(env, 5)
    until(lambda: len(steps_of(run)) == 10, bool)
    with Viewer([run]) as view:
        visitor = Visitor(view)
        with looking(visitor, "/index.json", "/episode/a/0") as statuses:
            for _ in range(60):
                env.step(dict.fromkeys(env.agents, 1))
            env.close()
            until(
                lambda: visitor.get("/index.json").document["runs"][0],
                lambda found: found["status"] == "finalized" and found["error"] is None,
            )
        assert set(statuses) == {200}
        expected = packed_of(load(run), 0, run="a")
        assert visitor.get("/episode/a/0").document["rows"] == expected["rows"]
        assert visitor.get("/report").status == 200


def test_growing_run_is_not_read_at_every_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many look, it is read again once a while: the recording needs the cores."""
    run = tmp_path / "run"
    env = record(Walk(), run)
    played(env, 3)
    until(lambda: len(steps_of(run)) == 6, bool)
    read: list[Path] = []
    monkeypatch.setattr(book, "load", lambda path: (read.append(path), load(path))[1])
    monkeypatch.setattr(book, "SOONEST_S", 3600.0)
    with Viewer([run]) as view:
        for _ in range(5):
            env.step(dict.fromkeys(env.agents, 1))
            assert Visitor(view).get("/index.json").status == 200
    env.close()
    assert read == [run]


def played(env: Any, turns: int) -> None:
    """Resets and plays so many turns."""
    env.reset(seed=0)
    for _ in range(turns):
        env.step(dict.fromkeys(env.agents, 1))


def steps_of(run: Path) -> Any:
    """The rows that are written so far."""
    return load(run).agent_steps
