"""Cells of evaluation's coverage that were drawn by lot, not chosen: a figure, a shape, an n.

    python benchmarks/evaluation_cells.py SEED... > benchmarks/evaluation_cells.json

Prints 40 cells for each seed: each kind of interval in turn, with a shape and its parameters, and a
number of episodes or runs, all by lot. `evaluation_truths.py --only cells --lot SEED` measures
those of one seed, by the functions that make the intervals which `gamekeeper evaluate` prints.
"""

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.statistics.training_runs import luck_of_meetings

Cell = Mapping[str, Any]
Draw = Callable[[Generator, Any], Any]
CELLS = Path(__file__).with_suffix(".json")
MANY = 40
SIZES = (10, 20, 50, 100, 200)
RUNS = (10, 12, 20, 30, 50)
"""Training runs, in place of `SIZES`, of the kinds that are about methods."""
SEEDS = 30
"""Episode seeds that all runs share."""
OF_EPISODES = ("mean", "iqm", "median", "success", "difference", "improvement")
OF_RUNS = (
    "mean of runs",
    "iqm of runs",
    "success of runs",
    "methods apart",
    "cross-play",
    "zero-shot",
    "overall",
)
KINDS = (*OF_EPISODES, *OF_RUNS)
"""A point of a learning curve is a mean or an IQM, of episodes or of runs."""


def gamma(shape: float, sign: int) -> Draw:
    """Skewed one way."""
    return lambda rng, size: sign * rng.gamma(shape, 1, size)


def zeros(part: float, sign: int) -> Draw:
    """Zero in a part of the episodes, else something."""
    return lambda rng, size: sign * (rng.random(size) >= part) * rng.gamma(2, 1, size)


def bounded(a: float, b: float) -> Draw:
    """Within 0 and 1."""
    return lambda rng, size: rng.beta(a, b, size)


def lumps(values: list[float], chances: list[float]) -> Draw:
    """A few distinct values."""
    return lambda rng, size: rng.choice(values, p=chances, size=size)


def heavy(freedom: float) -> Draw:
    """Far values either way."""
    return lambda rng, size: rng.standard_t(freedom, size)


def peaks(part: float, apart: float) -> Draw:
    """Two peaks."""
    return lambda rng, size: apart * (rng.random(size) < part) + rng.normal(0, 1, size)


def constant(part: float, level: float) -> Draw:
    """One number but for a part of the episodes."""
    return lambda rng, size: level + (rng.random(size) < part) * rng.normal(0, 1, size)


def losses(part: float, far: float) -> Draw:
    """A rare loss of so many standard deviations."""
    return lambda rng, size: rng.normal(0, 1, size) - far * (rng.random(size) < part)


def scores(most: int, part: float) -> Draw:
    """Whole numbers."""
    return lambda rng, size: rng.binomial(most, part, size) * 1.0


def success(part: float) -> Draw:
    """0 or 1."""
    return lambda rng, size: (rng.random(size) < part) * 1.0


SHAPES: dict[str, tuple[Callable[..., Draw], Callable[[Generator], dict[str, Any]]]] = {
    "skewed": (gamma, lambda rng: {"shape": rng.uniform(0.6, 3), "sign": rng.choice([-1, 1])}),
    "zeros": (zeros, lambda rng: {"part": rng.uniform(0.3, 0.8), "sign": rng.choice([-1, 1])}),
    "bounded": (bounded, lambda rng: {"a": rng.uniform(0.5, 5), "b": rng.uniform(0.5, 5)}),
    "lumps": (
        lumps,
        lambda rng: {
            "values": np.sort(rng.choice(20, 4, replace=False)).tolist(),
            "chances": rng.dirichlet([2.0] * 4).tolist(),
        },
    ),
    "heavy tails": (heavy, lambda rng: {"freedom": rng.uniform(2.5, 6)}),
    "two peaks": (peaks, lambda rng: {"part": rng.uniform(0.2, 0.8), "apart": rng.uniform(2, 8)}),
    "near-constant": (constant, lambda rng: {"part": rng.uniform(0.02, 0.15), "level": 10.0}),
    "rare loss": (losses, lambda rng: {"part": rng.uniform(0.01, 0.05), "far": rng.uniform(5, 30)}),
    "whole scores": (
        scores,
        lambda rng: {"most": rng.integers(2, 12), "part": rng.uniform(0.1, 0.9)},
    ),
    "success": (success, lambda rng: {"part": rng.uniform(0.03, 0.97)}),
}


def by_lot(seed: int) -> list[dict[str, Any]]:
    """Cells of all kinds in turn, of all shapes in any order."""
    rng = np.random.default_rng(seed)
    found = []
    shapes = rng.permutation(list(SHAPES) * (MANY // len(SHAPES))).tolist()
    for place, lot in enumerate(shapes):
        kind = KINDS[place % len(KINDS)]
        shape = "success" if kind.startswith("success") else lot
        given = {name: np.round(value, 3).tolist() for name, value in SHAPES[shape][1](rng).items()}
        n = int(rng.choice(RUNS if kind in OF_RUNS else SIZES))
        found.append({"lot": seed, "kind": kind, "shape": shape, "given": given, "n": n})
    return found


def drawn_by(cell: Cell) -> Draw:
    """The distribution of a cell; rounded chances add up to 1."""
    given = dict(cell["given"])
    if "chances" in given:
        given["chances"] = (np.array(given["chances"]) / sum(given["chances"])).tolist()
    return SHAPES[cell["shape"]][0](**given)


def interval_of(cell: Cell) -> tuple[Callable[[Generator], Any], float]:
    """What makes a cell's interval of an experiment, and the truth that it should hold."""
    draw, n, kind = drawn_by(cell), cell["n"], cell["kind"]
    big = np.sort(draw(np.random.default_rng(1), 2_000_000) * 1.0)
    spread = float(big.std())
    if kind in OF_EPISODES:
        truth = truth_of_episodes(kind, draw, big)
        return lambda rng: of_episodes(kind, draw, n, spread, rng), truth
    if kind == "success of runs":
        part = cell["given"]["part"]
        return lambda rng: of_successes(part, n, rng), part

    def made(rng: Generator) -> Any:
        return of_runs(kind, draw, n, spread, rng)

    if kind == "iqm of runs":
        own = np.sort(big + np.random.default_rng(2).normal(0, spread / SEEDS**0.5, len(big)))
        return made, float(own[len(own) // 4 : -len(own) // 4].mean())
    symmetric = kind in ("methods apart", "zero-shot")
    return made, 0.0 if symmetric else float(big.mean())


def truth_of_episodes(kind: str, draw: Draw, big: Any) -> float:
    """What is asked of a distribution; `big` is a large sample of it, sorted."""
    if kind == "difference":
        return 0.5 * float(big.mean())
    if kind == "improvement":
        two = draw(np.random.default_rng(2), len(big)) + 0.3 * float(big.std())
        one = draw(np.random.default_rng(3), len(big))
        return float(np.mean(two > one) + np.mean(two == one) / 2)
    if kind == "iqm":
        return float(big[len(big) // 4 : -len(big) // 4].mean())
    return float(np.median(big) if kind == "median" else big.mean())


def of_episodes(kind: str, draw: Draw, n: int, spread: float, rng: Generator) -> Any:
    """The interval of a checkpoint's episodes, or of two on the same seeds."""
    judge, name = Judge(0.95, int(rng.integers(1 << 30))), [kind]
    one = draw(rng, n) * 1.0
    if kind == "success":
        return held(judge.share(one))
    if kind == "difference":  # the seed's luck is shared, and the second gets half as much more
        luck = rng.normal(0, 1, n)
        compared = judge.paired(luck + 1.5 * one, luck + one, of="", name=name)
        return held(compared.difference)
    if kind == "improvement":
        two = draw(rng, n) + 0.3 * spread
        return held(judge.paired(two, one, of="", name=name).improvement)
    return held(judge.episodes(one, kind, of="", name=name))  # type: ignore[arg-type]  # named so


def of_runs(kind: str, draw: Draw, n: int, spread: float, rng: Generator) -> Any:
    """The interval of a method: runs differ by the shape, seeds and episodes by as much again."""
    judge, name = Judge(0.95, int(rng.integers(1 << 30))), [kind]

    def method(many: int, luck: Any) -> Any:
        own = draw(rng, (many, 1)) * 1.0
        return own + luck + spread * rng.normal(size=(many, SEEDS))

    luck = spread * rng.normal(size=SEEDS)
    if kind in ("mean of runs", "iqm of runs"):
        statistic: Any = kind.split()[0]
        return held(judge.runs(list(method(n, luck)), statistic, of="", name=name))
    if kind == "methods apart":
        compared = judge.between_runs(
            list(method(n, luck)), list(method(n, luck)), of="", name=name
        )
        return held(compared.difference)
    if kind == "overall":
        found = {str(k): method(n, spread * rng.normal(size=SEEDS)) for k in range(3)}
        return held(judge.environments(found, "mean", of="", name=name))
    rest = spread * rng.normal(size=(n, n, SEEDS))
    if kind == "cross-play":
        met = draw(rng, (n, 1, 1)) + luck + rest
        met = met + spread * rng.normal(size=(1, n, 1))
        luck = luck_of_meetings(list(np.ndindex(n, n)), met.mean(axis=2).ravel())
        return held(judge.meetings([met.mean(axis=1), met.mean(axis=0)], luck=luck, of=""))
    own = draw(rng, n) * 1.0
    met = own[:, None, None] - own[None, :, None] + luck + rest
    others = ~np.eye(n, dtype=bool)
    its = [np.concatenate([met[k][others[k]], met[:, k][others[k]]]) for k in range(n)]
    block = np.stack([each.mean(axis=0) for each in its])
    pairs = [(i, j) for i, j in np.ndindex(n, n) if i != j]
    luck = luck_of_meetings(pairs, np.array([met[pair].mean() for pair in pairs]))
    return held(judge.meetings([block], times=2 * (n - 1) / (n - 2), luck=luck, of=""))


def of_successes(part: float, n: int, rng: Generator) -> Any:
    """The interval of a method's success, whose runs have chances of their own."""
    chances = rng.beta(10 * part, 10 * (1 - part), (n, 1))
    won = (rng.random((n, SEEDS)) < chances) * 1.0
    judge = Judge(0.95, int(rng.integers(1 << 30)))
    return held(judge.runs(list(won), "mean", of="", name=["success"], is_share=True))


class Bounds:
    """An interval as results have it, as an object with bounds."""

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high


def held(found: Mapping[str, Any] | None) -> Bounds:
    """The bounds.

    Raises:
        EvidenceError: there are none, as they were refused.
    """
    if found is None or found["low"] is None:
        raise EvidenceError("refused")
    return Bounds(found["low"], found["high"])


def main() -> None:
    """Prints the cells."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", nargs="+", type=int, metavar="SEED")
    cells = [cell for seed in parser.parse_args().seeds for cell in by_lot(seed)]
    print("[\n" + ",\n".join(json.dumps(cell) for cell in cells) + "\n]")


if __name__ == "__main__":
    main()
