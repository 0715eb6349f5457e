"""What several roles see and do, in one form: padded where they differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.vector.form import Group

MASK: Final = "action_mask"


class Forms:
    """Observations and actions of several groups in one form.

    Attributes:
        observation_space, action_space: of everybody: of the only group, or padded.
        actions: how many actions there are for who has most; 0 where they aren't Discrete.
        has_masks: whether somebody may not do everything.
    Raises:
        SpecError: there is more than one group, and they can't be padded.
    """

    def __init__(self, by_number: Mapping[int, Group]) -> None:
        groups = list(by_number.values())
        self._is_one = len(groups) == 1
        bares = [_bare(group.observation_space) for group in groups]
        acts = [group.action_space for group in groups]
        self._names = {g: name for g, (_, name) in zip(by_number, bares, strict=True)}
        seen = [space for space, _ in bares]
        if not self._is_one:
            self._check(groups, seen, acts)
        numbers = [int(space.n) for space in acts if isinstance(space, spaces.Discrete)]
        self.actions = max(numbers, default=0)
        is_masked = any(group.flags for group in groups) and self.actions > 0
        self.has_masks = is_masked or len(set(numbers)) > 1
        self.action_space: Any = spaces.Discrete(self.actions) if self.actions else acts[0]
        self.observation_space: Any = seen[0] if self._is_one else _widest(seen)

    @staticmethod
    def _check(groups: list[Group], seen: list[Any], acts: list[Any]) -> None:
        flat = all(isinstance(one, spaces.Box) and len(one.shape) == 1 for one in seen)
        numbered = all(isinstance(one, spaces.Discrete) for one in acts)
        if not flat or not (numbered or all(one == acts[0] for one in acts)):
            raise SpecError(
                "roles differ in spaces that can't be padded to one",
                where="role",
                expected="flat Boxes to see, and Discrete actions or the same ones",
                seen="; ".join(f"{g.name}: {s}, {a}"[:120] for g, s, a in
                               zip(groups, seen, acts, strict=True)),
                mend="name the role that learns, and give the others policies",
            )  # fmt: skip

    def bare(self, g: int, observation: Any) -> Any:
        """An observation without its mask."""
        if not isinstance(observation, Mapping):
            return observation
        rest = {key: part for key, part in observation.items() if key != MASK}
        name = self._names[g]
        return rest if name is None else rest[name]

    def empty(self, shape: tuple[int, ...]) -> Any:
        """Zeros for so many."""
        return _zeros(self.observation_space, shape)

    def put(self, whole: Any, where: Any, g: int, seen: Any) -> None:
        """Writes observations of group g where they belong, the rest of a row being zeros."""
        _put(whole, where, self.bare(g, seen), is_padded=not self._is_one)

    def taken(self, whole: Any, where: tuple[int, ...], g: int) -> Any:
        """What stands there, as `put` takes it."""
        found = at(whole, where)
        name = self._names[g]
        return found if name is None else {name: found}


def _bare(space: Any) -> tuple[Any, str | None]:
    """A space without the mask in it; of a Dict with one other part, that part and its name."""
    if not isinstance(space, spaces.Dict):
        return space, None
    rest = {key: part for key, part in space.spaces.items() if key != MASK}
    if len(rest) == 1 and MASK in space.spaces:
        ((name, only),) = rest.items()
        return only, name
    return spaces.Dict(rest), None


def _widest(seen: list[spaces.Box]) -> spaces.Box:
    width = max(space.shape[0] for space in seen)
    low, high = np.zeros(width), np.zeros(width)
    for space in seen:
        low[: space.shape[0]] = np.minimum(low[: space.shape[0]], space.low)
        high[: space.shape[0]] = np.maximum(high[: space.shape[0]], space.high)
    dtype: Any = np.result_type(*(space.dtype for space in seen))
    return spaces.Box(low.astype(dtype), high.astype(dtype), dtype=dtype)


def _zeros(space: Any, shape: tuple[int, ...]) -> Any:
    if isinstance(space, spaces.Dict):
        return {key: _zeros(part, shape) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        raise SpecError(
            "Tianshou has no tuples of observations", where="observation_space",
            seen=str(space)[:200], mend="make a Dict of them, in the environment",
        )  # fmt: skip
    return np.zeros((*shape, *(space.shape or ())), space.dtype)


def _put(whole: Any, where: Any, seen: Any, *, is_padded: bool) -> None:
    if isinstance(whole, Mapping):
        for key, part in whole.items():
            _put(part, where, seen[key], is_padded=is_padded)
        return
    rows = np.zeros_like(whole[where])
    rows[(..., slice(np.shape(seen)[-1])) if is_padded else ...] = seen
    whole[where] = rows


def native(space: Any, actions: NDArray[Any]) -> Any:
    """A policy's actions, counted from 0, as the environment counts them."""
    if isinstance(space, spaces.Discrete):
        return np.clip(actions, 0, space.n - 1) + space.start
    return actions


def each(tree: Any, change: Callable[[Any], Any]) -> Any:
    """A change made to every array of a tree of dictionaries."""
    if isinstance(tree, Mapping):
        return {key: each(part, change) for key, part in tree.items()}
    return change(tree)


def at(tree: Any, index: tuple[int, ...]) -> Any:
    """A copy of one row of every array."""
    return each(tree, lambda array: np.array(array[index]))
