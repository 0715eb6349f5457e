"""Plays what an attribution needs, here or in worker processes, episode by episode."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, Final

import numpy as np

from gamekeeper.diagnose.attribution.bench import Bench, Task, paper_from_json, paper_to_json
from gamekeeper.diagnose.attribution.coalitions import wanted
from gamekeeper.diagnose.attribution.film import Paper
from gamekeeper.diagnose.attribution.messages import listened, said
from gamekeeper.diagnose.attribution.scan import scan
from gamekeeper.diagnose.shares import kept_open, play_shares
from gamekeeper.run.executors.task import Executor

TASK: Final = "gamekeeper.diagnose.attribution.gather:share_task"
SILENCE_S: Final = 60.0


@dataclass(slots=True)
class Gathered:
    """What was played, by episode.

    Attributes:
        closed: team return of each coalition played in a fresh episode.
        scans: what single actions did, as `scan` has it; recorded episodes first.
        said: what was said, and what was known and done around it.
        listened: looks at whether a message changed what was done.
    """

    closed: dict[int, dict[int, float]] = field(default_factory=dict)
    scans: list[dict[str, Any]] = field(default_factory=list)
    said: list[dict[str, Any]] = field(default_factory=list)
    listened: list[dict[str, Any]] = field(default_factory=list)

    def take(self, kind: str, value: Any) -> None:
        """Keeps a report."""
        if kind == "closed":
            number, values = value
            self.closed[int(number)] = {int(mask): returned for mask, returned in values}
        else:
            getattr(self, kind).append(value)

    def in_order(self) -> Gathered:
        """The same whoever played it."""
        for name in ("scans", "said", "listened"):
            getattr(self, name).sort(key=lambda each: (each["run"] == "fresh", each["number"]))
        self.closed = dict(sorted(self.closed.items()))
        return self


def gather(
    task: Task,
    papers: Sequence[Paper],
    *,
    closed: int,
    fresh: int,
    workers: int | Executor = 0,
    silence_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> Gathered:
    """Plays fresh episodes with every coalition, and looks into papers action by action.

    Args:
        papers: episodes of the run.
        closed: fresh episodes in which coalitions play.
        fresh: of these, those that are looked into action by action as well.
        workers: processes that play; 0: this one does; or an executor that plays.
        on_message: called with `{"episode", "episodes"}`.
    Raises:
        EnvError: the environment raised, or a worker process hung or died.
    """
    found, lock = Gathered(), Lock()
    total = closed + len(papers) + fresh

    def take(fields: Mapping[str, Any]) -> None:
        if "kind" not in fields:
            return
        with lock:
            found.take(fields["kind"], fields["value"])
            done = len(found.closed) + len(found.scans)
        if on_message is not None:
            on_message({"episode": done, "episodes": total})

    if workers == 0:
        with Bench(task) as bench:
            play_share(bench, papers, range(closed), range(fresh), take)
    else:
        _apart(task, papers, closed, fresh, workers, silence_s, take)
    return found.in_order()


def play_share(
    bench: Bench,
    papers: Sequence[Paper],
    closed: Sequence[int],
    fresh: Sequence[int],
    take: Callable[[Mapping[str, Any]], None],
) -> None:
    """Plays a part of what is wanted; what comes of it depends on nothing but the episode."""
    task = bench.task
    for number in closed:
        take({"kind": "closed", "value": [number, _coalitions(bench, number)]})
    for paper in [*papers, *(bench.fresh(number) for number in fresh)]:
        take({"kind": "scans", "value": scan(bench, paper, seed=task.seed)})
        at = {"run": paper.run, "number": paper.number}
        for value in said(bench, paper):
            take({"kind": "said", "value": {**at, **value}})
        if paper.run == "fresh":
            for value in listened(bench, paper, seed=task.seed):
                take({"kind": "listened", "value": {**at, **value}})


def _coalitions(bench: Bench, number: int) -> list[list[float]]:
    players = bench.task.players
    rng = np.random.default_rng([bench.task.seed, number])
    masks, _ = wanted(len(players), rng=rng)
    return [
        [mask, bench.closed(number, members(mask, players)).team_return()] for mask in masks
    ]  # fmt: skip


def members(mask: int, players: Sequence[str]) -> list[str]:
    """The players in a coalition."""
    return [name for place, name in enumerate(players) if mask >> place & 1]


def _apart(
    task: Task,
    papers: Sequence[Paper],
    closed: int,
    fresh: int,
    workers: int | Executor,
    silence_s: float | None,
    take: Callable[[Mapping[str, Any]], None],
) -> None:
    """Workers play an episode at a time, those first that take longest: all coalitions of one."""

    def take_all(answers: Any) -> None:
        for fields in answers:
            take(fields)

    play_shares(
        TASK, _shares(task, papers, closed, fresh), take_all, workers=workers,
        silence_s=silence_s, where="attribution",
        mend="workers=0 plays in this process and shows where",
    )  # fmt: skip


def _shares(
    task: Task, papers: Sequence[Paper], closed: int, fresh: int
) -> Iterator[dict[str, Any]]:
    plain = task.to_json()
    nothing: dict[str, Any] = {"task": plain, "papers": [], "closed": [], "fresh": []}
    for number in range(closed):
        yield {**nothing, "closed": [number]}
    for paper in papers:
        yield {**nothing, "papers": [paper_to_json(paper)]}
    for number in range(fresh):
        yield {**nothing, "fresh": [number]}


def share_task(
    report: Callable[..., None],
    *,
    task: Mapping[str, Any],
    papers: Sequence[Mapping[str, Any]],
    closed: Sequence[int],
    fresh: Sequence[int],
) -> list[Mapping[str, Any]]:
    """Plays a share in this process; returns what came of it, as `play_share` hands it over."""

    def make() -> Bench:
        return Bench(Task.from_json(task), on_step=report)

    found: list[Mapping[str, Any]] = []
    with kept_open(json.dumps(task, sort_keys=True), make) as bench:
        play_share(bench, [paper_from_json(each) for each in papers], closed, fresh, found.append)
    return found
