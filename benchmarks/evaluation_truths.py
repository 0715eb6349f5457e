"""Evaluation where the truth is known: how often its intervals hold it, and how often it errs.

    python benchmarks/evaluation_truths.py [--quick] [--only PART]

Prints a JSON line for each cell. `held`: the part of simulated experiments whose 95 % interval
holds the truth, in percent; `refused`: the part without an interval; `wrong`: the part in which an
interval was printed that doesn't hold it; `seen`: the part in which a rare event was among the
episodes, `held_where_seen`: of that part; `false`: the part with at least one claim that isn't
true; `found`: the part that claims what is true. The code under test is the package's own, from
arrays of returns on.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
from evaluation_cells import CELLS, interval_of
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.evaluation.comparisons import ALPHA
from gamekeeper.evaluation.episode_rows import Sheet, lost
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.results import constant_sum, differing_resets
from gamekeeper.statistics import resampling
from gamekeeper.statistics.aggregates import over_environments
from gamekeeper.statistics.narrowing import Narrowing
from gamekeeper.statistics.one_sample import one_sample
from gamekeeper.statistics.paired import paired_effect
from gamekeeper.statistics.significance import holm
from gamekeeper.statistics.student import student_p
from gamekeeper.statistics.training_runs import luck_of_meetings, over_meetings

Line = dict[str, Any]
SEEDS = 50
"""Episode seeds that all line-ups share."""


def percent(hits: Any) -> float:
    """The part that is true."""
    return round(100 * float(np.mean(hits)), 1)


def judged(interval: Callable[[Generator], Any], truth: float, repeats: int, seed: int) -> Line:
    """How often an interval holds the truth, over experiments of their own."""
    held, refused = [], 0
    for repeat in range(repeats):
        try:
            found = interval(np.random.default_rng([seed, repeat]))
        except EvidenceError:
            refused += 1
            continue
        held.append(found.low - 1e-9 <= truth <= found.high + 1e-9)
    line = {"held": percent(held) if held else None, "refused": round(100 * refused / repeats, 1)}
    return line | {"wrong": round(100 * (len(held) - sum(held)) / repeats, 1)}


def met(rng: Generator, runs: int, seeds: float, apart: float, noise: float) -> Any:
    """[runs, runs, episodes] the first seat's return where run i meets run j; truth 0."""
    own = apart * rng.normal(size=(2, runs))
    luck = seeds * rng.normal(size=SEEDS)
    rest = noise * rng.normal(size=(runs, runs, SEEDS))
    return own[0][:, None, None] + own[1][None, :, None] + luck + rest


def rivals(rng: Generator, runs: int, seeds: float, apart: float, noise: float) -> Any:
    """The same of a symmetric game: what one wins the other loses, but for the deal."""
    own = apart * rng.normal(size=runs)
    luck = seeds * rng.normal(size=SEEDS)
    rest = noise * rng.normal(size=(runs, runs, SEEDS))
    return own[:, None, None] - own[None, :, None] + luck + rest


def of_its_runs(met_ije: Any) -> Any:
    """[runs, episodes] of each run the mean over all meetings with other runs, in both seats."""
    others = ~np.eye(len(met_ije), dtype=bool)
    rows = [(met_ije[k][others[k]], met_ije[:, k][others[k]]) for k in range(len(met_ije))]
    return np.stack([np.concatenate(each).mean(axis=0) for each in rows])


def two_meet(rng: Generator, runs: int, *spreads: float) -> Any:
    """The interval of two methods' meetings."""
    found = met(rng, runs, *spreads)
    luck = luck_of_meetings(list(np.ndindex(runs, runs)), found.mean(axis=2).ravel())
    return over_meetings([found.mean(axis=1), found.mean(axis=0)], luck=luck)


def zero_shot(game: Callable[..., Any], rng: Generator, runs: int, *spreads: float) -> Any:
    """The interval of the meetings of one method's runs."""
    met = game(rng, runs, *spreads)
    pairs = [(i, j) for i, j in np.ndindex(runs, runs) if i != j]
    luck = luck_of_meetings(pairs, np.array([met[pair].mean() for pair in pairs]))
    return over_meetings([of_its_runs(met)], times=2 * (runs - 1) / (runs - 2), luck=luck)


def meetings(repeats: int) -> Iterator[Line]:
    """Cells of cross-play in which runs of methods meet, about new runs and new seeds."""
    cases = [(10, s, a, n) for s in (0.0, 0.5, 2.0) for a in (0.1, 1.0) for n in (0.3, 3.0)]
    ways: dict[str, Callable[..., Any]] = {
        "two methods meet": two_meet,
        "zero-shot": partial(zero_shot, met),
        "zero-shot, symmetric game": partial(zero_shot, rivals),
    }
    for case in [*cases, (20, 0.5, 0.1, 0.3), (20, 2.0, 1.0, 3.0)]:
        runs, luck, apart, noise = case
        of = f"{runs} runs {apart} apart, seeds {luck}, noise {noise}"
        for claim, way in ways.items():
            line = judged(lambda rng, way=way, case=case: way(rng, *case), 0.0, repeats, 1)
            yield {"claim": claim, "of": of} | line


def overall(repeats: int) -> Iterator[Line]:
    """Aggregates over environments, about new runs and new seeds."""
    for statistic, many, runs in (("mean", 3, 10), ("iqm", 3, 10), ("optimality_gap", 3, 10)):
        for luck in (0.0, 0.5, 2.0):

            def scores(rng: Generator, luck: float = luck, shape: Any = (many, runs)) -> Any:
                own = rng.normal(size=(*shape, 1)) + luck * rng.normal(size=(shape[0], 1, SEEDS))
                found = own + rng.normal(size=(*shape, SEEDS))
                return {f"env{k}": each for k, each in enumerate(found)}

            goal, own = 1.0, float(np.sqrt(1 + 1 / SEEDS))
            big = np.minimum(np.random.default_rng(1).normal(size=2_000_000) * own, goal)
            truth = goal - float(big.mean()) if statistic == "optimality_gap" else 0.0
            line = judged(
                lambda rng, statistic=statistic, scores=scores: over_environments(
                    scores(rng), statistic=statistic, target=1.0, rng=rng
                ),
                truth,
                repeats,
                4,
            )
            yield {"claim": f"{statistic} over {many} environments", "of": f"seeds {luck}"} | line


def lineup(returns_ea: Any, broken: Any = None, resets: Any = None) -> Sheet:
    """The sheet of episodes with these returns by agent."""
    episodes, agents = returns_ea.shape
    gone = np.zeros(episodes, bool) if broken is None else broken
    rows = {
        "episode": np.repeat(np.arange(episodes), agents),
        "agent": [f"p{k}" for k in range(agents)] * episodes,
        "role": ["p"] * (episodes * agents),
        "return": np.where(np.repeat(gone, agents), np.nan, returns_ea.ravel()),
        "terminated": np.repeat(~gone, agents),
        "truncated": np.zeros(episodes * agents, bool),
        "error": [("died" if each else None) for each in np.repeat(gone, agents)],
    }
    if resets is not None:
        rows["reset"] = np.repeat(resets, agents)
    return Sheet.of(pa.table(rows))


def is_claim(found: dict[str, Any] | None, p: float | None = None) -> bool:
    """Whether a difference is claimed: by its corrected p, and by its interval."""
    if found is None or found["low"] is None:
        return False
    return (found["p"] if p is None else p) <= ALPHA and not found["low"] <= 0 <= found["high"]


def claims(found: list[dict[str, Any] | None]) -> list[bool]:
    """Which of a family's differences are claimed."""
    tested = [each for each in found if each is not None and each.get("p") is not None]
    p = iter(holm([each["p"] for each in tested]))
    return [is_claim(each, next(p)) if each in tested else False for each in found]


def constant_sums(repeats: int) -> Iterator[Line]:
    """Win 1, lose 0: recognised as rivals; who is stronger is found from both seats."""
    for strength in (0.0, 0.3, 1.0):
        rivals_seen, found = [], []
        for repeat in range(repeats):
            rng = np.random.default_rng([5, repeat])
            wins = (
                strength + 0.3 + rng.normal(size=100) > 0,
                -strength + 0.3 + rng.normal(size=100) > 0,
            )
            sheets = [lineup(np.stack([won, ~won], axis=1) * 1.0) for won in wins]
            rivals_seen.append(constant_sum(sheets) == 1.0)
            ones = (wins[0] * 1.0 + ~wins[1] * 1.0) / 2
            compared = Judge(0.95, 0).paired(ones, 1 - ones, of="", name=[repeat])
            found.append(is_claim(compared.difference))
        kind = "found" if strength else "false"
        line = {"claim": "constant sum, both seats", "of": f"{strength} sd stronger"}
        yield line | {"recognised": percent(rivals_seen), kind: percent(found)}
    for apart in (0.0, 1.0):
        found = []
        for repeat in range(repeats):
            rng = np.random.default_rng([6, repeat])
            strengths = rng.normal(size=(2, 12)) + np.array([[apart], [-apart]]) / 2
            odds = strengths[0][:, None, None] - strengths[1][None, :, None]
            won = [
                odds + luck + rng.normal(size=(12, 12, 20)) > 0 for luck in rng.normal(size=(2, 20))
            ]
            met = (won[0] * 2.0 - 1 + won[1] * 2.0 - 1) / 2
            luck = luck_of_meetings(list(np.ndindex(12, 12)), met.mean(axis=2).ravel())
            duel = over_meetings([met.mean(axis=1), met.mean(axis=0)], luck=luck)
            found.append(duel.p <= ALPHA)
        kind = "found" if apart else "false"
        yield {"claim": "methods that are rivals", "of": f"{apart} sd apart", kind: percent(found)}


def families(repeats: int) -> Iterator[Line]:
    """Claims of all pairs by Holm: none is false, and what is plain is found."""
    judge = Judge(0.95, 0)
    for name, draw in (
        ("normal", lambda rng, size: rng.normal(size=size)),
        ("exponential", lambda rng, size: rng.exponential(size=size)),
        ("3 % far off", lambda rng, size: rng.normal(size=size) - 8.0 * (rng.random(size) < 0.03)),
        ("-1, 0, 1", lambda rng, size: rng.integers(-1, 2, size) * 1.0),
    ):
        false = []
        for repeat in range(repeats):
            rng = np.random.default_rng([7, repeat])
            values = draw(rng, (4, 100)) + draw(rng, 100)
            pairs = [(i, j) for i in range(4) for j in range(i)]
            made = [
                judge.paired(values[i], values[j], of="", name=[repeat, i, j]) for i, j in pairs
            ]
            false.append(any(claims([each.difference for each in made])))
        yield {"claim": "4 equal checkpoints", "of": name, "false": percent(false)}
    false = []
    for repeat in range(repeats):
        rng = np.random.default_rng([8, repeat])
        values = (
            rng.normal(size=(3, 10, 1)) + rng.normal(size=(3, 1, 30)) + rng.normal(size=(3, 10, 30))
        )
        made = [
            judge.between_runs(values[i], values[j], of="", name=[repeat, i, j])
            for i, j in ((1, 0), (2, 0), (2, 1))
        ]
        false.append(any(claims([each.difference for each in made])))
    yield {"claim": "3 equal methods, 10 runs", "of": "normal", "false": percent(false)}
    rng = np.random.default_rng(9)
    values = 10.0 * np.arange(14)[:, None] + rng.normal(size=(14, 100))
    pairs = [(i, j) for i in range(14) for j in range(i)]
    made = [judge.paired(values[i], values[j], of="", name=[i, j]) for i, j in pairs]
    found = claims([each.difference for each in made])
    yield {"claim": "14 policies 10 sd apart", "of": f"{len(pairs)} pairs", "found": percent(found)}
    ours, students = [], []
    for repeat in range(repeats):
        off = np.random.default_rng([10, repeat]).normal(0.3, 1, 100)
        ours.append(paired_effect(np.zeros(100), off, rng=np.random.default_rng(repeat)).p <= ALPHA)
        t = off.mean() / off.std(ddof=1) * 10
        students.append(student_p(float(t), 99) <= ALPHA)
    line = {"claim": "0.3 sd apart, 100 pairs", "of": "normal", "found": percent(ours)}
    yield line | {"found_by_t": percent(students)}


def units(repeats: int) -> Iterator[Line]:
    """Conclusions in other units; equal returns; what n episodes may have missed."""
    differ, flat = 0, 0
    for repeat in range(repeats // 5):
        rng = np.random.default_rng([11, repeat])
        off = [rng.integers(-1, 2, 60) * 1.0, rng.normal(0.2, 1, 60), rng.poisson(0.2, 60) * 1.0][
            repeat % 3
        ]
        made = [
            paired_effect(
                np.zeros(60), unit * off, rng=np.random.default_rng(repeat), is_share=False
            )
            for unit in (1.0, 2.0, 0.001, 1e6)
        ]
        differ += any(abs(each.p - made[0].p) > 1e-9 for each in made)
    for value in (0.0, 1.0, 10.0):
        found = Judge(0.95, 0).episodes(np.full(50, value), "mean", of="", name=[value])
        flat += found is not None and found["low"] is None
    yield {"claim": "p in other units", "of": "1, 2, 0.001, 1e6", "differs": percent(differ > 0)}
    yield {"claim": "equal returns", "of": "0, 1, 10", "refused": round(100 * flat / 3, 1)}
    for far, n in ((10.0, 95), (10.0, 200), (100.0, 95), (100.0, 200)):
        held, seen = [], []
        for repeat in range(repeats):
            rng = np.random.default_rng([12, repeat])
            has_crashed = rng.random(n) < 0.02
            found = one_sample(rng.normal(size=n) - far * has_crashed, rng=rng)
            held.append(found.low <= -0.02 * far <= found.high)
            seen.append(has_crashed.any())
        line = {"claim": f"mean of {n} episodes", "of": f"a crash in 50 costs {far:g} sd"}
        line |= {"held": percent(held), "seen": percent(seen)}
        yield line | {"held_where_seen": percent(np.array(held)[seen])}


def broken(repeats: int) -> Iterator[Line]:
    """Equal methods of 20 runs on 40 seeds; one run breaks off on the hard ones."""
    for part in (0.0, 0.02, 0.3, 1.0):
        false, refused = [], []
        for repeat in range(repeats if part < 0.1 else repeats // 10):
            rng = np.random.default_rng([13, repeat])
            hard = rng.normal(size=40)
            values = hard + rng.normal(size=(2, 20, 1)) * 0.2 + rng.normal(size=(2, 20, 40))
            values[1] += 1.5 * (hard < -0.5)  # better on hard seeds, worse on the others
            values[1] -= 1.5 * 0.3085
            gone = np.zeros(40, bool)
            gone[np.argsort(hard)[: round(40 * part)]] = True
            sheets = [lineup(row[:, None]) for row in values.reshape(40, 40)]
            sheets[0] = lineup(values[0, 0][:, None], gone)
            figures = [sheet.values("return") for sheet in sheets]
            made = Judge(0.95, 0).between_runs(
                figures[:20], figures[20:], of="", name=[repeat], lost=lost(sheets, figures)
            )
            false.append(is_claim(made.difference))
            refused.append(made.difference is None or made.difference["low"] is None)
        line = {"claim": "equal methods, one run breaks off", "of": f"in {100 * part:g} % of seeds"}
        yield line | {"false": percent(false), "refused": percent(refused)}


def resets(repeats: int) -> Iterator[Line]:
    """Resets that follow their seed, and such that don't, are told apart."""
    for is_seeded in (True, False):
        said = []
        for repeat in range(repeats // 10):
            rng = np.random.default_rng([14, repeat])
            first = rng.integers(0, 1000, 50)
            second = first if is_seeded else rng.integers(0, 1000, 50)
            sheets = [
                lineup(np.zeros((50, 1)), resets=each.astype(str)) for each in (first, second)
            ]
            said.append(differing_resets(sheets)[0] == 0)
        of = "resets follow their seed" if is_seeded else "resets ignore their seed"
        yield {"claim": "said to begin alike", "of": of, "said": percent(said)}


def chosen(repeats: int) -> Iterator[Line]:
    """Leads of the best of five equal policies: chosen on one half, measured on the other."""
    held, false, naive = [], [], []
    for repeat in range(repeats):
        values = np.random.default_rng([15, repeat]).normal(size=(5, 100))
        for half, into in ((50, held), (0, naive)):
            best = int(values[:, : half or 100].mean(axis=1).argmax())
            other = 0 if best else 1
            off = values[:, half:]
            rng = np.random.default_rng(repeat)
            found = paired_effect(off[other], off[best], rng=rng)
            into.append(found.low <= 0 <= found.high)
            if half:
                false.append(found.p <= ALPHA)
    line = {"claim": "lead of a best response", "of": "5 equal policies", "held": percent(held)}
    yield line | {"false": percent(false), "usual": percent(naive)}


def stopped(repeats: int) -> Iterator[Line]:
    """Two equal policies, compared once their intervals are narrow."""
    for width in (0.5, 0.35):
        false, played = [], []
        for repeat in range(repeats):
            rng = np.random.default_rng([16, repeat])
            values = rng.normal(size=(2, 600)) + rng.normal(size=600)
            stops = [Narrowing().stop_at(each, width) or 600 for each in values]
            n = min(-(-max(stops) // 20) * 20, 600)
            a, b = values[:, :n]
            false.append(paired_effect(a, b, rng=rng, is_share=False).p <= ALPHA)
            played.append(n)
        line = {"claim": "equal, stopped when narrow", "of": f"width {width}"}
        yield line | {"false": percent(false), "stopped": round(float(np.mean(played)))}


def cells(repeats: int, lot: int = 1) -> Iterator[Line]:
    """Cells by lot (`evaluation_cells.py`); `off`: how many standard errors held is from 95 %."""
    all_cells = json.loads(CELLS.read_text())
    for place, cell in enumerate(each for each in all_cells if each["lot"] == lot):
        make, truth = interval_of(cell)
        line = judged(make, truth, repeats, 17 + place)
        many = repeats * (100 - line["refused"]) / 100
        off = None if line["held"] is None else (line["held"] / 100 - 0.95) * (many / 0.0475) ** 0.5
        of = f"{cell['shape']}, {', '.join(f'{k} {v}' for k, v in cell['given'].items())}"
        line |= {"off": None if off is None else round(off, 1)}
        yield {"lot": lot, "claim": cell["kind"], "of": of, "n": cell["n"]} | line


PARTS: dict[str, Callable[[int], Iterator[Line]]] = {
    "meetings": meetings,
    "overall": overall,
    "constant sums": constant_sums,
    "families": families,
    "units": units,
    "broken": broken,
    "resets": resets,
    "chosen": chosen,
    "stopped": stopped,
    "cells": cells,
}


def main() -> None:
    """Prints the lines."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="100 repetitions")
    parser.add_argument("--only", choices=PARTS, action="append", help="these parts alone")
    parser.add_argument("--repeats", type=int, default=1_000)
    parser.add_argument("--lot", type=int, default=1, help="seed of the cells that lots drew")
    options = parser.parse_args()
    resampling.RESAMPLES = 1_999  # in place of 4,999
    parts = PARTS | {"cells": partial(cells, lot=options.lot)}
    for part in options.only or parts:
        for line in parts[part](100 if options.quick else options.repeats):
            spent = {"seconds": round(time.process_time(), 1)}
            print(json.dumps({"part": part} | line | spent), flush=True)


if __name__ == "__main__":
    main()
