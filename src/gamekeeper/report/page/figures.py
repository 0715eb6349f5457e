"""The figures of every episode and agent of a run, summed without a look at each row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.core.arrow import TERM
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.legible import legible

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

APART: Final = ("obs", "info", "mask", "received", "odd", "live", "action")
"""Kinds of columns that sums don't need."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What each episode came to, agent by agent.

    Attributes:
        headers: the rows of `episodes`.
        agents: in the order of their seats; only those with a row.
        present: [episodes, agents] the agent has a row in the episode.
        returns: [episodes, agents] the sum of its rewards.
        lengths: [episodes, agents] its actions, without the empty steps of those who ended.
        terms: by reward term, [episodes, agents].
        terminated: [episodes, agents] it was told so.
        truncated: [episodes, agents] it was told so.
    """

    headers: tuple[Mapping[str, Any], ...]
    agents: tuple[str, ...]
    present: BoolArray
    returns: FloatArray
    lengths: FloatArray
    terms: Mapping[str, FloatArray]
    terminated: BoolArray
    truncated: BoolArray
    _places: Mapping[int, int] = field(default_factory=dict)

    @property
    def team(self) -> FloatArray:
        """[episodes] the sum of all agents' returns."""
        return np.asarray(np.where(self.present, self.returns, 0.0).sum(axis=1), np.float64)

    def place(self, episode: int) -> int:
        """The row of an episode."""
        return self._places[episode]


@legible
def figures_of(evidence: Evidence) -> Figures:
    """The figures of a whole run, from one reading of its rows."""
    headers = tuple(evidence.episodes.to_pylist())
    steps = evidence.tables.table("steps", without=APART)
    if steps is None or not steps.num_rows:
        steps = evidence.steps
    known = set(pc.unique(steps["agent"]).to_pylist())
    agents = [name for name in map(str, evidence.manifest.get("agents") or ()) if name in known]
    agents += sorted(known - set(agents))
    rows = _Rows(steps, [header["episode"] for header in headers], agents)
    ended = rows.flag("terminated") | rows.flag("truncated")
    acted = rows.valid("order") & ~rows.valid("raised") & ~ended
    terms = [name for name in steps.schema.names if name.startswith(TERM)]
    return Figures(
        headers=headers,
        agents=tuple(agents),
        present=rows.counted(np.ones(steps.num_rows, np.bool_)) > 0,
        returns=rows.summed("reward"),
        lengths=rows.counted(acted),
        terms={name[len(TERM) :]: rows.summed(name) for name in terms},
        terminated=rows.counted(rows.flag("terminated")) > 0,
        truncated=rows.counted(rows.flag("truncated")) > 0,
        _places={header["episode"]: place for place, header in enumerate(headers)},
    )


class _Rows:
    """Rows with the place of their episode and agent, summed into [episodes, agents]."""

    def __init__(self, steps: pa.Table, episodes: list[int], agents: list[str]) -> None:
        self.steps = steps
        self.shape = (len(episodes), len(agents))
        order = np.argsort(np.asarray(episodes, np.int64), kind="stable")
        numbers = np.asarray(episodes, np.int64)[order]
        row = np.searchsorted(numbers, steps["episode"].to_numpy())
        row = order[np.minimum(row, max(len(order) - 1, 0))] if len(order) else row
        column = pc.index_in(steps["agent"], pa.array(agents, pa.string()))
        self.cell = row * max(len(agents), 1) + column.to_numpy().astype(np.int64)

    def flag(self, name: str) -> BoolArray:
        flags = pc.fill_null(self.steps[name], False)
        return np.asarray(flags.to_numpy(), np.bool_)

    def valid(self, name: str) -> BoolArray:
        return np.asarray(pc.is_valid(self.steps[name]).to_numpy(), np.bool_)

    def summed(self, name: str) -> FloatArray:
        return self._into(pc.fill_null(self.steps[name], 0.0).to_numpy())

    def counted(self, chosen: BoolArray) -> FloatArray:
        return self._into(chosen)

    def _into(self, weights: Any) -> FloatArray:
        size = self.shape[0] * self.shape[1]
        sums = np.bincount(self.cell, np.asarray(weights, np.float64), minlength=size)
        return np.asarray(sums[:size].reshape(self.shape), np.float64)
