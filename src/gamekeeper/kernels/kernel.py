"""Kernel: the state of one sub-environment, and scalar rules over it, as an author writes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import SpecError
from gamekeeper.kernels import draws

Field: TypeAlias = tuple[str, str] | tuple[str, str, tuple[int, ...]]
"""Name, dtype and shape of a part of the state."""
Space: TypeAlias = spaces.Space[Any]
MASK = "action_mask"
MOST: Final = 2**31
"""Ticks that nobody plays."""


@dataclass(frozen=True, slots=True)
class KernelGroup:
    """Agents in a row that share their spaces.

    Attributes:
        first: number of its first agent.
        count: how many they are.
        observation_space, action_space: of each of them.
    """

    first: int
    count: int
    observation_space: Space
    action_space: Space


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """The rules of one environment, written once as scalar functions over one copy's state.

    `s` is the copy's state: the fields named here, and those that every kernel has: `s.live[i]`,
    whether agent i is there, `s.time`, how many ticks (turns, where agents take turns) were played,
    `s.ending[i]`, and `s.turn`, where agents take turns, the number of the agent in turn.

    A rule ends agent i by `terminated[i] = True` (or `truncated`), and may say why: `s.ending[i] =
    k` is the k-th of `endings`, counted from 1. It lets an agent join by `s.live[i] = 1`. Actions
    of agents that aren't live mean nothing. Whoever lives after `horizon` ticks is truncated
    ("horizon"); that, the sums of the terms, seeds and new episodes are not the rules' business.

    Rules take `s`, then the tables where there are any, then arrays of this copy alone. Where all
    agents share their spaces an array is [agent, ...], else they are a tuple of such arrays, one
    for each group of neighbours that do. An observation space that is a Dict gives a named tuple of
    arrays, by key; `action_mask` in it is filled from `mask`.

    Args:
        name: of the environment, with its version.
        agents: in the order of actions, rewards and observations.
        observation_space: of every agent, or by agent; Box, Discrete, or a Dict of these.
        action_space: of every agent, or by agent; Discrete, MultiDiscrete or Box.
        state: fields of one copy's state, of fixed shape.
        reset: `reset(s)` puts a copy at the start of an episode; everything is 0 but the random
            numbers, and all agents live unless it says so.
        step: `step(s, actions, rewards, terminated, truncated)`: a tick in which all act at once;
            rewards are [agent, term], zeros.
        act: `act(s, agent, action, rewards, terminated, truncated)`: one turn, in place of `step`;
            sets `s.turn` to the agent that acts next.
        observe: `observe(s, obs)` fills what everybody sees; of turns `observe(s, agent, obs)`,
            what one agent does.
        mask: `mask(s, masks)` fills [agent, actions] with 0 and 1 (of turns `mask(s, agent,
            flags)`, [actions]); None: all is legal.
        plays_illegal: the rules say what becomes of an action that is masked out; else it is an
            error.
        inform: `inform(s, infos)` fills what is told beside observations, of turns
            `inform(s, agent, info)`; `infos[agent].field = ...`.
        info: fields of these infos.
        overview: `overview(s, state)` fills the state that `state()` gives.
        state_space: of that; a Box.
        tables: a record (an array of one element) that all copies share and no rule changes:
            layouts, distances, numbers of the task. Rules compile for its dtype and not for its
            values.
        terms: names of the reward terms; their sum is the reward.
        endings: names of the reasons why agents end.
        horizon: ticks, None: no limit.
        metadata: of the environment, as PettingZoo has it.
    Raises:
        SpecError: the parts don't fit together.
    """

    name: str
    agents: Sequence[str]
    observation_space: Space | Mapping[str, Space]
    action_space: Space | Mapping[str, Space]
    state: Sequence[Field]
    reset: Any
    observe: Any
    step: Any = None
    act: Any = None
    mask: Any = None
    plays_illegal: bool = False
    inform: Any = None
    info: Sequence[Field] = ()
    overview: Any = None
    state_space: Space | None = None
    tables: Any = None
    terms: Sequence[str] = ("reward",)
    endings: Sequence[str] = ()
    horizon: int | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        taken = {name for name, *_ in self._own_fields()}
        clash = sorted(taken.intersection(name for name, *_ in self.state))
        if clash:
            self._refuse(
                "a kernel's state has a field that every kernel has",
                actual=", ".join(clash),
                fix="give it another name",
            )
        if (self.step is None) == (self.act is None):
            self._refuse(
                "a kernel has either ticks or turns",
                expected="step (all act at once) or act (one after the other)",
                actual="both" if self.step is not None else "neither",
            )
        if self.act is not None and len(self.groups) > 1:
            self._refuse(
                "agents that take turns have different spaces",
                expected="one observation space and one action space",
                actual=f"{len(self.groups)} kinds of agents",
                fix="pad the smaller spaces, and mask what they don't have",
            )
        if self.horizon is not None and self.horizon < 1:
            self._refuse(
                "a horizon is no number of ticks",
                expected="a whole number above 0, or None",
                actual=repr(self.horizon),
            )
        for group in self.groups:
            self._check_spaces(group)

    @property
    def api(self) -> str:
        """`parallel` or `aec`."""
        return "aec" if self.step is None else "parallel"

    @cached_property
    def groups(self) -> tuple[KernelGroup, ...]:
        """Neighbours that share their spaces."""
        found: list[KernelGroup] = []
        for i, agent in enumerate(self.agents):
            kinds = (
                self._space_of(self.observation_space, agent),
                self._space_of(self.action_space, agent),
            )
            last = found[-1] if found else None
            if last and kinds == (last.observation_space, last.action_space):
                found[-1] = KernelGroup(last.first, last.count + 1, *kinds)
            else:
                found.append(KernelGroup(i, 1, *kinds))
        return tuple(found)

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """One copy's state: the fields that every kernel has, then its own."""
        return np.dtype([*self._own_fields(), *self.state], align=True)

    @cached_property
    def info_dtype(self) -> np.dtype[Any]:
        """One agent's info; a byte that nobody fills where there is none."""
        return np.dtype(list(self.info), align=True) if self.info else np.dtype(np.int8)

    @property
    def limit(self) -> int:
        """Value of `s.limit` in every sub-environment: the horizon, 0 where there is none.

        It is state and no constant of the rules, so that all horizons share their compiled code.
        """
        return 0 if self.horizon is None or self.horizon >= MOST else self.horizon

    def records(self, num_envs: int) -> np.ndarray[Any, Any]:
        """The state of so many copies, before their first episode."""
        records = np.zeros(num_envs, self.dtype)
        records["limit"] = self.limit
        return records

    def observation_of(self, agent: str) -> Space:
        """The observation space of an agent."""
        space: Space = self._space_of(self.observation_space, agent)
        return space

    def action_of(self, agent: str) -> Space:
        """The action space of an agent."""
        space: Space = self._space_of(self.action_space, agent)
        return space

    def flags(self, group: KernelGroup) -> int:
        """Length of a group's masks; 0 without one."""
        if self.mask is None:
            return 0
        space = group.action_space
        return int(space.nvec.sum()) if isinstance(space, spaces.MultiDiscrete) else int(space.n)  # type: ignore[attr-defined]  # _check_spaces has seen to it

    def _own_fields(self) -> list[Any]:
        agents = (len(self.agents),)
        own: list[Any] = [
            *draws.FIELDS,
            ("number", "i8"),
            ("time", "i8"),
            ("limit", "i4"),
            ("live", "i1", agents),
            ("ending", "i1", agents),
        ]
        if self.step is None:
            own += [("turn", "i8"), ("ticks", "i8"), ("acted", "i1", agents), ("due", "i1", agents)]
        return own

    def _space_of(self, spaces_: Any, agent: str) -> Any:
        is_one = isinstance(spaces_, spaces.Space)  # asked first: a Dict space is a mapping too
        return spaces_ if is_one else spaces_[agent]

    def _check_spaces(self, group: KernelGroup) -> None:
        seen, done = group.observation_space, group.action_space
        parts = list(seen.spaces.values()) if isinstance(seen, spaces.Dict) else [seen]
        if not all(isinstance(part, spaces.Box | spaces.Discrete) for part in parts):
            self._refuse(
                "an observation has a part of no fixed shape",
                expected="Box, Discrete, or a Dict of these",
                actual=str(seen)[:200],
            )
        discrete = spaces.Discrete | spaces.MultiDiscrete
        fits = discrete if self.mask is not None else discrete | spaces.Box
        if not isinstance(done, fits):
            self._refuse(
                "rules can't take such actions" + (" with a mask" if self.mask is not None else ""),
                expected="Discrete or MultiDiscrete, without a mask also Box",
                actual=str(done)[:200],
            )

    def _refuse(self, what: str, **parts: Any) -> None:
        raise SpecError(what, where=self.name, **parts)

    def __deepcopy__(self, memo: object) -> Kernel:
        """A kernel never changes, so copies of it are itself."""
        return self
