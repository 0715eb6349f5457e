"""What an author writes: the state of one copy, and scalar rules over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import SpecError
from gamekeeper.kernels import draws

Field = tuple[str, str] | tuple[str, str, tuple[int, ...]]
"""Name, dtype and shape of a part of the state."""


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """The rules of one Parallel environment, written once.

    Agents that are dead or haven't joined have `s.live[i] == 0`; their actions mean nothing. A rule
    ends an agent by its flag, and lets one join by setting `s.live[i] = 1`. Time limits are the
    driver's: at `horizon` ticks whoever lives is truncated. `s.time` counts ticks.

    Args:
        name: of the environment, with its version.
        agents: in the order of actions, rewards and observations.
        observation_space: of every agent; a Box.
        action_space: of every agent; a Discrete, MultiDiscrete or Box.
        state: fields of one copy's state, of fixed shape.
        reset: `reset(s)` puts a copy at the start of an episode; all agents live unless it says so.
        step: `step(s, actions, rewards, terminated, truncated)`; rewards are [agent, term], zeros.
        observe: `observe(s, obs)` fills [agent, ...].
        mask: `mask(s, masks)` fills [agent, actions] with 0 and 1; None: all is legal.
        terms: names of the reward terms; their sum is the reward.
        horizon: ticks, None: no limit.
    """

    name: str
    agents: Sequence[str]
    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    state: Sequence[Field]
    reset: Any
    step: Any
    observe: Any
    mask: Any = None
    terms: Sequence[str] = ("reward",)
    horizon: int | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        taken = {name for name, *_ in _own_fields(len(self.agents))}
        clash = sorted(taken.intersection(name for name, *_ in self.state))
        if clash:
            raise SpecError(
                "a kernel's state has a field that every kernel has",
                where=self.name, seen=", ".join(clash), mend="give it another name",
            )  # fmt: skip

    @property
    def dtype(self) -> np.dtype[Any]:
        """One copy's state: the fields that every kernel has, then its own."""
        return np.dtype([*_own_fields(len(self.agents)), *self.state], align=True)

    @property
    def flags(self) -> int:
        """How long a mask is; 0 without one."""
        return int(self.action_space.n) if self.mask is not None else 0  # type: ignore[attr-defined]  # masks are for Discrete spaces


def _own_fields(agents: int) -> list[Any]:
    return [*draws.FIELDS, ("number", "i8"), ("time", "i8"), ("live", "i1", (agents,))]


class Copy:
    """One copy's state as plain Python sees it: attributes are Python numbers and arrays of them.

    Writing goes through to the record's memory, so the bytes are those that compiled rules see.
    """

    def __init__(self, record: Any) -> None:
        """Looks at a record, a view of one element with no dimensions."""
        from gamekeeper.kernels.rules import Plain

        object.__setattr__(self, "_record", record)
        for name in record.dtype.names:
            if record[name].ndim:
                object.__setattr__(self, name, record[name].view(Plain))

    def __getattr__(self, name: str) -> Any:
        return self._record[name].item()

    def __setattr__(self, name: str, value: Any) -> None:
        self._record[name] = value
