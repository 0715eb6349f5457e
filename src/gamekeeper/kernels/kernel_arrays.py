"""The arrays that a driver works on: what copies of a kernel show, are told and are paid."""

from collections import namedtuple
from collections.abc import Callable
from functools import cache
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.kernels.kernel import MASK, Kernel, KernelGroup

Made: TypeAlias = Callable[[str, tuple[int, ...], Any], NDArray[Any]]
"""Makes an array of that name, shape and dtype."""


class Arrays(NamedTuple):
    """The arrays of a batch of copies; the first axis is the copy.

    Of ticks, what agents are given and do is [copy, agent, ...]; of turns, [copy, ...] for the
    agent in turn. Observations are an array, or named tuples of arrays, or, where agents differ in
    their spaces, tuples of these; actions and masks are an array, or a tuple of arrays.

    Attributes:
        raw: the copies' state as bytes, [copy, bytes].
        obs, masks, infos: what is given.
        rewards, terminated, truncated: [copy, agent] of the last step.
        terms: [copy, agent, term] of the last step; the rewards' own memory where there is one.
        live: [copy, agent], who is there now.
        turn: [copy], the number of the agent in turn.
        over: [copy], True where the next step begins an episode (`next_step`).
        done: [copy], how many agents acted in the last step; 0 where it only reset.
        ended: [copy], whether an episode ended in the last step.
        final, final_masks, final_infos: [copy, agent, ...], what those who ended were given last,
            of ticks what all were given in the step that ended some.
        last: [copy, agent], whose these are.
        state: [copy, ...], what `state()` gives, as `Batch.overview` left it.
    """

    raw: Any
    actions: Any
    obs: Any
    masks: Any
    infos: Any
    rewards: Any
    terms: Any
    terminated: Any
    truncated: Any
    live: Any
    turn: Any
    over: Any
    ended: Any
    final: Any
    final_masks: Any
    final_infos: Any
    last: Any
    state: Any


def arrays_of(kernel: Kernel, records: NDArray[Any], make: Made | None = None) -> Arrays:
    """The arrays of so many copies as there are records.

    Args:
        records: the copies' state, [copy].
        make: makes each array, under the names of `gk.vector`'s arrays; None: zeros.
    """
    make = make or _zeros
    envs, agents = len(records), len(kernel.agents)
    each = (envs, agents)

    def by_group(
        one: Callable[[int, KernelGroup, tuple[int, ...]], Any], *, turns: bool = True
    ) -> Any:
        parts = []
        for g, group in enumerate(kernel.groups):
            own = (envs,) if turns and kernel.api == "aec" else (envs, group.count)
            parts.append(one(g, group, own))
        return parts[0] if len(parts) == 1 else tuple(parts)

    def observed(name: str) -> Callable[[int, KernelGroup, tuple[int, ...]], Any]:
        def one(g: int, group: KernelGroup, own: tuple[int, ...]) -> Any:
            return _observed(kernel, group.observation_space, f"{name}.{g}", own, make)

        return one

    def acted(g: int, group: KernelGroup, own: tuple[int, ...]) -> Any:
        space = group.action_space
        return make(f"action.{g}.0", (*own, *(space.shape or ())), space.dtype)

    def masked(name: str) -> Callable[[int, KernelGroup, tuple[int, ...]], Any]:
        def one(g: int, group: KernelGroup, own: tuple[int, ...]) -> Any:
            return make(f"{name}.{g}", (*own, kernel.flags(group)), np.int8)

        return one

    own = (envs,) if kernel.api == "aec" else each
    rewards, count = make("rewards", each, np.float64), len(kernel.terms)
    return Arrays(
        raw=records.view(np.uint8).reshape(envs, -1),
        actions=by_group(acted),
        obs=by_group(observed("obs")),
        masks=by_group(masked("mask")),
        infos=make("infos", own, kernel.info_dtype),
        rewards=rewards,
        terms=rewards[..., None] if count == 1 else make("terms", (*each, count), np.float64),
        terminated=make("terminated", each, np.bool_),
        truncated=make("truncated", each, np.bool_),
        live=make("live", each, np.bool_),
        turn=make("turn", (envs,), np.int32),
        over=make("over", (envs,), np.bool_),
        ended=make("ended", (envs,), np.bool_),
        final=by_group(observed("final"), turns=False),
        final_masks=by_group(masked("final_mask"), turns=False),
        final_infos=make("final_infos", each, kernel.info_dtype),
        last=make("last", each, np.bool_),
        state=_state(kernel, envs, make),
    )


def _state(kernel: Kernel, envs: int, make: Made) -> NDArray[Any]:
    space = kernel.state_space
    if space is None:
        return make("state", (envs, 0), np.int8)
    return make("state", (envs, *(space.shape or ())), space.dtype)


def _observed(
    kernel: Kernel, space: spaces.Space[Any], name: str, own: tuple[int, ...], make: Made
) -> Any:
    if not isinstance(space, spaces.Dict):
        return make(f"{name}.0", (*own, *(space.shape or ())), space.dtype)
    found = {
        key: make(f"{name}.{i}", (*own, *(part.shape or ())), part.dtype)
        for i, (key, part) in enumerate(space.spaces.items())
        if not (key == MASK and kernel.mask is not None)
    }
    return leaves_class(tuple(found))(**found)


def bound(arrays: Arrays, records: NDArray[Any]) -> Arrays:
    """The arrays with these records' bytes, and terms that are the rewards where there is one."""
    has_one = arrays.terms.shape[-1] == 1
    return arrays._replace(
        raw=records.view(np.uint8).reshape(len(records), -1),
        terms=arrays.rewards[..., None] if has_one else arrays.terms,
    )


def part(arrays: Arrays, first: int, last: int) -> Arrays:
    """The copies `first` to before `last`, the same memory."""
    cut: Arrays = mapped(arrays, lambda array: array[first:last])
    return cut


def mapped(value: Any, change: Callable[[Any], Any]) -> Any:
    """The changed arrays of a tuple of arrays and such tuples, in tuples of the same types."""
    if not isinstance(value, tuple):
        return change(value)
    parts = [mapped(part, change) for part in value]
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def write_snapshot(records: NDArray[Any], snapshot: bytes) -> None:
    """Writes a snapshot over the records that it was taken of, or over as many of their kernel.

    Raises:
        SpecError: it isn't as long as they are; nothing else tells another kernel's.
    """
    if len(snapshot) != records.nbytes:
        raise SpecError(
            "a snapshot of other copies",
            where="restore",
            expected=f"{records.nbytes} bytes",
            actual=f"{len(snapshot)} bytes",
            fix="restore what snapshot() of as many sub-environments of this kernel returned",
        )
    records[...] = np.frombuffer(snapshot, records.dtype)


def _zeros(name: str, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    return np.zeros(shape, dtype)


PREFIX: Final = "Leaves__"


def leaves_class(keys: tuple[str, ...]) -> Any:
    """The named tuple with these fields.

    Raises:
        SpecError: a key is no name.
    """
    if not all(key.isidentifier() and not key.startswith("_") and "__" not in key for key in keys):
        raise SpecError(
            "rules can't name a part of an observation",
            where="observation_space",
            expected="keys that are Python names, without two underscores",
            actual=repr(keys),
            fix="name the parts of the Dict so that they are Python names",
        )
    return _made(PREFIX + "__".join(keys))


@cache
def _made(name: str) -> Any:
    found = namedtuple(name, name.removeprefix(PREFIX).split("__"))  # type: ignore[misc]  # its fields are known when it runs
    found.__module__, found.__qualname__ = __name__, name
    return found


def __getattr__(name: str) -> Any:
    """The class of that name, for who reads one back."""
    if name.startswith(PREFIX):
        return _made(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
