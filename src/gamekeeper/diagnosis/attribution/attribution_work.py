"""The work of an attribution: episodes scanned and coalitions played, here or by workers."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from threading import Lock
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.random import Generator

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.arms import damaged, kept_open, note, noted, play_shares
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
    script_from_json,
    script_to_json,
)
from gamekeeper.rollouts.executors.task import Executor
from gamekeeper.rollouts.interrupts import noted_if_interrupted

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


def scan(runner: ReplacementRunner, script: EpisodeActions, *, seed: int) -> dict[str, Any]:
    """Everything that is looked at in one episode, as plain data.

    `return`; `noise`: the first turn that differs although nothing was changed, or None; `all`: by
    agent, how much less the team has where the agent does nothing all along; `one`: the same of
    single actions, their mean; `influence`: rows of from, to, on, lag, changed, looks; `penalties`:
    what an agent paid, and whose doing nothing would have spared it that; `terms`: rewards by agent
    and term; `untold`: where terms are neither told nor in infos, those that are in no info, else
    None.
    """
    rng = np.random.default_rng([seed, script.number, script.run == "fresh"])
    base = runner.from_script(script, sees=True)
    noise = first_difference(base, runner.from_script(script, sees=True))
    agents = _drawn(list(base.actions), MOST_AGENTS, rng)
    told, whole = base.info_terms, base.team_return()
    idle = {agent: runner.from_script(script, Swap(agent, None, "noop")) for agent in agents}
    return {  # drawn from top to bottom
        "number": script.number,
        "run": script.run,
        "return": whole,
        "noise": noise,
        "all": {agent: whole - track.team_return() for agent, track in idle.items()},
        "one": {
            agent: float(np.mean(gains))
            for agent in agents
            if (gains := list(_single(runner, script, base, agent, rng)))
        },
        "influence": _influence(runner, script, base, agents, noise, rng),
        "penalties": _penalties(runner, script, base, noise, rng),
        "terms": {agent: _sums(base, agent) for agent in base.actions} if base.has_terms else {},
        "untold": None if told is None or told.hold else sorted(told.declared - told.found),
    }


def _sums(track: ActionTrack, agent: str) -> dict[str, float]:
    """Rewards of an agent by term."""
    sums: Counter[str] = Counter()
    for paid in track.terms:
        sums.update(paid.get(agent, {}))
    return dict(sums)


def first_difference(one: ActionTrack, two: ActionTrack) -> int | None:
    """The first turn at which two tracks of the same thing differ; None: nowhere."""
    steps = (zip(each.rewards, each.ended, strict=True) for each in (one, two))
    for turn, (was, now) in enumerate(zip_longest(*steps)):
        if was != now:
            return turn
    keys = [k for k in one.given.keys() | two.given.keys() if one.given.get(k) != two.given.get(k)]
    return min((turn for turn, _ in keys), default=None)


def _drawn(items: list[Any], most: int, rng: Generator) -> list[Any]:
    if len(items) <= most:
        return items
    return [items[k] for k in sorted(rng.permutation(len(items))[:most].tolist())]


def _single(
    runner: ReplacementRunner, script: EpisodeActions, base: ActionTrack, agent: str, rng: Generator
) -> Iterator[float]:
    """Loss of the team where one action is replaced by the noop."""
    active = [turn for turn, name, is_noop in base.moves if name == agent and not is_noop]
    for turn in _drawn(active, ONE, rng):
        track = runner.from_script(script, Swap(agent, turn, "noop"))
        yield base.team_return() - track.team_return()


def _influence(
    runner: ReplacementRunner,
    script: EpisodeActions,
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
            track = runner.from_script(
                script, Swap(agent, turn, "other"), turns=turn + LATER + 2, rng=rng, sees=True
            )
            done = track.actions[agent]
            if fingerprint(done) == fingerprint(base.actions[agent][: len(done)]):
                continue  # there was no other action
            for key, is_changed in changes(base, track, agent, turn, noise):
                looks[key] += 1
                hits[key] += is_changed
    return [[*key, hits[key], looks[key]] for key in sorted(looks)]


def changes(
    base: ActionTrack, track: ActionTrack, agent: str, start: int, noise: int | None
) -> Iterator[tuple[tuple[str, str, str, int], bool]]:
    """Each look at whether an action changed something: whose, for whom, on what, how much later.

    Lag 0 is the step of that action; what an agent is shown next, it decides with a turn later.
    """
    end = start + LATER if noise is None else min(start + LATER, noise - 1)
    for turn in range(start, end + 1):
        if turn >= len(base.rewards):
            return
        was, now = base.rewards[turn], track.rewards[turn] if turn < len(track.rewards) else {}
        for name in was:
            is_changed = was[name] != now.get(name, 0.0)
            yield (agent, name, "reward", turn - start), is_changed
            over = track.ended[min(turn, len(track.ended) - 1)]
            is_changed = (name in base.ended[turn]) != (name in over)
            yield (agent, name, "ending", turn - start), is_changed
    for turn in range(start + 1, end + 2):
        for name in base.actions:
            if (turn, name) in base.given and (turn, name) in track.given:
                is_changed = base.given[turn, name] != track.given[turn, name]
                yield (agent, name, "observation", turn - start), is_changed


# -- who pays for what


def _penalties(
    runner: ReplacementRunner,
    script: EpisodeActions,
    base: ActionTrack,
    noise: int | None,
    rng: Generator,
) -> list[dict[str, Any]]:
    """Penalties that a term's earner should have got, and the agent that caused them."""
    if script.run != "recorded":
        return []
    costs = payments(base, runner.contract, has_terms=base.has_terms)
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
            "seed": script.seed,
            "paid": (cost := costs[turn][agent][term]),
            "causers": _causers(runner, script, base, (term, agent, turn), cost),
        }
        for (term, agent), turns in paid.items()
        for turn in _drawn(turns, PENALTIES, rng)
    ]


def payments(
    track: ActionTrack, contract: Contract, *, has_terms: bool
) -> list[dict[str, dict[str, float]]]:
    """By turn and agent, the negative payments of terms whose payee is their earner.

    Args:
        has_terms: the unchanged track tells terms; in a short one of few of them nobody could say.
    """
    own = {name for name, term in contract.rewards.items() if term.payee == ("earner",)}
    told: list[Mapping[str, Mapping[str, float]]]
    if has_terms:
        told = list(track.terms)
    elif len(contract.rewards) == 1:  # the reward is that term
        name = next(iter(contract.rewards))
        told = [{a: {name: value} for a, value in paid.items()} for paid in track.rewards]
    else:
        return [{} for _ in track.rewards]
    return [
        {
            agent: kept
            for agent, terms in paid.items()
            if (kept := {name: x for name, x in terms.items() if name in own and x < 0})
        }
        for paid in told
    ]


def _causers(
    runner: ReplacementRunner,
    script: EpisodeActions,
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
        track = runner.from_script(script, Swap(name, at, "noop"), turns=turn + 1)
        if len(track.rewards) <= turn:
            return True
        paid = payments(track, runner.contract, has_terms=base.has_terms)[turn]
        now = paid.get(payer, {}).get(term, 0.0)
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
        reused: units that an earlier call had played.
        steps: env steps of each unit, by kind and number.
        not_played: what the budget didn't reach, in words.
    """

    closed: dict[int, dict[int, float]] = field(default_factory=dict)
    scans: list[dict[str, Any]] = field(default_factory=list)
    said: list[dict[str, Any]] = field(default_factory=list)
    listened: list[dict[str, Any]] = field(default_factory=list)
    reused: int = 0
    steps: dict[tuple[str, int], int] = field(default_factory=dict)
    not_played: list[str] = field(default_factory=list)

    def take(self, unit: Mapping[str, Any]) -> None:
        """Keeps what came of one unit of work, as `played_unit` has it."""
        self.steps[unit["kind"], unit["number"]] = unit["steps"]
        if unit["kind"] == "closed":
            values = unit["value"]
            self.closed[int(unit["number"])] = {int(mask): returned for mask, returned in values}
            return
        for name, values in unit["value"].items():
            getattr(self, name).extend(values)

    def in_order(self) -> ContributionData:
        """The same whoever played it."""
        for name in ("scans", "said", "listened"):
            getattr(self, name).sort(key=lambda each: (each["run"] == "fresh", each["number"]))
        self.closed = dict(sorted(self.closed.items()))
        return self


def gather(
    task: ReplacementTask,
    scripts: Sequence[EpisodeActions],
    *,
    closed: int,
    fresh: int,
    workers: int | Executor = 0,
    silence_s: float | None = SILENCE_S,
    on_message: Callable[[dict[str, Any]], None] | None = None,
    budget: int | None = None,
    notes: Path | None = None,
    head: Mapping[str, Any] | None = None,
) -> ContributionData:
    """Plays fresh episodes with every coalition, and looks into scripts action by action.

    Args:
        scripts: episodes of the run.
        closed: fresh episodes in which coalitions play.
        fresh: of these, those that are looked into action by action as well.
        workers: processes that play; 0: this one does; or an executor that plays.
        on_message: called with `{"episode", "episodes"}`.
        budget: env steps; an episode that began is finished.
        notes: the file in which what was played is kept, and from which a second call goes on.
        head: what that file has to begin with.
    Raises:
        EnvError: the environment raised, or a worker process hung or died.
        RunError: the file is another attribution's, or damaged.
        KeyboardInterrupt: by Ctrl-C; its notes say what was kept.
    """
    units = _in_turn(scripts, closed, fresh)
    wanted = {unit[:2] for unit in units}
    found, lock = ContributionData(), Lock()
    if notes is not None:
        _take_noted(found, notes, head or {}, wanted)
    known = set(found.steps)

    def take(unit: Mapping[str, Any]) -> None:
        with lock:
            found.take(unit)
            if notes is not None:
                note(notes, unit)
            done = len(found.closed) + len(found.scans)
        if on_message is not None:
            on_message({"episode": done, "episodes": len(wanted)})

    with noted_if_interrupted(lambda: _kept(found, len(wanted), notes)):
        for share in _rounds(units, found, budget):
            left = [unit for unit in share if unit[:2] not in known]
            if left and workers == 0:
                with ReplacementRunner(task) as runner:
                    for unit in left:
                        take(played_unit(runner, *unit))
            elif left:
                _apart(task, left, workers, silence_s, take)
    return found.in_order()


KINDS: Final = ("closed", "recorded", "fresh")
WorkUnit: TypeAlias = tuple[str, int, Any]
"""Kind and number of an episode, and the recorded actions of one that is played again."""


def _in_turn(scripts: Sequence[EpisodeActions], closed: int, fresh: int) -> list[WorkUnit]:
    """Units of work: those of each kind in order, the kinds in proportion to their numbers."""
    kinds: list[list[WorkUnit]] = [
        [("closed", number, None) for number in range(closed)],
        [
            *(("recorded", script.number, script) for script in scripts),
            *(("fresh", number, None) for number in range(fresh)),
        ],
    ]
    placed = [((k + 0.5) / len(units), unit) for units in kinds for k, unit in enumerate(units)]
    return [unit for _, unit in sorted(placed, key=lambda each: each[0])]


def _rounds(
    units: Sequence[WorkUnit], found: ContributionData, budget: int | None
) -> Iterator[Sequence[WorkUnit]]:
    """Yields units to be played next: all at once, or with a budget half of what it allows.

    It depends on the steps of whole rounds alone, so that the answer is the same whoever plays.
    """
    if budget is None:
        yield units
        return
    done = 0
    while done < len(units):
        spent = [found.steps[kind, number] for kind, number, _ in units[:done]]
        room = (budget - sum(spent)) // max([1, *spent]) if done else 2
        if room < 1:
            break
        count = max(room // 2, 1)
        yield units[done : done + count]
        done += count
    left = units[done:]
    whole = [unit for unit in left if unit[0] == "closed"]
    for count, what in (
        (len(whole), "new episodes with agents replaced"),
        (len(left) - len(whole), "episodes with actions replaced"),
    ):
        if count:
            found.not_played.append(f"{count} {what}")


def _take_noted(
    found: ContributionData, notes: Path, head: Mapping[str, Any], wanted: set[tuple[str, int]]
) -> None:
    """Takes what an earlier call had played of what is wanted."""
    for number, unit in noted(notes, head):
        try:
            if (unit["kind"], unit["number"]) in wanted:
                found.take(unit)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise damaged(notes, number, error) from error
    found.reused = len(found.steps)


def _kept(found: ContributionData, count: int, notes: Path | None) -> list[str]:
    """Lines of what becomes of an attribution that was interrupted."""
    done = f"{len(found.closed) + len(found.scans)} of {count} episodes were played"
    if notes is None:
        return [f"{done}; nothing was kept; with an output folder the next call would go on"]
    return [f"{done}; they stay in {notes.parent}; the same command goes on from there"]


def played_unit(
    runner: ReplacementRunner, kind: str, number: int, script: EpisodeActions | None
) -> dict[str, Any]:
    """Plays a unit of work; what comes of it depends on nothing but the episode."""
    before = runner.steps
    value: Any
    if kind == "closed":
        players = runner.task.players
        masks, _ = wanted(len(players), rng=np.random.default_rng([runner.task.seed, number]))
        value = [
            [mask, runner.closed(number, members(mask, players)).team_return()] for mask in masks
        ]
    else:
        value = _looked_into(runner, script or runner.fresh(number))
    return {"kind": kind, "number": number, "value": value, "steps": runner.steps - before}


def _looked_into(runner: ReplacementRunner, script: EpisodeActions) -> dict[str, list[Any]]:
    """Effects of single actions in an episode, and the messages that were said and heard in it."""
    at, seed = {"run": script.run, "number": script.number}, runner.task.seed
    heard = listened(runner, script, seed=seed) if script.run == "fresh" else ()
    return {
        "scans": [scan(runner, script, seed=seed)],
        "said": [{**at, **each} for each in said(runner, script)],
        "listened": [{**at, **each} for each in heard],
    }


def members(mask: int, players: Sequence[str]) -> list[str]:
    """The players in a coalition."""
    return [name for place, name in enumerate(players) if mask >> place & 1]


def _apart(
    task: ReplacementTask,
    units: Sequence[WorkUnit],
    workers: int | Executor,
    silence_s: float | None,
    take: Callable[[Mapping[str, Any]], None],
) -> None:
    """Workers play an episode at a time, those first that take longest: all coalitions of one."""
    plain = task.to_json()
    shares = (
        {"task": plain, "kind": kind, "number": n, "script": script and script_to_json(script)}
        for kind, n, script in sorted(units, key=lambda unit: KINDS.index(unit[0]))
    )
    play_shares(
        TASK,
        shares,
        take,
        workers=workers,
        silence_s=silence_s,
        where="attribution",
        fix="workers=0 plays in this process and shows where",
    )


def share_task(
    report: Callable[..., None],
    *,
    task: Mapping[str, Any],
    kind: str,
    number: int,
    script: str | None,
) -> dict[str, Any]:
    """Plays a unit of work in this process; returns what came of it."""

    def make() -> ReplacementRunner:
        return ReplacementRunner(ReplacementTask.from_json(task), on_step=report)

    actions = None if script is None else script_from_json(script)
    with kept_open(json.dumps(task, sort_keys=True), make) as runner:
        return played_unit(runner, kind, number, actions)
