"""Wrappers of vector environments, by the names of `gamekeeper.wrappers`: all copies at once."""

import math
from collections.abc import Sequence
from operator import is_
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.episodes.layout import agent_name, role
from gamekeeper.interface.wrappers.normalization import NormalizedViews, Statistics
from gamekeeper.interface.wrappers.observation_wrappers import (
    MASK,
    NUMBER,
    VIEW,
    AgentNumber,
    Flatten,
    FrameStack,
)
from gamekeeper.interface.wrappers.reward_wrappers import ClippedRewards
from gamekeeper.kernels.scaled_rows import scaling
from gamekeeper.vector.transformed_vector import (
    EVERYBODY,
    BatchTransform,
    Columns,
    Flags,
    TransformedVector,
)
from gamekeeper.vector.vector_form import ArrayLeaf, Space, VectorGroup, built, changed, getter

__all__ = [
    "agent_id",
    "clip_actions",
    "clip_rewards",
    "flatten_observations",
    "frame_stack",
    "normalize",
]
MOVES: Final = 64
"""Moves of a window over frames before they are copied to the start of their row."""


def agent_id(venv: Any) -> TransformedVector:
    """Shows each agent its number, one-hot; see `gamekeeper.wrappers.agent_id`.

    Agents are numbered in the order of the environment's `possible_agents`.
    """
    return TransformedVector(venv, NumbersInBatch())


def frame_stack(venv: Any, frames: int, *, padding: str = "first") -> TransformedVector:
    """Shows each agent its last decisions' frames; see `gamekeeper.wrappers.frame_stack`."""
    return TransformedVector(venv, FramesInBatch(frames, padding))


def flatten_observations(venv: Any) -> TransformedVector:
    """Shows vectors of float32; see `gamekeeper.wrappers.flatten_observations`."""
    return TransformedVector(venv, FlatBatch())


def normalize(
    venv: Any,
    statistics: Statistics,
    *,
    learning: bool = False,
    rewards: bool = True,
    gamma: float = 0.99,
) -> TransformedVector:
    """Shows and pays in units of their spread; see `gamekeeper.wrappers.normalize`.

    While statistics are learnt, all decisions of a step are added at once, before the step's
    observations and rewards are scaled.
    """
    return TransformedVector(
        venv, NormalizedBatch(statistics, learning=learning, rewards=rewards, gamma=gamma)
    )


def clip_rewards(venv: Any, low: float = -1.0, high: float = 1.0) -> TransformedVector:
    """Clips what a step pays an agent; see `gamekeeper.wrappers.clip_rewards`."""
    return TransformedVector(venv, ClippedRewardBatch(low, high))


def clip_actions(venv: Any) -> TransformedVector:
    """Clips actions of Box spaces to their bounds; see `gamekeeper.wrappers.clip_actions`."""
    return TransformedVector(venv, ClippedActionBatch())


class NumbersInBatch(BatchTransform):
    """Use `agent_id`."""

    def bind(self, venv: Any) -> None:
        """Numbers the agents, and works out what is added to each group's observations."""
        agents = [place.agent for place in venv.seen.layout.order]
        single = AgentNumber()
        single.bind(SimpleNamespace(possible_agents=agents))
        self._spaces: dict[str, Space] = {}
        self._added: list[Any] = []
        for group in venv.groups:
            for agent in group.agents:
                space = single.observation_space(agent, group.observation_space)
                self._spaces[group.name] = space
            added: list[Any] = [
                single.planes.get(agent, single.rows[agent]) for agent in group.agents
            ]
            self._added.append(np.stack(added))
        self._whole: dict[int, tuple[Any, WholeRows]] = {}
        self._is_blanked = True
        self._is_joined = [group.agents[0] in single.planes for group in venv.groups]

    def observation_space(self, group: VectorGroup) -> Space:
        """The space with a place for the number."""
        return self._spaces[group.name]

    def shown(self, g: int, seen: Any, there: Flags | None, columns: Columns) -> Any:
        """Observations with numbers; where arrays are overwritten, numbers are written once."""
        if not (self.reuses and self._is_joined[g] and isinstance(columns, slice)):
            return super().shown(g, seen, there, columns)
        if self._is_blanked or g not in self._whole:
            found = self.observations(g, seen, columns, self.lead[g])
            self._whole[g] = found, WholeRows(found[..., : seen.shape[-1]])
        else:
            found, views = self._whole[g]
            views.write(seen)
        self._is_blanked = there is not None  # which takes numbers away too
        return found

    def observations(self, g: int, seen: Any, columns: Columns, lead: tuple[int, ...]) -> Any:
        """Observations with numbers behind, or beside them."""
        added = self._added[g][columns]
        if self._is_joined[g]:
            found = np.empty((*seen.shape[:-1], seen.shape[-1] + added.shape[-1]), seen.dtype)
            WholeRows(found[..., : seen.shape[-1]]).write(seen)
            found[..., seen.shape[-1] :] = added
            return found
        parts = dict(seen) if isinstance(seen, dict) else {VIEW: seen}
        parts = {key: changed(part, np.copy) for key, part in parts.items()}
        return {**parts, NUMBER: np.broadcast_to(added, (*lead, added.shape[-1])).copy()}


class FramesInBatch(BatchTransform):
    """Use `frame_stack`."""

    remembers = True

    def __init__(self, frames: int, padding: str) -> None:
        self._single, self._frames = FrameStack(frames, padding), frames
        self._is_zeros = padding == "zeros"

    def bind(self, venv: Any) -> None:
        """Reads the parts of the observations."""
        self._envs, self._groups, self._is_aec = venv.num_envs, venv.groups, venv.api == "aec"
        self.begin()

    def observation_space(self, group: VectorGroup) -> Space:
        """The space of so many frames."""
        return self._single.observation_space(group.agents[0], group.observation_space)

    def begin(self) -> None:
        """Forgets all frames."""
        self._parts, self._known = [], []
        self._are_known = [False for _ in self._groups]
        for group in self._groups:
            shape = self._envs, len(group.agents)
            self._known.append(np.zeros(shape, bool))
            self._parts.append([FramesOfPart(leaf, self._frames, shape) for leaf in group.observed])

    def forget(self, envs: Flags) -> None:
        """Forgets the frames of these sub-environments."""
        self._are_known = [False for _ in self._groups]
        for known in self._known:
            known &= ~envs[:, None]

    def decided(self, g: int, seen: Any, deciding: Flags, columns: Columns) -> None:
        """Makes place for the next frame, behind those that were decided by."""
        envs = np.flatnonzero(deciding) if self._is_aec else None
        at = EVERYBODY if isinstance(columns, slice) else (envs, columns[envs])
        for part in self._parts[g]:
            part.move(at)

    def final(self, g: int, seen: Any, envs: Any, agents: int) -> Any:
        """Last observations behind the frames of the decisions."""
        found = [part.behind(seen, envs) for part in self._parts[g]]
        return built(self._groups[g].observation_space, iter(found))

    def shown(self, g: int, seen: Any, there: Flags | None, columns: Columns) -> Any:
        """The last decisions' frames and the present one."""
        at: Any = EVERYBODY if isinstance(columns, slice) else (np.arange(self._envs), columns)
        if not self._are_known[g]:
            self._take_first(g, seen, there, columns, at)
        found = [part.shown(seen, at, reuses=self.reuses) for part in self._parts[g]]
        return built(self._groups[g].observation_space, iter(found))

    def _take_first(
        self, g: int, seen: Any, there: Flags | None, columns: Columns, at: Any
    ) -> None:
        """Fills the frames before the first one of agents that are new."""
        known = self._known[g]
        new: Any = ~known[at] if there is None else there & ~known[at]
        if not np.count_nonzero(new):
            return
        first: Any = new
        if not isinstance(columns, slice):
            rows = np.flatnonzero(new)
            first = rows, columns[rows]
        elif new.all():
            first = new = EVERYBODY
        known[first] = True
        self._are_known[g] = bool(known.all())
        for part in self._parts[g]:
            part.begin(seen, new, first, zeros=self._is_zeros)


class FramesOfPart:
    """Frames of one array of observations, [env, agent, ..., frames], the present one last.

    They are a window on a longer row of numbers. Where it moves on by a frame, every agent's frames
    move to the front at once, and none is copied; only the last place is written.
    """

    def __init__(self, leaf: ArrayLeaf, frames: int, lead: tuple[int, ...]) -> None:
        self._get, self._is_mask = getter(leaf.path), leaf.path[-1:] == (MASK,)
        self._count = 1 if self._is_mask else frames
        self._gets_axis = len(leaf.shape) in (0, 2) and not self._is_mask
        own = (*leaf.shape, 1) if self._gets_axis else leaf.shape
        self._size, self._first = own[-1], 0
        self._shape = *lead, *own[:-1], self._count * self._size
        self._row: Any = np.zeros(math.prod(self._shape) + MOVES * self._size, leaf.dtype)
        self._looks: dict[int, tuple[Any, WholeRows]] = {}
        self._look()

    def _look(self) -> None:
        found = self._looks.get(self._first)
        if found is None:
            last = self._first + math.prod(self._shape)
            window = self._row[self._first : last].reshape(self._shape)
            found = self._looks[self._first] = window, WholeRows(window[..., -self._size :])
        self._window, self._present = found

    def _frame(self, seen: Any) -> Any:
        part = self._get(seen)
        return part[..., None] if self._gets_axis else part

    def move(self, at: Any) -> None:
        """Makes place for the next frame of some agents, or of all."""
        if self._count == 1:
            return
        if isinstance(at, slice):
            if self._first == MOVES * self._size:
                raw = memoryview(self._row.view(np.uint8))  # moves bytes; NumPy would copy twice
                raw[: self._window.nbytes] = raw[self._first * self._row.itemsize :]
                self._first = 0
            self._first += self._size
            self._look()
        else:
            self._window[at] = np.roll(self._window[at], -self._size, -1)

    def begin(self, seen: Any, new: Flags, at: Any, *, zeros: bool) -> None:
        """Fills the places before the first frame of some agents."""
        if self._count > 1:
            frames = self._window.reshape(*self._shape[:-1], self._count, self._size)
            frames[at] = 0 if zeros else self._frame(seen)[new][..., None, :]

    def shown(self, seen: Any, at: Any, *, reuses: bool) -> Any:
        """The frames, with the present one."""
        frame = self._frame(seen)
        if isinstance(at, slice):
            self._present.write(frame)
            return self._window if reuses else self._window.copy()
        self._window[(*at, ..., slice(-self._size, None))] = frame
        return self._window[at]

    def behind(self, seen: Any, envs: Any) -> Any:
        """Frames of some sub-environments, others behind them as present ones."""
        found = self._window[envs]
        WholeRows(found[..., -self._size :]).write(self._frame(seen))
        return found


class WholeRows:
    """Places in an array with short last axes, which are written a whole row of numbers at a time.

    NumPy copies a row as one element several times as fast as number by number.
    """

    def __init__(self, into: Any) -> None:
        size = into.shape[-1] * into.itemsize
        self._is_whole = size > 0 and into.strides[-1] == into.itemsize
        self._into, self._kind = into, np.dtype(f"V{size}")
        self._wide = into.view(self._kind) if self._is_whole else into

    def write(self, rows: Any) -> None:
        """Writes an array of the same shape."""
        into = self._into
        if self._is_whole and rows.dtype == into.dtype and rows.strides[-1] == rows.itemsize:
            into, rows = self._wide, rows.view(self._kind)
        into[...] = rows


class FlatBatch(BatchTransform):
    """Use `flatten_observations`."""

    def bind(self, venv: Any) -> None:
        """Takes the spaces."""
        self._spaces = [group.observation_space for group in venv.groups]
        self.shows = any(self.observation_space(g) != g.observation_space for g in venv.groups)

    def observation_space(self, group: VectorGroup) -> Space:
        """A vector, beside the mask where there is one."""
        single = Flatten()
        single.bind(None)
        return single.observation_space(group.agents[0], group.observation_space)

    def observations(self, g: int, seen: Any, columns: Columns, lead: tuple[int, ...]) -> Any:
        """The parts in one vector."""
        space = self._spaces[g]
        if not (isinstance(space, spaces.Dict) and MASK in space.spaces):
            return _flat(space, seen, len(lead))
        rest = spaces.Dict({key: part for key, part in space.spaces.items() if key != MASK})
        return {VIEW: _flat(rest, seen, len(lead)), MASK: seen[MASK].copy()}


def _flat(space: Space, seen: Any, lead: int) -> Any:
    """Values of a space as Gymnasium's `flatten` orders them, [*lead, number] of float32."""
    if isinstance(space, spaces.Dict | spaces.Tuple):
        keys: Any = space.spaces if isinstance(space, spaces.Dict) else range(len(space.spaces))
        inside: Any = space.spaces
        return np.concatenate([_flat(inside[key], seen[key], lead) for key in keys], -1)
    shape = seen.shape[:lead]
    if isinstance(space, spaces.Discrete):
        return _one_hot(seen - space.start, int(space.n))
    if isinstance(space, spaces.MultiDiscrete):
        sizes, numbers = space.nvec.ravel(), (seen - space.start).reshape(*shape, -1)
        return np.concatenate([_one_hot(numbers[..., i], n) for i, n in enumerate(sizes)], -1)
    return seen.reshape(*shape, -1).astype(np.float32, copy=False)


def _one_hot(numbers: Any, size: int) -> Any:
    """Blank places may hold a number that isn't in the space: they have no flag."""
    return (numbers[..., None] == np.arange(size)).astype(np.float32)


class NormalizedBatch(BatchTransform):
    """Use `normalize`."""

    def __init__(
        self, statistics: Statistics, *, learning: bool, rewards: bool, gamma: float
    ) -> None:
        self._statistics, self._gamma, self._pays = statistics, gamma, rewards
        self.remembers = self.reads = learning

    def bind(self, venv: Any) -> None:
        """Takes the agents."""
        self._envs, self._groups = venv.num_envs, venv.groups
        self._roles = [_by_role(group.agents) for group in venv.groups]
        self._known: dict[tuple[int, str, bool], Any] = {}
        self._ready: dict[tuple[int, str], Any] = {}
        self.begin()

    def observation_space(self, group: VectorGroup) -> Space:
        """The space with its float parts within +-clip."""
        single = NormalizedViews(self._statistics, learning=False, gamma=self._gamma)
        found = [single.observation_space(a, group.observation_space) for a in group.agents]
        return found[0]

    def begin(self) -> None:
        """Begins new returns."""
        self._returns = [np.zeros((self._envs, len(group.agents))) for group in self._groups]

    def forget(self, envs: Flags) -> None:
        """Begins new returns in these sub-environments."""
        for returns in self._returns if self.remembers else ():
            returns[envs] = 0

    def decided(self, g: int, seen: Any, deciding: Flags, columns: Columns) -> None:
        """Adds decisions to the statistics."""
        for name, agent, members in self._roles[g]:
            rows = deciding & (members if deciding.ndim == 2 else members[columns])
            parts = self._statistics.seen[name]
            self._statistics.add_rows(agent, {k: (seen[k] if k else seen)[rows] for k in parts})

    def rewards(self, g: int, rewards: Any, acted: Flags | None) -> Any:
        """Rewards in units of the spread of returns."""
        if not self._pays:
            return rewards
        statistics = self._statistics
        if acted is not None:
            returns = self._returns[g]
            returns[acted] *= self._gamma
            returns += rewards
            for _, agent, members in self._roles[g]:
                statistics.add_returns(agent, returns[acted & members])
        scaled = rewards / self._stacked(g, "", np.dtype(float), paid=True)[0]
        return scaled.clip(-statistics.clip, statistics.clip, out=scaled)

    def observations(self, g: int, seen: Any, columns: Columns, lead: tuple[int, ...]) -> Any:
        """Observations in units of their spread."""
        return self._scaled(g, seen, columns, reuses=False)

    def shown(self, g: int, seen: Any, there: Flags | None, columns: Columns) -> Any:
        """The same, in the array of the step before where it may be."""
        return self._scaled(g, seen, columns, reuses=self.reuses)

    def _scaled(self, g: int, seen: Any, columns: Columns, *, reuses: bool) -> Any:
        found = {}
        parts = seen if isinstance(seen, dict) else {"": seen}
        learnt, clip = self._statistics.of_role(self._roles[g][0][0]).parts, self._statistics.clip
        for key, part in parts.items():
            if key not in learnt:
                found[key] = changed(part, np.copy)
                continue
            mean, factor = self._stacked(g, key, part.dtype)
            are_alike = isinstance(columns, slice)
            ready = self._ready.get((g, key)) if reuses else None
            if ready is None or ready[0] is not part or ready[1] is not mean:
                scaled = np.empty(part.shape, np.float32)
                means = (mean, factor) if are_alike else (mean[0, columns], factor[0, columns])
                ready = part, mean, scaled, scaling(part, *means, clip, scaled, are_alike=are_alike)
                if reuses and are_alike:
                    self._ready[g, key] = ready
            *_, found[key], scale = ready
            scale()
        return found if isinstance(seen, dict) else found[""]

    def _stacked(self, g: int, key: str, dtype: Any, *, paid: bool = False) -> Any:
        """Means [env, agent, ...] and one over deviations, worked out once for each state.

        With `paid` deviations of returns alone. They are repeated for every sub-environment: NumPy
        is many times as quick over whole arrays as over short rows.
        """
        learnt = [self._statistics.of_role(name) for name, _, _ in self._roles[g]]
        known = self._known.get((g, key, paid))
        if known is not None and all(map(is_, known[0], learnt)):
            return known[1]
        of = np.sum([number * members for number, (*_, members) in enumerate(self._roles[g])], 0)
        if paid:
            found: Any = (np.sqrt([one.paid[0] + one.epsilon for one in learnt])[of],)
        else:
            mean = np.stack([one.parts[key][0] for one in learnt])[of]
            spread = np.sqrt(np.stack([one.parts[key][1] + one.epsilon for one in learnt]))[of]
            found = mean.astype(dtype), (1 / spread).astype(dtype)
        found = tuple(np.repeat(one[None], self._envs, 0) for one in found)
        self._known[g, key, paid] = learnt, found
        return found


def _by_role(agents: Sequence[Any]) -> list[tuple[str, Any, Flags]]:
    """Roles with one of their agents, and flags [agent] of all of them."""
    names = [role(agent_name(agent)) for agent in agents]
    found = []
    for name in dict.fromkeys(names):
        members = np.array([other == name for other in names])
        found.append((name, agents[names.index(name)], members))
    return found


class ClippedRewardBatch(BatchTransform):
    """Use `clip_rewards`."""

    def __init__(self, low: float, high: float) -> None:
        ClippedRewards(low, high)  # refuses bounds without 0
        self._low, self._high = np.float64(low), np.float64(high)

    def rewards(self, g: int, rewards: Any, acted: Flags | None) -> Any:
        """Rewards within the bounds."""
        return rewards.clip(self._low, self._high)


class ClippedActionBatch(BatchTransform):
    """Use `clip_actions`."""

    def bind(self, venv: Any) -> None:
        """Reads the bounds."""
        self._spaces = [group.action_space for group in venv.groups]

    def actions(self, g: int, actions: Any) -> Any:
        """Actions within the bounds; of other spaces as they are."""
        space = self._spaces[g]
        if not isinstance(space, spaces.Box):
            return actions
        return np.clip(actions, space.low, space.high).astype(space.dtype, copy=False)
