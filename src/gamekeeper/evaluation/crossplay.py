"""Cross-play: cells by policies and positions, gaps to best responses, the first mover's lead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from gamekeeper.episodes.outcome import EACH, TEAM
from gamekeeper.evaluation.episode_rows import RETURN, ROLE, Sheet
from gamekeeper.evaluation.estimates import Compared, Judge
from gamekeeper.evaluation.matchups import ZERO_SHOT, Checkpoint, Pairing
from gamekeeper.evaluation.results import Ground
from gamekeeper.evaluation.spec import EVERYONE, Spec
from gamekeeper.statistics.interval import FloatArray
from gamekeeper.statistics.significance import holm
from gamekeeper.statistics.training_runs import MeetingLuck, luck_of_meetings

ByPosition: TypeAlias = "tuple[tuple[str, str], ...]"
"""Policies by position."""
CHOSEN: Final = "chosen on the first half of the episodes; values and leads are those of the other"


@dataclass(frozen=True, slots=True)
class CrossplayTable:
    """Every line-up of an environment with its figures.

    Attributes:
        positions: roles, agents, or `*` for the others.
        pairings: line-ups, each with its figures.
    """

    spec: Spec
    ground: Ground
    positions: tuple[str, ...]
    pairings: Sequence[tuple[Pairing, Sheet]]
    judge: Judge

    def positioned(self, pairing: Pairing) -> dict[str, Checkpoint]:
        """The sides by position, also of a policy that plays by itself."""
        given = dict(pairing.sides)
        return {
            position: given.get(position, given.get(EVERYONE, Checkpoint("")))
            for position in self.positions
        }

    def value(self, sheet: Sheet, position: str) -> FloatArray:
        """[episodes] the return that counts in a position: the team's, else the position's own."""
        if self.ground.has_team:
            return sheet.values(RETURN, TEAM, TEAM)
        return self.of_position(sheet, position)

    def of_position(self, sheet: Sheet, position: str) -> FloatArray:
        """[episodes] the mean return of the agents in a position."""
        if position in sheet.agents:
            return sheet.values(RETURN, EACH, position)
        if position != EVERYONE:
            return sheet.values(RETURN, ROLE, position)
        rest = [
            place
            for place, (agent, role) in enumerate(zip(sheet.agents, sheet.roles, strict=True))
            if not {agent, role} & set(self.positions)
        ]
        returns = sheet.column(RETURN)[:, rest]
        return np.asarray(np.nanmean(returns, axis=1)) if rest else np.full(len(returns), np.nan)

    def cells(self) -> dict[tuple[ByPosition, str], list[tuple[Pairing, Sheet]]]:
        """The line-ups by the policies in their positions and by their kind."""
        found: dict[tuple[ByPosition, str], list[tuple[Pairing, Sheet]]] = {}
        for pairing, sheet in self.pairings:
            positioned = tuple(
                (position, side.policy) for position, side in self.positioned(pairing).items()
            )
            found.setdefault((positioned, pairing.kind), []).append((pairing, sheet))
        return found


def crossplay_of(table: CrossplayTable) -> dict[str, Any]:
    """The cross-play of an environment, as the document has it."""
    ego = TEAM if table.ground.has_team else table.positions[0]
    best, fair = _best_responses(table), _fairness(table)
    found = [
        *(gap for row in best for gap in row["gap"].values()),
        *(r["difference"] for r in fair),
    ]
    tested = [each for each in found if each is not None and each.get("p") is not None]
    for each, p in zip(tested, holm([each["p"] for each in tested]), strict=True):
        each |= {"p": p, "p_alone": each["p"], "tests": len(tested)}
    return {
        "roles": list(table.positions),
        "policies": list(table.spec.policies),
        "metric": RETURN,
        "who": ego,
        "cells": [
            _cell(table, dict(positioned), kind, members)
            for (positioned, kind), members in table.cells().items()
        ],
        "best_response": best,
        "fairness": fair,
    }


def _cell(
    table: CrossplayTable,
    positioned: Mapping[str, str],
    kind: str,
    members: Sequence[tuple[Pairing, Sheet]],
) -> dict[str, Any]:
    position = table.positions[0]
    values = [table.value(sheet, position) for _, sheet in members]
    name = ["crossplay", table.ground.name, *positioned.values(), kind]
    of = f"{' with '.join(dict.fromkeys(positioned.values()))} in {table.ground.name}"
    methods = [p for p in dict.fromkeys(positioned.values()) if table.spec.policies[p].is_method]
    broken = _lost(values)
    if not methods:
        found = table.judge.episodes(values[0], "mean", of=of, name=name, lost=broken)
        n = int((~np.isnan(values[0])).sum())
    elif len(methods) == 1 and kind != ZERO_SHOT:
        by_run = list(_by_run(table, methods[0], members, values).values())
        found = table.judge.runs(by_run, "mean", of=of, name=name, lost=broken)
        n = len(by_run)
    else:
        runs = [_by_run(table, method, members, values) for method in methods]
        blocks = [np.stack(list(one.values())) for one in runs]
        n = min(map(len, blocks))
        times = _times(n, table.spec.crossplay.sample, kind)
        runs_met = [
            [side.run for side in table.positioned(pairing).values()] for pairing, _ in members
        ]
        luck = _luck([(met[0], met[-1]) for met in runs_met], values)
        found = table.judge.meetings(blocks, times=times, luck=luck, of=of, lost=broken)
    mean = found or {"value": None, "low": None, "high": None}
    return {
        "roles": dict(positioned),
        "kind": kind,
        "n": n,
        "unit": "run" if methods else "episode",
        "pairings": len(members),
        "episodes": sum(len(sheet.episodes) for _, sheet in members),
        "broken": broken,
        "mean": mean["value"],
        "low": mean["low"],
        "high": mean["high"],
        "by_role": {
            position: _mean([table.of_position(s, position) for _, s in members])
            for position in positioned
        },
    }


def _luck(pairs: Sequence[tuple[int, int]], values: Sequence[FloatArray]) -> MeetingLuck | None:
    """The luck of single meetings, over the seeds that all of them have."""
    figures = np.stack(values)
    figures = figures[:, ~np.isnan(figures).any(axis=0)]
    return luck_of_meetings(pairs, figures.mean(axis=1)) if figures.size else None


def _lost(values: Sequence[FloatArray]) -> int:
    """Number of seeds on which a line-up has no return."""
    return int(np.any([np.isnan(each) for each in values], axis=0).sum())


def _times(runs: int, sample: int | None, kind: str) -> float:
    """By how much a run's mean over its meetings is to be enlarged to be its part of the mean.

    Two of its own method sit in two positions: twice. Where all meet, its partners' mean lacks only
    itself, and so draws its mean towards the others'.
    """
    if kind != ZERO_SHOT:
        return 1.0
    return 2.0 * (runs - 1) / (runs - 2) if sample is None and runs > 2 else 2.0


def _by_run(
    table: CrossplayTable,
    method: str,
    members: Sequence[tuple[Pairing, Sheet]],
    values: Sequence[FloatArray],
) -> dict[int, FloatArray]:
    """[episodes] of each run of a method, the mean over the line-ups that it stands in."""
    found: dict[int, list[FloatArray]] = {}
    for (pairing, _), figures in zip(members, values, strict=True):
        for side in dict.fromkeys(table.positioned(pairing).values()):
            if side.policy == method:
                found.setdefault(side.run, []).append(figures)
    return {run: np.asarray(np.mean(np.stack(each), axis=0)) for run, each in found.items()}


def _best_responses(table: CrossplayTable) -> list[dict[str, Any]]:
    """Against every fixed opponent in all other positions: the best policy, and others' gap."""
    cells, found = table.cells(), []
    fixed = [name for name, each in table.spec.policies.items() if not each.is_method]
    if not fixed:
        table.judge.refuse(
            "best responses",
            "no opponent is fixed: every policy is a method of several runs",
            table.ground.name,
        )
    for position in table.positions:
        for opponent in fixed:
            candidates: dict[str, list[FloatArray]] = {}
            for (positioned, kind), members in cells.items():
                by_position = dict(positioned)
                policy = by_position.pop(position)
                if set(by_position.values()) == {opponent} and kind != ZERO_SHOT:
                    values = [table.value(sheet, position) for _, sheet in members]
                    candidates[policy] = list(_by_run(table, policy, members, values).values())
            if len(candidates) > 1:
                found.append(_best(table, position, opponent, candidates))
    return found


def _mean_over_runs(runs: Sequence[FloatArray], part: slice = slice(None)) -> float:
    """The mean over runs and a part of their episodes; NaN where there is none."""
    figures = np.stack(runs)[:, part]
    return float("nan") if np.isnan(figures).all() else float(np.nanmean(figures))


def _best(
    table: CrossplayTable, position: str, opponent: str, candidates: Mapping[str, list[FloatArray]]
) -> dict[str, Any]:
    """The best response, chosen on the first half of the episodes, and its lead on the other.

    Where it was chosen its lead is luck in part: the highest of five equal policies leads, too.
    """
    half = len(next(iter(candidates.values()))[0]) // 2
    first = {name: _mean_over_runs(runs, slice(half)) for name, runs in candidates.items()}
    best = max(first, key=lambda name: -np.inf if np.isnan(first[name]) else first[name])
    rest = {name: [run[half:] for run in runs] for name, runs in candidates.items()}
    gap: dict[str, Any] = {}
    for name, runs in rest.items():
        if name == best:
            continue
        of = f"{best} and {name} in {table.ground.name}"
        if len(runs) == len(rest[best]) == 1:
            key = ["best response", table.ground.name, position, opponent, best, name]
            found = table.judge.paired(
                rest[best][0], runs[0], of=of, name=key, lost=_lost([rest[best][0], runs[0]])
            )
            gap[name] = found.difference
            continue
        lead = _mean_over_runs(rest[best]) - _mean_over_runs(runs)
        gap[name] = {"value": lead, "low": None, "high": None, "method": None}
        table.judge.refuse(
            "interval of a best response's lead",
            "a method's runs are the same where it was chosen and where its lead is measured",
            of,
        )
    others = {other: opponent for other in table.positions if other != position}
    return {
        "role": position,
        "against": others,
        "policy": best,
        "value": _mean_over_runs(rest[best]),
        "gap": gap,
        "note": CHOSEN,
    }


def _fairness(table: CrossplayTable) -> list[dict[str, Any]]:
    """Both ways of sitting on the same seeds, where two positions play against one another."""
    if table.ground.has_team or len(table.positions) != 2:
        return []
    by_sides = {tuple(table.positioned(p).values()): sheet for p, sheet in table.pairings}
    pairs = dict.fromkeys(tuple(sorted(sides)) for sides in by_sides)
    found: dict[tuple[str, str], list[tuple[Sheet, Sheet]]] = {}
    for a, b in pairs:
        if (a, b) in by_sides and (b, a) in by_sides:
            found.setdefault((a.policy, b.policy), []).append((by_sides[a, b], by_sides[b, a]))
    return [_swapped(table, pair, both) for pair, both in found.items()]


@dataclass(frozen=True, slots=True)
class Duel:
    """Meetings of two policies in both positions on the same seeds.

    Attributes:
        meetings: by the runs of both: [episodes] the mean return of the one, and of the other.
        methods: whether the one is a method, and whether the other is.
    """

    meetings: Mapping[tuple[int, int], tuple[FloatArray, FloatArray]]
    methods: tuple[bool, bool]

    @property
    def reversed(self) -> Duel:
        """The same of the other against the one."""
        turned = {(j, i): (two, one) for (i, j), (one, two) in self.meetings.items()}
        return Duel(turned, (self.methods[1], self.methods[0]))

    def compared(self, judge: Judge, *, of: str, name: Sequence[object]) -> Compared:
        """By how much the one is above the other."""
        pairs = list(self.meetings.values())
        broken = _lost([figures for pair in pairs for figures in pair])
        if not any(self.methods):
            return judge.paired(*pairs[0], of=of, name=name, lost=broken)
        by_run: list[dict[int, list[FloatArray]]] = [{}, {}]
        for runs, (one, two) in self.meetings.items():
            for side, run in zip(by_run, runs, strict=True):
                side.setdefault(run, []).append(one - two)
        blocks = [
            np.stack([np.mean(each, axis=0) for each in side.values()])
            for side, is_method in zip(by_run, self.methods, strict=True)
            if is_method
        ]
        leads = [one - two for one, two in pairs]
        luck = _luck(list(self.meetings), leads) if all(self.methods) else None
        found = judge.meetings(blocks, luck=luck, of=of, lost=broken)
        total = len(pairs[0][0])
        return Compared(found, None, min(map(len, blocks)), total, broken, total - broken)


def both_ways(table: CrossplayTable) -> dict[tuple[str, str], Duel]:
    """The duels of every two policies whose runs met both ways on the same seeds."""
    if table.ground.has_team or len(table.positions) != 2:
        return {}
    first, second = table.positions
    by_sides = {tuple(table.positioned(p).values()): sheet for p, sheet in table.pairings}
    found: dict[tuple[str, str], dict[tuple[int, int], tuple[FloatArray, FloatArray]]] = {}
    for (a, b), there in by_sides.items():
        back = by_sides.get((b, a))
        if back is None or a.policy == b.policy or (b.policy, a.policy) in found:
            continue
        ones = (table.of_position(there, first) + table.of_position(back, second)) / 2
        twos = (table.of_position(there, second) + table.of_position(back, first)) / 2
        found.setdefault((a.policy, b.policy), {})[a.run, b.run] = (ones, twos)
    policies = table.spec.policies
    return {
        (a, b): Duel(met, (policies[a].is_method, policies[b].is_method))
        for (a, b), met in found.items()
    }


def _swapped(
    table: CrossplayTable, pair: tuple[str, str], meetings: Sequence[tuple[Sheet, Sheet]]
) -> dict[str, Any]:
    first, second = table.positions
    leads, ones, twos = [], [], []
    for there, back in meetings:  # a sits first there, second on the way back
        x1, x2 = table.of_position(there, first), table.of_position(there, second)
        y1, y2 = table.of_position(back, first), table.of_position(back, second)
        leads.append((x1 - x2 + y1 - y2) / 2)  # both sit in both positions: skill cancels out
        ones.append((x1 + y2) / 2)  # and of each policy's own mean the position's worth does
        twos.append((x2 + y1) / 2)
    name = ["fairness", table.ground.name, *pair]
    of = f"{' and '.join(dict.fromkeys(pair))} in {table.ground.name}"
    row: dict[str, Any] = {
        "policies": list(pair),
        "roles": [first, second],
        "n": len(leads[0]),
        "meetings": len(meetings),
        "means": {pair[1]: _mean(twos), pair[0]: _mean(ones)},
        "first_mover": None,
        "difference": None,
    }
    if len(meetings) == 1:
        row["first_mover"] = table.judge.episodes(
            leads[0], "mean", of=of, name=name, lost=_lost(leads)
        )
        if pair[0] != pair[1]:
            broken = _lost([ones[0], twos[0]])
            compared = table.judge.paired(ones[0], twos[0], of=of, name=name, lost=broken)
            row["difference"] = compared.difference
        return row
    value = {"value": _mean(leads), "low": None, "high": None, "method": None}
    table.judge.refuse(
        "interval of the first position's lead",
        "runs of methods meet one another: their meetings share runs, so they aren't a sample",
        of,
    )
    return {**row, "first_mover": value}


def _mean(values: Sequence[FloatArray]) -> float | None:
    there = np.concatenate(list(values))
    there = there[~np.isnan(there)]
    return float(there.mean()) if len(there) else None
