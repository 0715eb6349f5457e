from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.contract import Contract
from gamekeeper.diagnosis import arms
from gamekeeper.diagnosis.arms import ArmOrder, ArmRunner, kept_open, play_shares
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.errors import EnvError
from gamekeeper.rollouts.executors.task import USUAL, Done, Limits, OnReport, WorkTask
from gamekeeper.rollouts.workers import Status, TaskOutcome
from tests.runs.parts.here import Here


class Opened:
    """Something that is open until it is left."""

    def __init__(self, log: list[str], name: str) -> None:
        self.log, self.name = log, name
        log.append(f"open {name}")

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *error: object) -> None:
        self.log.append(f"close {self.name}")


class Ending(Here):
    """Every task ends in one way."""

    def __init__(self, status: Status) -> None:
        super().__init__()
        self._status = status

    def map(
        self,
        tasks: Iterable[WorkTask],
        *,
        limits: Limits = USUAL,
        on_report: OnReport | None = None,
    ) -> Iterator[Done]:
        """Yields each task as it ends."""
        for task in tasks:
            yield Done(task.key, TaskOutcome(self._status, None, "why", None, 0.0))


@pytest.fixture(autouse=True)
def _nothing_is_kept() -> Iterator[None]:
    """What one test keeps open is no other's."""
    arms._close_kept()
    yield
    arms._close_kept()


def test_one_set_up_is_kept_open_from_task_to_task() -> None:
    """The same key finds it open; another closes it first."""
    log: list[str] = []
    for name in ("a", "a", "b", "b", "a"):
        with kept_open(name, lambda name=name: Opened(log, name)) as opened:
            assert opened.name == name
    assert log == ["open a", "close a", "open b", "close b", "open a"]


def test_set_up_in_which_something_raised_is_not_used_again() -> None:
    """Nobody knows what state it is in, so the next task opens another."""
    log: list[str] = []
    with pytest.raises(LookupError), kept_open("a", lambda: Opened(log, "a")):
        raise LookupError
    with kept_open("a", lambda: Opened(log, "a")):
        pass
    assert log == ["open a", "close a", "open a"]
    with pytest.raises(ZeroDivisionError), kept_open("b", lambda: 1 / 0):  # type: ignore[type-var]  # never opens
        pass
    assert log[-1] == "close a"


def echo_task(report: Any, *, number: int) -> int:
    """Reports and returns its number."""
    report(number=number)
    return number


def test_shares_are_taken_once_whoever_plays() -> None:
    """What each task returned comes once; its reports come as well, where they do."""
    taken: list[int] = []
    heard: list[dict[str, Any]] = []
    play_shares(
        f"{__name__}:echo_task",
        ({"number": n} for n in range(7)),
        taken.append,
        workers=Here(3),
        silence_s=None,
        where="here",
        fix="none",
        on_report=heard.append,
    )
    assert sorted(taken) == list(range(7))
    assert sorted(each["number"] for each in heard) == list(range(7))


@pytest.mark.parametrize("status", ["died", "hung", "raised", "interrupted"])
def test_share_that_is_not_played_ends_the_experiment(status: Status) -> None:
    """A death is told with its place and the fix; an interrupt is Ctrl-C."""
    kind = KeyboardInterrupt if status == "interrupted" else EnvError
    with pytest.raises(kind) as caught:
        play_shares(
            "a:b",
            [{}],
            lambda answer: None,
            workers=Ending(status),
            silence_s=None,
            where="arm noise",
            fix="play here",
        )
    if isinstance(caught.value, EnvError):
        assert (caught.value.where, caught.value.fix) == ("arm noise", "play here")
        assert status in caught.value.what


def test_one_executor_plays_all_arms_of_a_runner(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its processes stay from one `play` to the next, and end with the runner."""
    log: list[str] = []

    class Local(Here):
        def __enter__(self) -> "Local":
            log.append("enter")
            return self

        def close(self) -> None:
            log.append("close")

        def map(self, *args: Any, **options: Any) -> Iterator[Done]:
            log.append("map")
            return super().map(*args, **options)

    monkeypatch.setattr(arms, "LocalExecutor", lambda workers: log.append("new") or Local(workers))
    setup = Setup("two_robot_line", policies={"*": "random"})
    with ArmRunner(Contract(), workers=2) as runner:
        for name in ("a", "b"):
            runner.play([ArmOrder(name, setup, 5, range(2))])
    assert log == ["new", "enter", "map", "map", "close"]
    theirs = Local(2)
    with ArmRunner(Contract(), workers=theirs) as runner:
        runner.play([ArmOrder("a", setup, 5, range(2))])
    assert log[5:] == ["map"]


def test_arms_come_out_the_same_whoever_plays(tmp_path: Path) -> None:
    """Outcomes are noted once each, and an arm that can't be opened is told by anybody."""
    arms = {
        "unchanged": Setup("two_robot_line", policies={"*": "random"}),
        "slow": Setup("two_robot_line", policies={"*": "random"}, most_turns=2),
        "none": Setup("two_robot_line", kwargs={"no_such": 1}, policies={"*": "random"}),
    }
    orders = [ArmOrder(name, setup, 5, range(6)) for name, setup in arms.items()]
    labs = [ArmRunner(Contract()), ArmRunner(Contract(), workers=Here(2), notes=tmp_path / "notes")]
    for runner in labs:
        runner.play(orders)
    here, there = labs
    assert here.outcomes == there.outcomes
    assert (here.spent, there.spent) == (12, 12)
    assert here.broken == there.broken
    assert list(there.broken) == ["none"]
    again = ArmRunner(Contract(), workers=Ending("died"), notes=tmp_path / "notes")
    again.play(orders[:2])
    assert again.outcomes == here.outcomes
    assert len((tmp_path / "notes").read_text().splitlines()) == 13
