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
    sums = _Sums([header["episode"] for header in headers])
    for steps in evidence.tables.all_parts("steps", without=APART) or ():
        if steps.num_rows:
            sums.add(steps)
    agents = [name for name in map(str, evidence.manifest.get("agents") or ()) if sums.has(name)]
    agents += sorted(set(sums.names) - set(agents))
    return Figures(
        headers=headers,
        agents=tuple(agents),
        present=sums.of("rows", agents) > 0,
        returns=sums.of("reward", agents),
        lengths=sums.of("acted", agents),
        terms={name[len(TERM) :]: sums.of(name, agents) for name in sums.terms},
        terminated=sums.of("terminated", agents) > 0,
        truncated=sums.of("truncated", agents) > 0,
        _places={header["episode"]: place for place, header in enumerate(headers)},
    )


class _Sums:
    """Sums by agent and episode, of rows in their order: floats added otherwise differ."""

    def __init__(self, episodes: list[int]) -> None:
        self.names: dict[str, int] = {}
        self.terms: dict[str, None] = {}
        self._sums: dict[str, FloatArray] = {}
        self._order = np.argsort(np.asarray(episodes, np.int64), kind="stable")
        self._numbers = np.asarray(episodes, np.int64)[self._order]

    def has(self, agent: str) -> bool:
        """Whether the agent has a row."""
        return agent in self.names

    def of(self, what: str, agents: list[str]) -> FloatArray:
        """[episodes, agents] one of the sums."""
        places = [self.names[agent] for agent in agents]
        sums = self._sums.get(what, np.zeros((len(self._numbers), 0)))
        return np.ascontiguousarray(sums[:, places])

    def add(self, steps: pa.Table) -> None:
        """The next rows; there is at least one."""
        row = np.searchsorted(self._numbers, steps["episode"].to_numpy())
        if len(self._order):
            row = self._order[np.minimum(row, len(self._order) - 1)]
        agents = steps["agent"].combine_chunks().dictionary_encode()
        columns = [
            self.names.setdefault(name, len(self.names)) for name in agents.dictionary.to_pylist()
        ]
        cells = row, np.array(columns)[np.asarray(agents.indices)]
        self.terms |= dict.fromkeys(n for n in steps.schema.names if n.startswith(TERM))
        flags = {
            name: np.asarray(pc.fill_null(steps[name], False).to_numpy(), np.bool_)
            for name in ("terminated", "truncated")
        }
        chose, raised = (
            np.asarray(pc.is_valid(steps[name]).to_numpy(), np.bool_)
            for name in ("order", "raised")
        )
        acted = chose & ~raised & ~(flags["terminated"] | flags["truncated"])
        for name, weights in {"rows": np.ones(len(row)), "acted": acted, **flags}.items():
            self._into(name, cells, weights)
        for name in ("reward", *self.terms):
            self._into(name, cells, pc.fill_null(steps[name], 0.0).to_numpy())

    def _into(self, what: str, cells: tuple[Any, Any], weights: Any) -> None:
        sums = self._sums.get(what, np.zeros((len(self._numbers), 0)))
        more = len(self.names) - sums.shape[1]
        if more:  # agents that had no row before
            sums = np.pad(sums, ((0, 0), (0, more)))
        np.add.at(sums, cells, np.asarray(weights, np.float64))
        self._sums[what] = sums
