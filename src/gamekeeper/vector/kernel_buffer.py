"""Buffer of a batch's outputs and actions, step after step, until they become rows.

Buffers are [slot, copy, ...]. What agents are given at slot t they answer in the step after it, so
that of the last slot only one half is known. What the step's arrays don't hold any more, since an
episode ended in it, stands apart, row by row.
"""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.kernels.batch import Batch
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.rule_parts import UNNAMED

MOST_ROWS: Final = 65_536
"""Rows that wait to become columns together."""
MOST_BYTES: Final = 64 << 20
"""Bytes of the buffers; a step that needs more waits alone."""
TERMINATED, TRUNCATED = 1, 2

Arrays = dict[str, NDArray[Any]]


@dataclass(slots=True)
class SideRows:
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


class KernelBuffer:
    """Outputs and actions of a batch; `TickBuffer` and `TurnBuffer` know the end of a step.

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
        self.filled, self.apart = 0, SideRows()
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
        """Last observations of these agents, by the names of `given`, row by row."""
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
        self.filled, self.apart = 0, SideRows()

    def _overview(self) -> None:
        if self.kernel.overview is not None:
            self.batch.overview()

    def _before(self) -> Any:
        """Copies of arrays that are needed once they are overwritten."""

    def _keep(self, t: int, over: NDArray[np.intp], before: Any) -> None:
        """Keeps what the step ended."""
        raise NotImplementedError

    def _show(self, t: int, began: NDArray[np.bool_]) -> None:
        """Puts the present outputs into slot t."""
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
        """Number of the ending of each agent, for the episodes of these sub-environments."""
        codes = self.batch.records["ending"][e].astype(np.int16)
        kind = self.kind[e].astype(np.int16)
        codes[codes == UNNAMED] = 0
        codes = np.where(codes == 0, UNNAMED + kind, codes)
        codes[kind == 0] = 0
        return {"endings": codes, "has_acted": self.has_acted[e]}


class TickBuffer(KernelBuffer):
    """Buffer of kernels in which all act at once: a row for every live agent at a tick.

    Beside what the batch shows stands who has a row (`present`).
    """

    given_more = (("present", "?"), ("began", "?"))

    def __init__(self, batch: Batch, *, is_next: bool) -> None:
        super().__init__(batch, is_next=is_next)
        a = batch.arrays
        for name, array in (("cumulative_reward", a.rewards), ("ended", a.live), ("cut", a.live)):
            self.given[name] = np.zeros((self.slots + 1, *array.shape), array.dtype)

    def _before(self) -> NDArray[np.bool_]:
        live: NDArray[np.bool_] = self.batch.arrays.live.copy()
        return live

    def _keep(self, t: int, over: NDArray[np.intp], before: Any) -> None:
        a, given = self.batch.arrays, self.given
        self.was_live = before
        self.has_acted |= before & given["open"][t][:, None]
        if not len(over):
            return
        over = over[a.ended[over]]
        m, i = np.nonzero(a.last[over])
        e = over[m]
        clock = given["clock"][t] + 1
        put(
            self.apart.rows,
            episode=given["episode"][t, e],
            turn=clock[e],
            agent=i.astype(np.int32),
            cumulative_reward=a.rewards[e, i],
            terminated=a.terminated[e, i],
            truncated=a.truncated[e, i],
            **self.finals(e, i),
        )
        episode = given["episode"][t, over]
        put(self.apart.ends, episode=episode, turns=clock[over], **self.end_of(over))
        if "state" in given:
            put(self.apart.states, episode=episode, turn=clock[over], state=a.state[over])

    def _show(self, t: int, began: NDArray[np.bool_]) -> None:
        super()._show(t, began)
        a, given = self.batch.arrays, self.given
        if not t:
            given["present"][0], given["began"][0] = a.live, True
            return
        goes_on = ~began[:, None]
        given["cumulative_reward"][t] = np.where(goes_on, a.rewards, 0.0)
        given["ended"][t] = a.terminated & goes_on
        given["cut"][t] = a.truncated & goes_on
        gone = (self.was_live | a.terminated | a.truncated) & goes_on
        given["present"][t] = a.live | gone
        given["began"][t] = began


class TurnBuffer(KernelBuffer):
    """Buffer of kernels with turns: a row for the actor, and for agents that a turn touched.

    Beside what the batch shows stands who has a row though it isn't its turn (`news`). Who ends has
    a last turn, in which nothing is done: these stand apart.
    """

    given_more = (("news", "?"), ("cumulative_reward", "f8"))

    def __init__(self, batch: Batch, *, is_next: bool, in_turn_first: bool = False) -> None:
        """As of all; `in_turn_first`: the agent in turn leaves before others that end."""
        super().__init__(batch, is_next=is_next)
        self.in_turn_first = in_turn_first
        self.sums = np.zeros((self.copies, self.agents))
        self.places = np.zeros((self.copies, self.agents), np.int64)
        self.terms = np.zeros_like(batch.arrays.terms)
        self.everybody = np.arange(self.copies)

    def _begun(self, began: NDArray[np.bool_]) -> None:
        super()._begun(began)
        self.sums[began] = 0.0
        self.terms[began] = 0.0
        self.places[began] = np.arange(self.agents)

    def _before(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        return self.batch.arrays.live.copy(), self.batch.arrays.turn.astype(np.int64)

    def _keep(self, t: int, over: NDArray[np.intp], before: Any) -> None:
        a, given = self.batch.arrays, self.given
        live, actor = before
        is_open = given["open"][t]
        given["cumulative_reward"][t] = self.sums[self.everybody, actor]
        self.has_acted[self.everybody[is_open], actor[is_open]] = True
        self.sums[self.everybody, actor] = 0.0
        self.sums += a.rewards
        self.terms[...] = a.terms
        flags = (a.terminated | a.truncated) & is_open[:, None]
        joined = (a.live | flags) & ~live & is_open[:, None]
        if joined.any():
            late = (given["clock"][t].astype(np.int64) + 1) * self.agents
            self.places = np.where(joined, late[:, None] + np.arange(self.agents), self.places)
        self.count = flags.sum(1)
        self.news = joined & ~flags.any(1)[:, None]
        if flags.any():
            self._bury(t, flags, joined)
        over = over[a.ended[over]]
        if len(over):
            turns = given["clock"][t, over] + 1 + self.count[over].astype(np.int32)
            episode = given["episode"][t, over]
            put(self.apart.ends, episode=episode, turns=turns, **self.end_of(over))
            if "state" in given:
                put(self.apart.states, episode=episode, turn=turns, state=a.state[over])

    def _bury(self, t: int, flags: NDArray[np.bool_], joined: NDArray[np.bool_]) -> None:
        """The last turns of those who ended, in the order of the roster."""
        a, given = self.batch.arrays, self.given
        places = np.where(flags, self.places, np.iinfo(np.int64).max)
        if self.in_turn_first:
            then = self.batch.records["turn"]
            is_first = np.flatnonzero(flags[self.everybody, then])
            places[is_first, then[is_first]] = -1
        order = np.argsort(places, axis=1, kind="stable")
        rank = np.argsort(order, axis=1, kind="stable")
        e, i = np.nonzero(flags)
        turn = given["clock"][t, e] + 1 + rank[e, i].astype(np.int32)
        episode = given["episode"][t, e]
        put(
            self.apart.rows,
            episode=episode,
            turn=turn,
            agent=i.astype(np.int32),
            cumulative_reward=self.sums[e, i],
            terminated=a.terminated[e, i],
            truncated=a.truncated[e, i],
            **self.finals(e, i),
        )
        if "state" in given:
            put(self.apart.states, episode=episode, turn=turn, state=a.state[e])
        has_ended: Any = flags.any(1)
        others = (flags | joined) & has_ended[:, None] & (rank != 0)
        e, i = np.nonzero(others)
        put(
            self.apart.rows,
            light_episode=given["episode"][t, e],
            light_turn=given["clock"][t, e] + 1,
            light_agent=i.astype(np.int32),
            light_terminated=a.terminated[e, i],
            light_truncated=a.truncated[e, i],
        )

    def _show(self, t: int, began: NDArray[np.bool_]) -> None:
        super()._show(t, began)
        given = self.given
        if not t:
            given["news"][0] = given["live"][0]
            return
        given["clock"][t] += np.where(began, 0, self.count).astype(np.int32)
        given["news"][t] = np.where(began[:, None], given["live"][t], self.news)


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
