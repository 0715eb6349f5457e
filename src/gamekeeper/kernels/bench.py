"""One copy of a kernel for a face: its record, its arrays, and what is read of them at each step.

What a face calls at a step is looked up once, when the copy is first used: functions that know
their arguments, and of each agent those that copy its part of the arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.kernels.arrays import Arrays, arrays_of, bound
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.places import leaves
from gamekeeper.kernels.single import Single

Look: TypeAlias = Callable[[], Any]
"""Gives a new copy of what an agent is given now."""


class Bench:
    """One copy's record and arrays; copied and pickled, its parts still belong together.

    Attributes:
        records: the state, an array of one record.
        arrays: what is shown, done and paid.
        ties: what a face calls, once it has asked; never copied.
    """

    __slots__ = ("arrays", "records", "ties")

    def __init__(self, records: NDArray[Any], arrays: Arrays) -> None:
        """Takes what `arrays_of` made for one record."""
        self.records, self.arrays = records, bound(arrays, records)
        self.ties: Ties | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled it is bytes: twenty arrays one by one take ten times as long."""
        return bytes, (b"".join(part.tobytes() for part in leaves(self.arrays)),)

    def __deepcopy__(self, memo: dict[int, Any]) -> Bench:
        return Bench(self.records.copy(), _copied(self.arrays._replace(raw=None)))

    def take(self, other: Bench | bytes) -> None:
        """Becomes what another bench of the same kernel is, in its own memory."""
        if isinstance(other, bytes):
            first = 0
            for mine in leaves(self.arrays):
                found = np.frombuffer(other, mine.dtype, mine.size, first)
                mine[...] = found.reshape(mine.shape)
                first += mine.nbytes
            return
        for mine, its in zip(leaves(self.arrays), leaves(other.arrays), strict=True):
            mine[...] = its


def bench_of(kernel: Kernel) -> Bench:
    """A bench before its first episode."""
    records = kernel.records(1)
    return Bench(records, arrays_of(kernel, records))


def _copied(value: Any) -> Any:
    if isinstance(value, tuple):
        parts = [_copied(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return None if value is None else value.copy()


class Ties:
    """What a face calls at each step.

    Attributes:
        start, play, overview: of `Single`, with the arrays that they work on.
        put: where the actions of all agents stand, if each is one number and they share spaces.
        doing: by agent, the array of actions of its group, and its place there.
        seen, masks, told: by agent, what gives its observation, mask and info.
    """

    __slots__ = ("doing", "masks", "overview", "play", "put", "seen", "start", "told")

    def __init__(self, kernel: Kernel, single: Single, tables: NDArray[Any], bench: Bench) -> None:
        """Looks all of it up."""
        given = single.given(bench.records, tables, bench.arrays)
        self.start, self.play = partial(single.start, *given), partial(single.play, *given)
        self.overview = partial(single.overview, *given)
        is_aec, a = kernel.api == "aec", bench.arrays
        obs, masks, infos = (
            (a.final, a.final_masks, a.final_infos) if is_aec else (a.obs, a.masks, a.infos)
        )
        self.put: Any = None
        if not is_aec and isinstance(a.actions, np.ndarray) and a.actions.ndim == 2:
            self.put = memoryview(a.actions[0])
        self.doing: dict[str, tuple[Any, int]] = {}
        self.seen: dict[str, Look] = {}
        self.masks: dict[str, Look] = {}
        self.told: dict[str, Look] = {}
        for g, group in enumerate(kernel.groups):
            is_one = len(kernel.groups) == 1
            mine = [part if is_one else part[g] for part in (a.actions, obs, masks)]
            for k in range(group.count):
                i = group.first + k
                agent = kernel.agents[i]
                before = partial(single.look, *given, i) if is_aec else None
                self.doing[agent] = mine[0], k
                self.seen[agent] = _after(before, _viewer(group.observation_space, mine[1], k))
                self.masks[agent] = _after(before, mine[2][0, k].copy)
                self.told[agent] = _after(before, _teller(kernel, infos, i))


def _after(before: Look | None, look: Look) -> Look:
    """The look, once the rules were asked what an agent is given (of turns)."""
    if before is None:
        return look

    def after() -> Any:
        before()
        return look()

    return after


def _viewer(space: spaces.Space[Any], obs: Any, i: int) -> Look:
    """What gives an agent's own observation, out of arrays by copy and agent."""
    if isinstance(space, spaces.Dict):
        parts = {
            key: _viewer(part, getattr(obs, key), i)
            for key, part in space.spaces.items()
            if hasattr(obs, key)
        }
        return lambda: {key: look() for key, look in parts.items()}
    if space.shape:
        look: Look = obs[0, i].copy
        return look
    return partial(obs[0].__getitem__, i)


def _teller(kernel: Kernel, infos: NDArray[Any], i: int) -> Look:
    """What gives an agent's own info."""
    if not kernel.info:
        return dict
    parts: dict[str, Look] = {}
    for name in infos.dtype.names or ():
        field = infos[name][0]
        parts[name] = field[i].copy if field.ndim > 1 else field[i : i + 1].item
    return lambda: {name: look() for name, look in parts.items()}
