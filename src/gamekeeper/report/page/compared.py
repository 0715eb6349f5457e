"""Two runs agent by agent: on the same seeds where there are enough of them."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.paired import FEWEST, paired_effect
from gamekeeper.errors import EvidenceError
from gamekeeper.report.page.data import Block, Cell, Table, interval, name, number
from gamekeeper.report.page.figures import Figures

FloatArray = NDArray[np.float64]


def compared_block(one: Figures, two: Figures, *, names: tuple[str, str], rng: Generator) -> Block:
    """Two runs agent by agent: on the same seeds where there are enough, else side by side."""
    seeds = {
        header["seed"]: place
        for place, header in enumerate(one.headers)
        if header["seed"] is not None
    }
    pairs = [
        (seeds[header["seed"]], place)
        for place, header in enumerate(two.headers)
        if header["seed"] in seeds
    ]
    rows = []
    for agent in [each for each in one.agents if each in two.agents]:
        a, b = one.agents.index(agent), two.agents.index(agent)
        both = [(i, k) for i, k in pairs if one.present[i, a] and two.present[k, b]]
        base = np.array([one.returns[i, a] for i, _ in both], np.float64)
        other = np.array([two.returns[k, b] for _, k in both], np.float64)
        rows.append((
            name(agent), number(_mean(one.returns[one.present[:, a], a])),
            number(_mean(two.returns[two.present[:, b], b])), number(len(both)),
            *_difference(base, other, rng),
        ))  # fmt: skip
    columns = ("agent", *names, "same seeds", "difference", "95 % interval")
    note = f"Differences are over episodes with one seed; an interval needs {FEWEST} of them."
    table = Table("Returns, and how they differ on the same seeds", columns, tuple(rows), note)
    missing = [each for each in (*one.agents, *two.agents) if each not in one.agents or
               each not in two.agents]  # fmt: skip
    notes = (f"Only in one of them: {', '.join(missing)}.",) if missing else ()
    return Block(title=f"{names[1]} beside {names[0]}", tables=(table,), notes=notes)


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if len(values) else None


def _difference(base: FloatArray, other: FloatArray, rng: Generator) -> tuple[Cell, Cell]:
    if not len(base):
        return number(None), Cell("-", "number")
    try:
        effect = paired_effect(base, other, rng=rng)
    except EvidenceError:  # too few pairs, or figures that aren't finite
        return number(float((other - base).mean())), Cell("-", "number")
    return number(effect.value), Cell(interval(effect.low, effect.high), "number")
