"""The figures of a line-up's episodes, by metric and by whom they are of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.core.outcome import EACH, TEAM
from gamekeeper.evaluate.rows import INFO, REWARD

FloatArray = NDArray[np.float64]

RETURN, LENGTH, SUCCESS = "return", "length", "success"
ROLE: Final = "role"
SCOPES: Final = (TEAM, ROLE, EACH)


@dataclass(frozen=True, slots=True)
class Sheet:
    """The episodes of one line-up, each agent's figures in columns.

    Attributes:
        agents: in the order in which they first appear.
        roles: of each agent.
        episodes: [episodes] their numbers, ascending.
        table: the rows.
        places: [rows] where each stands: episode and agent.
    """

    agents: tuple[str, ...]
    roles: tuple[str, ...]
    episodes: NDArray[np.int64]
    table: pa.Table
    places: tuple[NDArray[np.intp], NDArray[np.intp]]

    @classmethod
    def of(cls, table: pa.Table) -> Sheet:
        """The sheet of a line-up's rows."""
        agents = table["agent"].combine_chunks().dictionary_encode()
        names = tuple(agents.dictionary.to_pylist())
        which = agents.indices.to_numpy(zero_copy_only=False).astype(np.intp)
        episodes, at = np.unique(table["episode"].to_numpy(), return_inverse=True)
        roles = dict(zip(which.tolist(), table["role"].to_pylist(), strict=True))
        by_agent = tuple(str(roles[place]) for place in range(len(names)))
        return cls(names, by_agent, episodes, table, (at.astype(np.intp), which))

    def column(self, name: str) -> FloatArray:
        """[episodes, agents] a column's values; NaN where an agent wasn't there or has none."""
        found = np.full((len(self.episodes), len(self.agents)), np.nan)
        if name in self.table.schema.names:
            values = pc.cast(self.table[name], pa.float64()).to_numpy()
            found[self.places] = values
        return found

    def members(self, scope: str, who: str) -> list[int]:
        """The columns of those in a scope."""
        if scope == TEAM:
            return list(range(len(self.agents)))
        names = self.roles if scope == ROLE else self.agents
        return [place for place, name in enumerate(names) if name == who]

    def values(self, metric: str, scope: str = TEAM, who: str = TEAM) -> FloatArray:
        """[episodes] a metric; NaN where an episode has none.

        The team's return and reward terms are sums over all agents; a role's figures are means
        over its agents in each episode; success is its own condition's.
        """
        members = self.members(scope, who)
        if metric == SUCCESS:
            return _first(self.column(f"success.{scope}")[:, members])
        if metric == LENGTH and scope == TEAM:
            return _first(self.column("turns"))
        figures = self.column(metric)[:, members]
        is_sum = scope == TEAM and (metric == RETURN or metric.startswith(REWARD))
        return _sums(figures) if is_sum else _means(figures)

    def metrics(self, terms: Sequence[str] | None, infos: Sequence[str]) -> list[str]:
        """The metrics that there are: return, length, reward terms, fields of the infos."""
        names = self.table.schema.names
        there = [name for name in names if name.startswith((REWARD, INFO))]
        wanted = [
            name
            for name in there
            if (name.startswith(REWARD) and (terms is None or name[len(REWARD) :] in terms))
            or (name.startswith(INFO) and name[len(INFO) :] in infos)
        ]
        return [
            RETURN,
            LENGTH,
            *(name for name in wanted if self.table[name].null_count < len(self.table)),
        ]

    @property
    def broken(self) -> int:
        """Episodes that an exception broke off."""
        return int((~np.isnan(_first(self._is_broken()))).sum())

    def _is_broken(self) -> FloatArray:
        found = np.full((len(self.episodes), len(self.agents)), np.nan)
        found[self.places] = np.where(pc.is_valid(self.table["error"]).to_numpy(), 1.0, np.nan)
        return found

    def endings(self, scope: str = TEAM, who: str = TEAM) -> dict[str, Any]:
        """How they ended: terminated, truncated, cut, broken off; and the reasons by name.

        The team is counted by episode (`mixed` where its agents ended differently), others by
        agent and episode.
        """
        members = set(self.members(scope, who))
        reasons: dict[str, int] = {}
        kinds = {"terminated": 0, "truncated": 0, "cut": 0}
        for flag, reason in self._ends(members, is_team=scope == TEAM):
            kinds[flag] = kinds.get(flag, 0) + 1
            reasons[reason] = reasons.get(reason, 0) + 1
        return {**kinds, "reasons": dict(sorted(reasons.items()))}

    def _ends(self, members: set[int], *, is_team: bool) -> Iterator[tuple[str, str]]:
        terminated, truncated = (
            self.table[name].to_pylist() for name in ("terminated", "truncated")
        )
        reasons, broken = self.table["ending"].to_pylist(), self.table["error"].to_pylist()
        episodes, agents = (places.tolist() for places in self.places)
        by_episode: dict[int, set[tuple[str, str]]] = {}
        for row, agent in enumerate(agents):
            if agent not in members:
                continue
            flag = "terminated" if terminated[row] else "truncated" if truncated[row] else "cut"
            end = ("failed" if broken[row] is not None else flag, str(reasons[row]))
            if is_team:
                by_episode.setdefault(episodes[row], set()).add(end)
            else:
                yield end
        for ends in by_episode.values():
            flags, names = {flag for flag, _ in ends}, {name for _, name in ends}
            yield _one(flags), _one(names)


def sheets_of(table: pa.Table) -> dict[tuple[str, str], Sheet]:
    """The sheets of a table of episodes, by environment and line-up; its rows stand in order."""
    if not table.num_rows:
        return {}
    names = [table[key].combine_chunks().dictionary_encode() for key in ("environment", "pairing")]
    one, two = (each.indices.to_numpy(zero_copy_only=False) for each in names)
    changes = np.flatnonzero((np.diff(one) != 0) | (np.diff(two) != 0)) + 1
    bounds = [0, *changes.tolist(), table.num_rows]
    found = {}
    for start, end in pairwise(bounds):
        part = table.slice(start, end - start)
        key = (str(part["environment"][0]), str(part["pairing"][0]))
        found[key] = Sheet.of(part)
    return found


def _one(words: set[str]) -> str:
    return next(iter(words)) if len(words) == 1 else "mixed"


def _first(figures: FloatArray) -> FloatArray:
    """[episodes] the value that all agents of an episode share."""
    if not figures.shape[1]:
        return np.full(len(figures), np.nan)
    place = np.argmax(~np.isnan(figures), axis=1)
    return np.asarray(figures[np.arange(len(figures)), place])


def _sums(figures: FloatArray) -> FloatArray:
    total = np.nansum(figures, axis=1)
    return np.where(np.isnan(figures).all(axis=1), np.nan, total)


def _means(figures: FloatArray) -> FloatArray:
    count = (~np.isnan(figures)).sum(axis=1)
    total = np.nansum(figures, axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
