"""Arms of an experiment: set-ups played on the same seeds, here or in worker processes.

An outcome is keyed by arm, run seed and episode, never by who played it, and is written down as it
comes: an experiment that was stopped goes on where it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any, Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.outcome import Outcome
from gamekeeper.diagnose.setup import Setup
from gamekeeper.diagnose.shares import kept_open, play_shares
from gamekeeper.diagnose.stage import Stage
from gamekeeper.errors import BundleError, SpecError
from gamekeeper.run.executors.task import Executor

TASK: Final = "gamekeeper.diagnose.arms:arms_task"
SILENCE_S: Final = 60.0
EPISODES_EACH: Final = 4
"""Most episodes of a worker's task: how far workers can end apart."""
Key = tuple[str, int, int]
"""Arm, run seed, episode."""


@dataclass(frozen=True, slots=True)
class Order:
    """Episodes of an arm that are wanted."""

    arm: str
    setup: Setup
    run_seed: int
    episodes: range


@dataclass(slots=True)
class Lab:
    """Plays orders and keeps what came of them.

    Attributes:
        contract: names reward terms and volatile infos.
        workers: processes that play; 0: this one does; or an executor that plays.
        notes: the file in which outcomes are kept; None: they are kept in memory.
        head: what the file has to begin with, so that no other experiment's outcomes are taken.
        on_message: called with `{"episode", "episodes"}`.
        outcomes: what is known.
        broken: by arm, why it can't be played.
        spent: episodes played so far, those of an earlier call not among them.
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
    _lock: Any = field(default_factory=Lock)

    def __post_init__(self) -> None:
        if self.notes is not None:
            self.outcomes.update(_noted(self.notes, self.head))

    def play(self, orders: Sequence[Order]) -> None:
        """Plays what isn't known yet.

        Raises:
            EnvError: a worker process hung or died.
            GamekeeperError: a policy can't choose, or an arm that nothing was changed in can't be
                opened.
        """
        wanted = [
            (
                order,
                [k for k in order.episodes if (order.arm, order.run_seed, k) not in self.outcomes],
            )
            for order in orders
            if order.arm not in self.broken
        ]
        wanted = [(order, episodes) for order, episodes in wanted if episodes]
        total = sum(len(episodes) for _, episodes in wanted)
        if not total:
            return
        self._say(episode=0, episodes=total)
        if self.workers == 0:
            self._play_here(wanted, total)
        else:
            self._play_apart(wanted, total)

    def of(self, arm: str, run_seed: int, episodes: range) -> list[Outcome]:
        """The outcomes of an arm, in the order of its episodes."""
        return [self.outcomes[arm, run_seed, k] for k in episodes]

    def _play_here(self, wanted: Any, total: int) -> None:
        done = 0
        for order, episodes in wanted:
            try:
                stage = Stage(order.setup, self.contract)
            except SpecError as error:
                self.broken[order.arm] = str(error.what)
                continue
            with stage:
                for episode in episodes:
                    outcome = stage.outcome(order.run_seed, episode)
                    self._take((order.arm, order.run_seed, episode), outcome)
                    done += 1
                    self._say(episode=done, episodes=total)

    def _play_apart(self, wanted: Any, total: int) -> None:
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
            self._shares(given),
            take,
            on_report=hear,
            workers=self.workers,
            silence_s=self.silence_s,
            where=", ".join(dict.fromkeys(order.arm for order, _ in wanted))[:300],
            mend="what was played is kept; run the same command again to go on",
        )

    def _shares(self, given: Any) -> Iterator[dict[str, Any]]:
        """A few episodes of an arm each, so that workers end at about the same time."""
        contract = self.contract.to_json()
        workers = self.workers if isinstance(self.workers, int) else self.workers.workers
        for order, setup, episodes in given:
            most = min(max(-(-len(episodes) // (2 * workers)), 1), EPISODES_EACH)
            for at in range(0, len(episodes), most):
                if order.arm in self.broken:
                    break
                yield {
                    "order": {"arm": order.arm, "setup": setup, "run_seed": order.run_seed,
                              "episodes": episodes[at : at + most]},
                    "contract": contract,
                }  # fmt: skip

    def _take(self, key: Key, outcome: Outcome) -> bool:
        """Keeps an outcome; False where it is known, as of a task that was tried again."""
        with self._lock:
            if key in self.outcomes:
                return False
            self.outcomes[key] = outcome
            self.spent += 1
            if self.notes is not None:
                line = json.dumps({"key": list(key), "outcome": outcome.to_json()})
                with self.notes.open("a", encoding="utf-8") as file:
                    file.write(line + "\n")
            return True

    def _say(self, **fields: Any) -> None:
        if self.on_message is not None:
            self.on_message(fields)


def arms_task(
    report: Callable[..., None], *, order: Mapping[str, Any], contract: Any
) -> list[dict[str, Any]]:
    """Plays an order in this process; reports each outcome, and returns them all."""
    setup = order["setup"]

    def make() -> Stage:
        try:
            return Stage(Setup.from_json(setup), Contract.from_json(contract))
        except SpecError as error:
            raise _Unopened(error.what) from error

    found: list[dict[str, Any]] = []
    try:
        with kept_open(json.dumps([setup, contract], sort_keys=True), make) as stage:
            for episode in order["episodes"]:
                outcome = stage.outcome(order["run_seed"], episode, on_step=report)
                found.append({
                    "arm": order["arm"], "run_seed": order["run_seed"], "episode": episode,
                    "outcome": outcome.to_json(),
                })  # fmt: skip
                report(**found[-1])
    except _Unopened as error:
        return [{"arm": order["arm"], "broken": str(error)}]
    return found


class _Unopened(Exception):  # noqa: N818  # no error of the run: the arm is told as broken
    """An arm's set-up can't be opened."""


def _noted(path: Path, head: Mapping[str, Any]) -> Iterator[tuple[Key, Outcome]]:
    """What an earlier call has noted; a last line that was torn is dropped from the file.

    Raises:
        BundleError: the file is another experiment's.
    """
    lines = path.read_bytes().split(b"\n") if path.exists() else []
    if not lines:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(dict(head), sort_keys=True) + "\n", encoding="utf-8")
        return
    if lines[0].decode("utf-8", "replace") != json.dumps(dict(head), sort_keys=True):
        raise BundleError(
            "outcomes of another experiment lie here",
            where=str(path),
            expected="the same run, seed and set-up",
            seen=lines[0].decode("utf-8", "replace")[:200],
            mend="name another folder with --out, or take this one away",
        )
    whole = lines[:-1]
    for number, line in enumerate(whole[1:], start=2):
        try:
            data = json.loads(line)
            arm, run_seed, episode = data["key"]
            yield (arm, run_seed, episode), Outcome.from_json(data["outcome"])
        except (ValueError, KeyError, TypeError) as error:
            raise BundleError(
                "a noted outcome is damaged", where=f"{path}, line {number}", seen=str(error)[:200],
                mend="take the file away: the experiment is played anew",
            ) from error  # fmt: skip
    if lines[-1]:
        path.write_bytes(b"\n".join(whole) + b"\n")
