"""The work of an attribution: episodes scanned and coalitions played, here or by workers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.arms import kept_open, play_shares
from gamekeeper.diagnosis.attribution.agent_measures import wanted
from gamekeeper.diagnosis.attribution.message_influence import listened, said
from gamekeeper.diagnosis.attribution.recorded_actions import (
    ActionTrack,
    EpisodeActions,
    Swap,
    fingerprint,
)
from gamekeeper.diagnosis.attribution.replacement_runs import (
    ReplacementRunner,
    ReplacementTask,
    paper_from_json,
    paper_to_json,
)
from gamekeeper.rollouts.executors.task import Executor

ONE: Final = 2
"""Actions of each agent and episode that are replaced by doing nothing, one at a time."""
LOOKS: Final = 3
"""Actions of each agent and episode that are replaced to see whom they influence."""
LATER: Final = 3
"""Turns after the action within which influence is looked for."""
MOST_AGENTS: Final = 8
"""Agents of an episode whose actions are replaced; of larger teams they are drawn."""
PENALTIES: Final = 4
"""Payments of each agent, term and episode whose cause is looked for; of more they are drawn."""


def scan(bench: ReplacementRunner, paper: EpisodeActions, *, seed: int) -> dict[str, Any]:
    """Everything that is looked at in one episode, as plain data.

    `return`; `noise`: the first turn that differs although nothing was changed, or None; `all`: by
    agent, how much less the team has where the agent does nothing all along; `one`: the same of
    single actions, their mean; `influence`: rows of from, to, on, lag, changed, looks; `penalties`:
    what an agent paid, and whose doing nothing would have spared it that.
    """
    rng = np.random.default_rng([seed, paper.number, paper.run == "fresh"])
    base = bench.from_paper(paper, sees=True)
    noise = first_difference(base, bench.from_paper(paper, sees=True))
    agents = list(base.actions)
    if len(agents) > MOST_AGENTS:
        agents = [agents[k] for k in sorted(rng.permutation(len(agents))[:MOST_AGENTS].tolist())]
    found: dict[str, Any] = {
        "number": paper.number,
        "run": paper.run,
        "seed": paper.seed,
        "return": base.team_return(),
        "noise": noise,
        "left_paper": base.left_paper,
    }
    idle = {agent: bench.from_paper(paper, Swap(agent, None, "noop")) for agent in agents}
    found["all"] = {a: base.team_return() - film.team_return() for a, film in idle.items()}
    found["one"] = {
        agent: float(np.mean(gains))
        for agent in agents
        if (gains := list(_single(bench, paper, base, agent, rng)))
    }
    found["influence"] = _influence(bench, paper, base, agents, noise, rng)
    found["penalties"] = _penalties(bench, paper, base, noise, rng)
    return found


def first_difference(one: ActionTrack, two: ActionTrack) -> int | None:
    """The first turn at which two films of the same thing differ; None: nowhere."""
    for turn in range(max(len(one.rewards), len(two.rewards))):
        if turn >= len(one.rewards) or turn >= len(two.rewards):
            return turn
        if one.rewards[turn] != two.rewards[turn] or one.ended[turn] != two.ended[turn]:
            return turn
    keys = [k for k in one.given.keys() | two.given.keys() if one.given.get(k) != two.given.get(k)]
    return min((turn for turn, _ in keys), default=None)


def _drawn(items: list[Any], most: int, rng: Generator) -> list[Any]:
    if len(items) <= most:
        return items
    return [items[k] for k in sorted(rng.permutation(len(items))[:most].tolist())]


def _single(
    bench: ReplacementRunner, paper: EpisodeActions, base: ActionTrack, agent: str, rng: Generator
) -> Iterator[float]:
    """Loss of the team where one action is replaced by the noop."""
    active = [turn for turn, name, is_noop in base.moves if name == agent and not is_noop]
    for turn in _drawn(active, ONE, rng):
        yield base.team_return() - bench.from_paper(paper, Swap(agent, turn, "noop")).team_return()


def _influence(
    bench: ReplacementRunner,
    paper: EpisodeActions,
    base: ActionTrack,
    agents: list[str],
    noise: int | None,
    rng: Generator,
) -> list[list[Any]]:
    """Rows of from, to, on, lag, changed, looks."""
    looks: Counter[tuple[str, str, str, int]] = Counter()
    hits: Counter[tuple[str, str, str, int]] = Counter()
    for agent in agents:
        turns = [turn for turn, name, _ in base.moves if name == agent]
        for turn in _drawn(turns, LOOKS, rng):
            film = bench.from_paper(
                paper, Swap(agent, turn, "other"), turns=turn + LATER + 2, rng=rng, sees=True
            )
            done = film.actions[agent]
            if fingerprint(done) == fingerprint(base.actions[agent][: len(done)]):
                continue  # there was no other action
            for key, is_changed in changes(base, film, agent, turn, noise):
                looks[key] += 1
                hits[key] += is_changed
    return [[*key, hits[key], looks[key]] for key in sorted(looks)]


def changes(
    base: ActionTrack, film: ActionTrack, agent: str, start: int, noise: int | None
) -> Iterator[tuple[tuple[str, str, str, int], bool]]:
    """Each look at whether an action changed something: whose, for whom, on what, how much later.

    Lag 0 is the step of that action; what an agent is shown next, it decides with a turn later.
    """
    end = start + LATER if noise is None else min(start + LATER, noise - 1)
    for turn in range(start, end + 1):
        if turn >= len(base.rewards):
            return
        was, now = base.rewards[turn], film.rewards[turn] if turn < len(film.rewards) else {}
        for name in was:
            is_changed = was[name] != now.get(name, 0.0)
            yield (agent, name, "reward", turn - start), is_changed
            over = film.ended[min(turn, len(film.ended) - 1)]
            is_changed = (name in base.ended[turn]) != (name in over)
            yield (agent, name, "ending", turn - start), is_changed
    for turn in range(start + 1, end + 2):
        for name in base.actions:
            if (turn, name) in base.given and (turn, name) in film.given:
                is_changed = base.given[turn, name] != film.given[turn, name]
                yield (agent, name, "observation", turn - start), is_changed


# -- who pays for what


def _penalties(
    bench: ReplacementRunner,
    paper: EpisodeActions,
    base: ActionTrack,
    noise: int | None,
    rng: Generator,
) -> list[dict[str, Any]]:
    """Penalties that a term's earner should have got, and the agent that caused them."""
    if paper.run != "recorded":
        return []
    costs = payments(base, bench.contract)
    paid: dict[tuple[str, str], list[int]] = {}
    for turn, terms in enumerate(costs):
        for agent, own in terms.items():
            for term in own:
                if noise is None or turn < noise:
                    paid.setdefault((term, agent), []).append(turn)
    return [
        {
            "term": term,
            "agent": agent,
            "turn": turn,
            "seed": paper.seed,
            "paid": costs[turn][agent][term],
            "of": len(turns),
            "causers": _causers(bench, paper, base, (term, agent, turn), costs[turn][agent][term]),
        }
        for (term, agent), turns in paid.items()
        for turn in _drawn(turns, PENALTIES, rng)
    ]


def payments(film: ActionTrack, contract: Contract) -> list[dict[str, dict[str, float]]]:
    """By turn and agent, the negative payments of terms whose payee is their earner."""
    own = {name for name, term in contract.rewards.items() if term.payee == ("earner",)}
    told: list[Mapping[str, Mapping[str, float]]]
    if len(film.terms) == len(film.rewards):
        told = list(film.terms)
    elif len(contract.rewards) == 1:  # the reward is that term
        name = next(iter(contract.rewards))
        told = [{a: {name: value} for a, value in paid.items()} for paid in film.rewards]
    else:
        return [{} for _ in film.rewards]
    return [
        {
            agent: kept
            for agent, terms in paid.items()
            if (kept := {name: x for name, x in terms.items() if name in own and x < 0})
        }
        for paid in told
    ]


def _causers(
    bench: ReplacementRunner,
    paper: EpisodeActions,
    base: ActionTrack,
    what: tuple[str, str, int],
    cost: float,
) -> list[str]:
    """Those whose doing nothing alone would have spared the payer.

    Where it is the payer itself, nobody else is tried.

    Args:
        what: the term, who paid, at which turn.
        cost: how much, below 0.
    """
    term, payer, turn = what
    last: dict[str, tuple[int, bool]] = {}
    for at, name, is_noop in base.moves:
        if at <= turn:
            last[name] = at, is_noop
    first = min((at for at, _ in last.values()), default=0)
    first = max(first, turn - len(last) + 1)  # in turns: since each of them decided last

    def spares(name: str) -> bool:
        at, is_noop = last[name]
        if is_noop or at < first:
            return False
        film = bench.from_paper(paper, Swap(name, at, "noop"), turns=turn + 1)
        if len(film.rewards) <= turn:
            return True
        now = payments(film, bench.contract)[turn].get(payer, {}).get(term, 0.0)
        return now > cost + 1e-12

    if payer in last and spares(payer):
        return [payer]
    return [name for name in last if name != payer and spares(name)]


TASK: Final = "gamekeeper.diagnosis.attribution.attribution_work:share_task"
SILENCE_S: Final = 60.0


@dataclass(slots=True)
class ContributionData:
    """Outcomes of the reruns, by episode.

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

    def in_order(self) -> ContributionData:
        """The same whoever played it."""
        for name in ("scans", "said", "listened"):
            getattr(self, name).sort(key=lambda each: (each["run"] == "fresh", each["number"]))
        self.closed = dict(sorted(self.closed.items()))
        return self


def gather(
    task: ReplacementTask,
    papers: Sequence[EpisodeActions],
    *,
    closed: int,
    fresh: int,
    workers: int | Executor = 0,
    silence_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
) -> ContributionData:
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
    found, lock = ContributionData(), Lock()
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
        with ReplacementRunner(task) as bench:
            play_share(bench, papers, range(closed), range(fresh), take)
    else:
        _apart(task, papers, closed, fresh, workers, silence_s, take)
    return found.in_order()


def play_share(
    bench: ReplacementRunner,
    papers: Sequence[EpisodeActions],
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


def _coalitions(bench: ReplacementRunner, number: int) -> list[list[float]]:
    players = bench.task.players
    rng = np.random.default_rng([bench.task.seed, number])
    masks, _ = wanted(len(players), rng=rng)
    return [[mask, bench.closed(number, members(mask, players)).team_return()] for mask in masks]


def members(mask: int, players: Sequence[str]) -> list[str]:
    """The players in a coalition."""
    return [name for place, name in enumerate(players) if mask >> place & 1]


def _apart(
    task: ReplacementTask,
    papers: Sequence[EpisodeActions],
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
        TASK,
        _shares(task, papers, closed, fresh),
        take_all,
        workers=workers,
        silence_s=silence_s,
        where="attribution",
        fix="workers=0 plays in this process and shows where",
    )


def _shares(
    task: ReplacementTask, papers: Sequence[EpisodeActions], closed: int, fresh: int
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

    def make() -> ReplacementRunner:
        return ReplacementRunner(ReplacementTask.from_json(task), on_step=report)

    found: list[Mapping[str, Any]] = []
    with kept_open(json.dumps(task, sort_keys=True), make) as bench:
        play_share(bench, [paper_from_json(each) for each in papers], closed, fresh, found.append)
    return found
