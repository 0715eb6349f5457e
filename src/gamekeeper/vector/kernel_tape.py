"""What a batch gave and was told, step after step, until it becomes rows.

Buffers are [slot, copy, ...]. What agents are given at slot t they answer in the step after it, so
that of the last slot only one half is known. What the step's arrays don't hold any more, since an
episode ended in it, stands apart, row by row.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.parts import UNNAMED

MOST_ROWS: Final = 65_536
"""Rows that wait to become columns together."""
MOST_BYTES: Final = 64 << 20
"""Of the buffers; a step that needs more waits alone."""
TERMINATED, TRUNCATED = 1, 2

Arrays = dict[str, NDArray[Any]]


@dataclass(slots=True)
class Apart:
    """Rows beside the buffers: what was given as an episode, or one agent, ended.

    Attributes:
        rows: columns by name, parts of them step after step.
        starts: of episodes, likewise.
        ends: of episodes, likewise.
        states: of turns that no slot has, likewise.
    """

    rows: dict[str, list[NDArray[Any]]] = field(default_factory=dict)
    starts: dict[str, list[NDArray[Any]]] = field(default_factory=dict)
    ends: dict[str, list[NDArray[Any]]] = field(default_factory=dict)
    states: dict[str, list[NDArray[Any]]] = field(default_factory=dict)


def put(parts: dict[str, list[NDArray[Any]]], **columns: NDArray[Any]) -> None:
    """Adds rows."""
    for name, column in columns.items():
        parts.setdefault(name, []).append(column)


class Tape:
    """The buffers of a batch; see `TickTape` and `TurnTape` for what a step ends.

    Attributes:
        given: by name what was given, [slot, copy, ...].
        done: by name what was done and paid, [slot, copy, ...].
        filled: the slot of what is given now; those before are answered.
        apart: rows beside them.
    """

    given_more: tuple[tuple[str, Any], ...] = ()

    def __init__(self, batch: Batch, *, is_next: bool) -> None:
        """Takes a batch that hasn't begun, and whether it resets in the step after."""
        self.batch, self.kernel, self.is_next = batch, batch.kernel, is_next
        self.copies, self.agents = len(batch.records), len(batch.kernel.agents)
        per_step = self.copies * (self.agents if self.kernel.api == "parallel" else 1)
        shown = self._shown()
        size = sum(array.nbytes for array in shown.values()) + 1
        self.slots = max(1, min(4096, MOST_ROWS // per_step, MOST_BYTES // size))
        self.given = {
            name: np.zeros((self.slots + 1, *array.shape), array.dtype)
            for name, array in shown.items()
        }
        each = (self.slots + 1, self.copies)
        for name, kind in (("episode", "i4"), ("clock", "i4"), ("open", "?"), *self.given_more):
            wide = name in ("present", "news", "ended", "cut")
            self.given[name] = np.zeros((*each, self.agents) if wide else each, kind)
        a = batch.arrays
        self.paid: Arrays = {"rewards": a.rewards, "terms": a.terms, **self._acted()}
        self.done = {
            name: np.zeros((self.slots, *array.shape), array.dtype)
            for name, array in self.paid.items()
        }
        self.filled, self.apart = 0, Apart()
        self.has_acted = np.zeros((self.copies, self.agents), bool)
        self.kind = np.zeros((self.copies, self.agents), np.int8)

    # -- the batch's arrays by name

    def _shown(self) -> Arrays:
        a, kernel = self.batch.arrays, self.kernel
        found = {"live": a.live, **by_group(kernel, "obs", a.obs)}
        if kernel.mask is not None:
            found |= by_group(kernel, "mask", a.masks)
        if kernel.info:
            found["infos"] = a.infos
        if kernel.overview is not None:
            found["state"] = a.state
        if kernel.api == "aec":
            found["turn"] = a.turn
        return found

    def _acted(self) -> Arrays:
        return by_group(self.kernel, "action", self.batch.arrays.actions)

    def finals(self, e: NDArray[np.intp], i: NDArray[np.intp]) -> Arrays:
        """What these agents were given last, by the names of `given`, row by row."""
        a, kernel = self.batch.arrays, self.kernel
        found: Arrays = {"infos": a.final_infos[e, i]} if kernel.info else {}
        whole = by_group(kernel, "obs", a.final)
        if kernel.mask is not None:
            whole |= by_group(kernel, "mask", a.final_masks)
        for name, array in whole.items():
            group = kernel.groups[group_of(name)]
            mine = (i >= group.first) & (i < group.first + group.count)
            found[name] = array[e[mine], i[mine] - group.first]
        return found

    # -- steps

    def begin(self) -> None:
        """Every copy has begun its first episode."""
        everybody = np.ones(self.copies, bool)
        self._overview()
        self._show(0, everybody)
        self.given["open"][0] = True
        self._begun(everybody)

    def step(self) -> None:
        """Plays one step of the batch, and keeps what came of it.

        Raises:
            ActionError: an action isn't legal; nothing has changed.
        """
        batch, a, t = self.batch, self.batch.arrays, self.filled
        was_over = a.over.copy()
        before = self._before()
        batch.play()
        for name, array in self.paid.items():
            self.done[name][t] = array
        flags = a.terminated | a.truncated
        if flags.any():
            self.kind[flags] = np.where(a.terminated, TERMINATED, TRUNCATED)[flags]
        self._overview()
        over = np.flatnonzero(a.over)
        self._keep(t, over, before)
        if len(over) and not self.is_next:
            batch.restart()
            if self.kernel.overview is not None:
                batch.overview()
        began = was_over if self.is_next else a.ended.copy()
        self._show(t + 1, began)
        self.given["open"][t + 1] = ~a.over
        self.filled = t + 1
        if began.any():
            self._begun(began)

    def carry(self) -> None:
        """The answered slots are taken; what is given now stands in the first one."""
        for array in self.given.values():
            array[0] = array[self.filled]
        self.filled, self.apart = 0, Apart()

    def _overview(self) -> None:
        if self.kernel.overview is not None:
            self.batch.overview()

    def _before(self) -> Any:
        """What of the arrays is needed once they are overwritten."""

    def _keep(self, t: int, over: NDArray[np.intp], before: Any) -> None:
        """Keeps what the step ended."""
        raise NotImplementedError

    def _show(self, t: int, began: NDArray[np.bool_]) -> None:
        """What is given now goes into slot t."""
        for name, array in self._shown().items():
            self.given[name][t] = array
        self.given["episode"][t] = self.batch.records["number"]
        self.given["clock"][t] = 0 if not t else np.where(began, 0, self.given["clock"][t - 1] + 1)

    def _begun(self, began: NDArray[np.bool_]) -> None:
        new = self.batch.records[began]
        put(self.apart.starts, episode=new["number"], seed=new["seed"])
        self.has_acted[began] = False
        self.kind[began] = 0

    def end_of(self, e: NDArray[np.intp]) -> Arrays:
        """How the episodes of these copies ended for each agent: the number of its ending."""
        codes = self.batch.records["ending"][e].astype(np.int16)
        kind = self.kind[e].astype(np.int16)
        codes[codes == UNNAMED] = 0
        codes = np.where(codes == 0, UNNAMED + kind, codes)
        codes[kind == 0] = 0
        return {"endings": codes, "has_acted": self.has_acted[e]}


def by_group(kernel: Kernel, name: str, whole: Any) -> Arrays:
    """The arrays in a tuple by group, and of Dict observations by key: `obs.0.position`."""
    parts = (whole,) if len(kernel.groups) == 1 else whole
    found: Arrays = {}
    for g, part in enumerate(parts):
        if hasattr(part, "_fields"):
            found |= {f"{name}.{g}.{key}": getattr(part, key) for key in part._fields}
        else:
            found[f"{name}.{g}"] = part
    return found


def group_of(name: str) -> int:
    """The group that an array of `by_group` is of."""
    return int(name.split(".")[1])


def key_of(name: str) -> str:
    """The key of a Dict observation that it holds; empty where it is the whole."""
    return name.split(".", 2)[2] if name.count(".") > 1 else ""
