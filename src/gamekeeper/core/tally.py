"""What the rows of a run come to by agent and episode, added up some rows at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

FLAGS: Final = ("terminated", "truncated")
KEYS: Final = ("episode", "agent")
FOLD: Final = 64
"""Parts whose groups wait, before equal ones are made one."""


class Tally:
    """Sums over rows of `steps`, in whose order they are added.

    Args:
        noop_of: the declared noop of an agent; None where it has none.
    """

    def __init__(self, noop_of: Callable[[str], Any]) -> None:
        self._noop_of = noop_of
        self.returns: dict[str, float] = {}
        """By agent, the sum of its rewards; every agent that has a row stands in it."""
        self.idle: Counter[str] = Counter()
        """By agent, how many of its whole-number actions were its noop."""
        self._pairs = Groups(dict.fromkeys(FLAGS, "max"))
        self._acted = Groups({"order": "sum"})

    def add(self, steps: pa.Table) -> None:
        """The next rows."""
        self._pay(steps)
        self._pairs.add(_grouped(steps, dict.fromkeys(FLAGS, "max")))
        ended = pc.or_(*(pc.fill_null(steps[name], False) for name in FLAGS))
        chose = pc.and_(pc.is_valid(steps["order"]), pc.is_null(steps["raised"]))
        acted = steps.filter(pc.and_(chose, pc.invert(ended)))
        self._acted.add(_grouped(acted, {"order": "count"}))
        self._rest(acted)

    def pairs(self) -> pa.Table:
        """`episode`, `agent`: all that have a row; `terminated`, `truncated`: whether ever told."""
        return self._pairs.whole()

    def acted(self) -> pa.Table:
        """`episode`, `agent`: all who acted, the dead left out; `order`: how often."""
        return self._acted.whole()

    def _pay(self, steps: pa.Table) -> None:
        names = steps["agent"].combine_chunks().dictionary_encode()
        agents = names.dictionary.to_pylist()
        # One after the other: sums of floats in another order differ in their last digits.
        sums = np.array([self.returns.get(name, 0.0) for name in agents], np.float64)
        paid = np.asarray(pc.is_valid(steps["reward"])) & np.asarray(names.is_valid())
        rewards = pc.fill_null(steps["reward"], 0.0).to_numpy()
        codes = np.asarray(names.indices.fill_null(0))
        np.add.at(sums, codes[paid], rewards[paid])
        self.returns |= dict(zip(agents, sums.tolist(), strict=True))

    def _rest(self, acted: pa.Table) -> None:
        """Whose role declares a noop and whose actions are whole numbers: how often it rested."""
        columns = [
            field.name
            for field in acted.schema
            if field.name.split("@")[0] == "action" and pa.types.is_integer(field.type)
        ]
        agents = pc.unique(acted["agent"]).to_pylist() if columns else []
        noops = {agent: self._noop_of(agent) for agent in agents}
        whole = {agent: noop for agent, noop in noops.items() if isinstance(noop, int)}
        for column in columns if whole else ():
            rows = acted.filter(pc.is_valid(acted[column]))
            known = whole.keys() & set(pc.unique(rows["agent"]).to_pylist())
            self.idle.update(dict.fromkeys(known, 0))
            for noop in set(whole.values()):
                still = rows.filter(pc.equal(rows[column], noop))["agent"]
                for entry in still.value_counts().to_pylist():
                    if whole.get(entry["values"]) == noop:
                        self.idle[entry["values"]] += entry["counts"]


class Groups:
    """Rows by episode and agent of which equal ones are made one.

    Args:
        folds: by column, how two rows of the same pair become one: `max`, `sum`.
    """

    def __init__(self, folds: Mapping[str, str]) -> None:
        self._folds = folds
        self._waiting: list[pa.Table] = []

    def add(self, groups: pa.Table) -> None:
        """Puts more pairs to those that are there."""
        self._waiting.append(groups)
        if len(self._waiting) >= FOLD:
            self._waiting = [self.whole()]

    def whole(self) -> pa.Table:
        """A row for each pair."""
        if not self._waiting:
            return pa.table({name: pa.nulls(0) for name in (*KEYS, *self._folds)})
        return _grouped(pa.concat_tables(self._waiting), self._folds)


def _grouped(table: pa.Table, folds: Mapping[str, str]) -> pa.Table:
    """A row for each pair, with the names that the columns had."""
    columns = table.select([*KEYS, *folds])
    found = columns.group_by(list(KEYS), use_threads=False).aggregate(list(folds.items()))
    return found.select([*KEYS, *map("_".join, folds.items())]).rename_columns([*KEYS, *folds])
