"""Arms of an experiment: set-ups played on the same seeds, here or in worker processes.

An outcome is keyed by arm, run seed and episode, never by who played it, and is written down as it
comes: an experiment that was stopped goes on where it was.
"""

import atexit
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, Final, Self, TypeVar

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.open_setup import OpenSetup, Setup
from gamekeeper.diagnosis.plain_data import PlainData
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.errors import ActionError, EnvError, PolicyError, RunError, SpecError
from gamekeeper.interface.packing import type_name_of
from gamekeeper.rollouts.executors.local import LocalExecutor
from gamekeeper.rollouts.executors.task import Executor, Limits, WorkTask, stopped_after


def play_shares(
    call: str,
    shares: Iterable[Mapping[str, Any]],
    take: Callable[[Any], None],
    *,
    workers: int | Executor,
    silence_s: float | None,
    where: str,
    fix: str,
    on_report: Callable[[dict[str, Any]], None] | None = None,
) -> None:
    """Plays each share by a task, `workers` of them at a time.

    Args:
        call: "module:function".
        shares: the arguments of each task; drawn as workers get free, in several threads.
        take: called with what each task returned, once, in this thread.
        workers: how many processes of this machine; or who plays in their place.
        silence_s: longest time without a sign of life.
        where, fix: what an error says of the place and of what to do.
        on_report: called with each report, one at a time, in several threads; of a task that is
            tried again, more than once.
    Raises:
        EnvError: a worker process hung, or died as often as it was tried.
        KeyboardInterrupt: by Ctrl-C.
    """
    hear = on_report or (lambda fields: None)
    tasks = (WorkTask(f"share-{number:07d}", call, share) for number, share in enumerate(shares))
    players = LocalExecutor(workers) if isinstance(workers, int) else workers
    limits = Limits(silence_s=silence_s)
    answers = players.map(tasks, limits=limits, on_report=lambda key, fields: hear(fields))
    with stopped_after(answers) as ends:
        for done in ends:
            end = done.outcome
            if end.status == "interrupted":
                raise KeyboardInterrupt
            if end.status != "done":
                raise EnvError(
                    f"a worker process {end.status} while it played",
                    where=where,
                    actual=str(end.error),
                    fix=fix,
                )
            take(end.value)


Opened = TypeVar("Opened", bound=AbstractContextManager[Any])


_KEPT: Final[dict[str, Any]] = {}
"""The one environment that a worker process holds open from task to task, with its key."""


@atexit.register
def _close_kept() -> None:
    opened = _KEPT.pop("opened", None)
    _KEPT.clear()
    if opened is not None:
        opened.__exit__(None, None, None)


@contextmanager
def kept_open(key: object, make: Callable[[], Opened]) -> Iterator[Opened]:
    """Environment that `make` opens, kept for the next task of this process that asks for it.

    At most one is kept, the last. It is closed when another is asked for, when something is raised
    while it is in use, and when the process ends. For worker processes: tasks come one at a time.

    Args:
        key: equal for what is the same.
        make: opens it; what it opened is its own context, which closes it.
    """
    if "opened" not in _KEPT or key != _KEPT["key"]:
        _close_kept()
        _KEPT.update(opened=make(), key=key)
    try:
        yield _KEPT["opened"]
    except BaseException:
        _close_kept()
        raise


TASK: Final = "gamekeeper.diagnosis.arms:arms_task"
SILENCE_S: Final = 60.0
EPISODES_EACH: Final = 4
"""Most episodes of a worker's task: how far workers can end apart."""
Key = tuple[str, int, int]
"""Arm, run seed, episode."""


@dataclass(frozen=True, slots=True)
class ArmOrder:
    """Episodes of an arm that are wanted."""

    arm: str
    setup: Setup
    run_seed: int
    episodes: Sequence[int]


@dataclass(slots=True)
class ArmRunner:
    """Plays orders and keeps what came of them.

    Attributes:
        contract: names reward terms and volatile infos.
        workers: processes that play; 0: this one does; or an executor that plays.
        notes: the file in which outcomes are kept; None: they are kept in memory.
        head: what the file has to begin with, so that no other experiment's outcomes are taken.
        on_message: called with `{"episode", "episodes"}`.
        broken: by arm, why it can't be played.
        spent: episodes played so far, those of an earlier call not among them.
        used: episodes that were ordered so far and have an outcome, also those of an earlier call,
            so that a call that goes on stops where one without a break does.
        steps: env steps of those.
        longest: env steps of the longest of them, and of whatever is known to be as long.
        most: episodes that may be played.
        budget: env steps that may be taken; None: as many as those take.
        extra: episodes that were played, or are to be, outside of arms.

    As a context it keeps its worker processes from one `play` to the next.
    """

    contract: Contract
    workers: int | Executor = 0
    notes: Path | None = None
    head: Mapping[str, Any] = field(default_factory=dict)
    on_message: Callable[[dict[str, Any]], None] | None = None
    silence_s: float | None = SILENCE_S
    outcomes: dict[Key, Outcome] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)
    spent: int = 0
    used: set[Key] = field(default_factory=set)
    steps: int = 0
    longest: int = 1
    most: int = 2_000
    budget: int | None = None
    extra: int = 0
    _players: Executor | None = None
    _lock: Any = field(default_factory=Lock)

    def __post_init__(self) -> None:
        if not isinstance(self.workers, int):
            self._players = self.workers
        elif self.workers:
            self._players = LocalExecutor(self.workers)
        if self.notes is not None:
            self.outcomes.update(_noted(self.notes, self.head))

    def __enter__(self) -> Self:
        if isinstance(self.workers, int) and self._players is not None:
            self._players.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if isinstance(self.workers, int) and self._players is not None:
            self._players.close()

    @property
    def reused(self) -> int:
        """Episodes of an earlier call that were ordered again."""
        return len(self.used) - self.spent

    def play(self, orders: Sequence[ArmOrder]) -> None:
        """Plays what isn't known yet.

        Raises:
            EnvError: a worker process hung or died.
            GamekeeperError: a policy can't choose, or an arm that nothing was changed in can't be
                opened.
        """
        wanted = [
            (o, left)
            for o in orders
            if o.arm not in self.broken
            and (left := [k for k in o.episodes if (o.arm, o.run_seed, k) not in self.outcomes])
        ]
        total = sum(len(episodes) for _, episodes in wanted)
        if total:
            self._say(episode=0, episodes=total)
            if self._players is None:
                self._play_here(wanted, total)
            else:
                self._play_apart(self._players, wanted, total)
        keys = {(o.arm, o.run_seed, k) for o in orders for k in o.episodes}
        new = (keys & self.outcomes.keys()) - self.used
        self.used |= new
        turns = [self.outcomes[key].turns for key in new]
        self.steps += sum(turns)
        self.longest = max([self.longest, *turns])

    @property
    def left(self) -> int:
        """Episodes that may still be played, each as long as the longest."""
        left = max(self.most - len(self.used) - self.extra, 0)
        return left if self.budget is None else min(left, self._steps_left // self.longest)

    @property
    def limit(self) -> str:
        """The limit that is reached first, in words."""
        left = self.most - len(self.used) - self.extra
        if self.budget is not None and self._steps_left // self.longest < left:
            return f"budget of {self.budget:,} env steps"
        return f"limit of {self.most} episodes"

    @property
    def _steps_left(self) -> int:
        return max((self.budget or 0) - self.steps - self.extra * self.longest, 0)

    def of(self, arm: str, run_seed: int, episodes: Sequence[int]) -> list[Outcome]:
        """The outcomes of an arm, in the order of its episodes."""
        return [self.outcomes[arm, run_seed, k] for k in episodes]

    def known(self, score: Callable[[Outcome], float], *, most: int = 12) -> list[str]:
        """Lines of what is known by now: the mean score of arms, those of most episodes first."""
        by_arm: dict[str, list[float]] = {}
        with self._lock:
            for (arm, _, _), outcome in self.outcomes.items():
                by_arm.setdefault(arm, []).append(score(outcome))
        arms = sorted(by_arm, key=lambda arm: -len(by_arm[arm]))
        lines = [
            f"{arm}: {sum(by_arm[arm]) / len(by_arm[arm]):.3g} over {len(by_arm[arm])} episodes"
            for arm in arms[:most]
        ]
        return [*lines, *([f"and {len(arms) - most} more"] if len(arms) > most else [])]

    def _play_here(self, wanted: Any, total: int) -> None:
        done = 0
        for order, episodes in wanted:
            try:
                open_setup = OpenSetup(order.setup, self.contract)
            except SpecError as error:
                self.broken[order.arm] = str(error.what)
                continue
            with open_setup:
                for episode in episodes:
                    outcome = open_setup.outcome(order.run_seed, episode)
                    self._take((order.arm, order.run_seed, episode), outcome)
                    done += 1
                    self._say(episode=done, episodes=total)

    def _play_apart(self, players: Executor, wanted: Any, total: int) -> None:
        """Workers play a few episodes at a time; outcomes are kept as they come."""
        done = [0]
        given = [(order, order.setup.to_json(), episodes) for order, episodes in wanted]

        def hear(fields: dict[str, Any]) -> None:
            if "outcome" in fields:
                key = (fields["arm"], fields["run_seed"], fields["episode"])
                if self._take(key, Outcome.from_json(fields["outcome"])):
                    done[0] += 1
                    self._say(episode=done[0], episodes=total)
            elif "broken" in fields:
                self.broken[fields["arm"]] = fields["broken"]

        def take(answers: Any) -> None:
            for fields in answers:
                hear(fields)

        play_shares(
            TASK,
            self._shares(given, players.workers),
            take,
            on_report=hear,
            workers=players,
            silence_s=self.silence_s,
            where=", ".join(dict.fromkeys(order.arm for order, _ in wanted))[:300],
            fix="what was played is kept; run the same command again to go on",
        )

    def _shares(self, given: Any, workers: int) -> Iterator[dict[str, Any]]:
        """A few episodes of an arm each, so that workers end at about the same time."""
        contract = self.contract.to_json()
        for order, setup, episodes in given:
            most = min(max(-(-len(episodes) // (2 * workers)), 1), EPISODES_EACH)
            for at in range(0, len(episodes), most):
                if order.arm in self.broken:
                    break
                yield {
                    "order": {
                        "arm": order.arm,
                        "setup": setup,
                        "run_seed": order.run_seed,
                        "episodes": list(episodes[at : at + most]),
                    },
                    "contract": contract,
                }

    def _take(self, key: Key, outcome: Outcome) -> bool:
        """Keeps an outcome; False where it is known, as of a task that was tried again."""
        with self._lock:
            if key in self.outcomes:
                return False
            self.outcomes[key] = outcome
            self.spent += 1
            if self.notes is not None:
                note(self.notes, {"key": list(key), "outcome": outcome.to_json()})
            return True

    def _say(self, **fields: Any) -> None:
        if self.on_message is not None:
            self.on_message(fields)


def arms_task(
    report: Callable[..., None], *, order: Mapping[str, Any], contract: Any
) -> list[dict[str, Any]]:
    """Plays an order in this process; reports each outcome, and returns them all."""
    setup = order["setup"]

    def make() -> OpenSetup:
        try:
            return OpenSetup(Setup.from_json(setup), Contract.from_json(contract))
        except SpecError as error:
            raise _Unopened(error.what) from error

    found: list[dict[str, Any]] = []
    try:
        with kept_open(json.dumps([setup, contract], sort_keys=True), make) as open_setup:
            for episode in order["episodes"]:
                outcome = open_setup.outcome(order["run_seed"], episode, on_step=report)
                found.append(
                    {
                        "arm": order["arm"],
                        "run_seed": order["run_seed"],
                        "episode": episode,
                        "outcome": outcome.to_json(),
                    }
                )
                report(**found[-1])
    except _Unopened as error:
        return [{"arm": order["arm"], "broken": str(error)}]
    return found


class _Unopened(Exception):  # noqa: N818  # no error of the run: the arm is told as broken
    """An arm's set-up can't be opened."""


def _noted(path: Path, head: Mapping[str, Any]) -> Iterator[tuple[Key, Outcome]]:
    """Yields outcomes noted by an earlier call."""
    for number, data in noted(path, head):
        try:
            arm, run_seed, episode = data["key"]
            yield (arm, run_seed, episode), Outcome.from_json(data["outcome"])
        except (ValueError, KeyError, TypeError) as error:
            raise damaged(path, number, error) from error


# -- notes of what was played, line by line: an experiment that was stopped goes on from them


def note(path: Path, data: Any) -> None:
    """Adds a line."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(data) + "\n")


def damaged(path: Path, number: int, error: Exception) -> RunError:
    """The error of a line that can't be read."""
    return RunError(
        "a noted outcome is damaged",
        where=f"{path}, line {number}",
        actual=str(error)[:200],
        fix="take the file away: the experiment is played anew",
    )


def noted(path: Path, head: Mapping[str, Any]) -> Iterator[tuple[int, Any]]:
    """Yields numbers and data of lines of an earlier call; a last one that was torn is dropped.

    Args:
        path: the file; written with its head where there is none.
        head: what the file has to begin with, so that no other experiment's outcomes are taken.
    Raises:
        RunError: the file is another experiment's, or damaged.
    """
    begin = json.dumps(dict(head), sort_keys=True)
    lines = path.read_bytes().split(b"\n") if path.exists() else []
    if not lines:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(begin + "\n", encoding="utf-8")
        return
    if lines[0].decode("utf-8", "replace") != begin:
        raise RunError(
            "outcomes of another experiment lie here",
            where=str(path),
            expected="the same run, seed and set-up",
            actual=_changed(lines[0], begin),
            fix="name another folder with --out, or take this one away",
        )
    whole = lines[:-1]
    for number, line in enumerate(whole[1:], start=2):
        try:
            data = json.loads(line)
        except ValueError as error:
            raise damaged(path, number, error) from error
        yield number, data
    if lines[-1]:
        path.write_bytes(b"\n".join(whole) + b"\n")


def _changed(there: bytes, begin: str) -> str:
    """Differences between two heads, by name."""
    try:
        old, new = json.loads(there), json.loads(begin)
    except ValueError:
        old = None
    if not isinstance(old, dict):
        return there.decode("utf-8", "replace")[:200]
    pairs = _differing(old, new, "")
    return "; ".join(f"{name} was {was}, is {now}" for name, was, now in pairs)[:400]


def _differing(old: Any, new: Any, name: str) -> Iterator[tuple[str, str, str]]:
    """Yields the name of each value that differs, and both."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            inner = f"{name}.{key}" if name else key
            yield from _differing(old.get(key), new.get(key), inner)
    elif old != new:
        yield name, json.dumps(old)[:60], json.dumps(new)[:60]


BREAKS: Final = tuple(f"{type_name_of(kind)}: " for kind in (PolicyError, ActionError))
MOST: Final = 0.5
"""Part of the failed episodes from which nothing else is looked for."""


@dataclass(frozen=True, slots=True)
class RaisedPolicy(PlainData):
    """A policy that broke episodes off.

    Attributes:
        said: the first error, in words.
        turns: the first and the last turn at which it did so.
        count, episodes: how many episodes it broke off, and of how many.
    """

    agent: str
    said: str
    turns: tuple[int, int]
    count: int
    episodes: int

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {**PlainData.to_json(self), "text": str(self)}

    def __str__(self) -> str:
        first, last = self.turns
        where = f"at turn {first}" if first == last else f"at turns {first} to {last}"
        of = f"in {self.count} of {self.episodes} new episodes"
        return f"{self.agent}'s policy broke off {where} {of}: {self.said}"


def raised_in(outcomes: Iterable[Outcome]) -> tuple[RaisedPolicy, ...]:
    """The policies that broke episodes off, by agent, those of most episodes first."""
    every = list(outcomes)
    by_agent: dict[str, list[Outcome]] = {}
    for each in every:
        if each.error is not None and each.error.startswith(BREAKS):
            named = [x for x in each.returns if f"for {x!r}" in each.error]
            by_agent.setdefault(named[0] if named else "an agent", []).append(each)
    found = [
        RaisedPolicy(
            agent,
            " ".join(str(mine[0].error).partition(": ")[2].partition(" where: ")[0].split()),
            (min(each.turns for each in mine), max(each.turns for each in mine)),
            len(mine),
            len(every),
        )
        for agent, mine in by_agent.items()
    ]
    return tuple(sorted(found, key=lambda each: -each.count))
