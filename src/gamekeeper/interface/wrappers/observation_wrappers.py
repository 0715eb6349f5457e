"""Wrappers of what agents are shown: their own number, several frames, one vector."""

from collections import deque
from collections.abc import Mapping
from operator import attrgetter
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import Space, flatten, flatten_space

from gamekeeper.errors import SpecError
from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.casting import own
from gamekeeper.interface.wrappers.transform import Transform, possible, unfit
from gamekeeper.interface.wrappers.wrapped_env import wrapped

MASK: Final = "action_mask"
VIEW: Final = "observation"
"""Key of an observation beside its mask or the agent's number, as PettingZoo's classic games."""
NUMBER: Final = "agent_id"
PADDINGS: Final = ("first", "zeros")
_FORM: Final = attrgetter("__class__", "dtype", "shape")


def agent_id(env: Any) -> Any:
    """Shows each agent its number in `possible_agents`, one-hot: a shared policy can tell them.

    Behind the numbers of a vector, in more channels of a picture (0 or the upper bound of pixels),
    under the key `agent_id` of a Dict; another form becomes a Dict with the key `observation`.

    Raises:
        SpecError: the environment doesn't name its agents before a reset.
    """
    return wrapped(env, AgentNumber())


def frame_stack(env: Any, frames: int, *, padding: str = "first") -> Any:
    """Shows each agent what it decided by at its last decisions, the newest last.

    A frame is what the agent was shown when it acted: what others do between its turns, or how
    often it is observed, adds none. Frames of a vector stand one after the other, those of a
    picture in its last axis; parts of a Dict or Tuple are stacked each, its `action_mask` isn't.

    Args:
        env: AECEnv or ParallelEnv.
        frames: how many, the present one among them.
        padding: before there are so many, `first`: the oldest again; `zeros`.
    """
    return wrapped(env, FrameStack(frames, padding))


def flatten_observations(env: Any) -> Any:
    """Shows each agent one vector of float32, as Gymnasium's `flatten` orders its parts.

    A Dict with an `action_mask` becomes a Dict of the vector, `observation`, and the mask.
    """
    return wrapped(env, Flatten())


class AgentNumber(Transform):
    """Use `agent_id`.

    Attributes:
        rows: each agent's number, one-hot.
        planes: what is put behind a Box, by agent.
    """

    def bind(self, env: Any) -> None:
        """Numbers the agents."""
        agents = possible(env, "agent_id")
        self.rows = dict(zip(agents, np.eye(len(agents), dtype=np.float32), strict=True))
        self.planes: dict[AgentId, Any] = {}

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The space with a place for the number."""
        count = len(self.rows)
        number = spaces.Box(0, 1, (count,), np.float32)
        if isinstance(space, spaces.Dict):
            if NUMBER in space.spaces:
                raise unfit(
                    "agent_id", agent, expected=f"no {NUMBER!r}", actual=space, fix="wrap it once"
                )
            return spaces.Dict({**space.spaces, NUMBER: number})
        if not isinstance(space, spaces.Box) or len(space.shape) not in (1, 3):
            return spaces.Dict({VIEW: space, NUMBER: number})
        shape = (*space.shape[:-1], count)
        tops = np.where(np.isfinite(space.high), space.high, 1)
        top = tops.max() if len(space.shape) == 3 else 1
        plane = np.zeros(shape, space.dtype)
        plane[..., int(np.argmax(self.rows[agent]))] = top
        self.planes[agent] = plane
        low = np.concatenate([space.low, np.zeros(shape, space.dtype)], -1)
        high = np.concatenate([space.high, np.full(shape, top, space.dtype)], -1)
        return spaces.Box(low, high, dtype=space.dtype)

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The observation with the agent's number."""
        plane = self.planes.get(agent)
        if plane is not None:
            return np.concatenate([seen, plane], -1)
        number = self.rows[agent].copy()
        return (
            {**seen, NUMBER: number} if isinstance(seen, Mapping) else {VIEW: seen, NUMBER: number}
        )


class FrameStack(Transform):
    """Use `frame_stack`."""

    def __init__(self, frames: int, padding: str) -> None:
        if type(frames) is not int or frames < 1 or padding not in PADDINGS:
            raise SpecError(
                "frames can't be stacked so",
                where="frame_stack",
                expected="frames=1 or more, padding='first' or 'zeros'",
                actual=f"frames={frames!r}, padding={padding!r}",
                fix="give a whole number of frames",
            )
        self._frames, self._padding = frames, padding
        self._zeros: dict[AgentId, Any] = {}
        self.begin(None)

    def begin(self, seed: int | None) -> None:
        """Forgets the frames of the last episode."""
        self._before: dict[AgentId, deque[Any]] = {}
        self._ticks = TickFrames(self._frames)

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The space of so many frames."""
        if self._padding == "zeros":
            self._zeros[agent] = _zeros(space)
        return self._stacked_space(agent, space)

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The last decisions' frames and the present one."""
        frames = [*self._before.get(agent, ()), seen]
        if len(frames) < self._frames:
            first = self._zeros[agent] if self._padding == "zeros" else frames[0]
            frames = [first] * (self._frames - len(frames)) + frames
        return _stacked(frames)

    def note(self, agent: AgentId, seen: Any, action: Any) -> Any:
        """Copy of the frame that the agent decides by."""
        return own(seen)

    def keep(self, agent: AgentId, noted: Any) -> None:
        """Adds the frame."""
        before = self._before.get(agent)
        if before is None:
            before = self._before[agent] = deque(maxlen=self._frames - 1)
        before.append(noted)

    def observations(self, seen: Mapping[Any, Any], infos: Any) -> dict[Any, Any]:
        """All agents' vectors at once, where each has one of the same form; else one by one."""
        now = self._ticks.block(seen)
        if now is None:
            self._one_by_one()
            return super().observations(seen, infos)
        frames = [*self._ticks.blocks, now]
        if len(frames) < self._frames:
            zeros = self._padding == "zeros"
            first = np.stack([self._zeros[agent] for agent in seen]) if zeros else frames[0]
            frames = [first] * (self._frames - len(frames)) + frames
        return dict(zip(seen, np.concatenate(frames, 1), strict=True))

    def notes(self, seen: Mapping[Any, Any], actions: Mapping[Any, Any]) -> Any:
        """The tick's block, where all act that were shown something."""
        if self._ticks.now is not None and actions.keys() == seen.keys():
            return self._ticks.now
        self._one_by_one()
        return super().notes(seen, actions)

    def keep_all(self, noted: Any) -> None:
        """Adds the frames."""
        if noted is self._ticks.now:
            self._ticks.blocks.append(noted)
        else:
            super().keep_all(noted)

    def _one_by_one(self) -> None:
        """Gives each agent its frames, for the rest of the episode."""
        ticks = self._ticks
        for block in ticks.blocks:
            for agent, frame in zip(ticks.agents, block, strict=True):
                self.keep(agent, frame)
        ticks.end()

    def _stacked_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        count = self._frames
        if isinstance(space, spaces.Dict):
            parts = space.spaces.items()
            return spaces.Dict(
                {k: p if k == MASK else self._stacked_space(agent, p) for k, p in parts}
            )
        if isinstance(space, spaces.Tuple):
            return spaces.Tuple([self._stacked_space(agent, part) for part in space.spaces])
        if isinstance(space, spaces.Discrete) and not space.start:
            return spaces.MultiDiscrete([int(space.n)] * count)
        if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
            return spaces.MultiDiscrete(np.tile(space.nvec, count), dtype=space.dtype)
        if isinstance(space, spaces.MultiBinary) and len(space.shape) == 1:
            return spaces.MultiBinary(space.shape[0] * count)
        if isinstance(space, spaces.Box):
            low, high = space.low, space.high
            if self._padding == "zeros":
                low, high = np.minimum(low, 0), np.maximum(high, 0)
            low, high = _stacked([low] * count), _stacked([high] * count)
            return spaces.Box(low, high, dtype=space.dtype)
        raise unfit(
            "frame_stack",
            agent,
            expected="Box, Discrete, MultiDiscrete, MultiBinary, or Dict and Tuple of them",
            actual=space,
            fix="flatten_observations first",
        )


class TickFrames:
    """Vectors of all agents in one array a tick, as long as all are there and of one form.

    Attributes:
        agents: in the order of the rows.
        now: [agent, number], the tick that isn't decided yet; None where agents differ.
        blocks: those of the last decisions.
    """

    def __init__(self, frames: int) -> None:
        self.agents: list[Any] = []
        self.now: Any = None
        self.blocks: deque[Any] = deque(maxlen=frames - 1)
        self._forms: Any = None
        self._is_over = False

    def end(self) -> None:
        """Takes no more blocks."""
        self.blocks.clear()
        self.now, self._is_over = None, True

    def block(self, seen: Mapping[Any, Any]) -> Any:
        """A new array of what all are shown; None where it can't be one."""
        if self._is_over:
            return None
        ones = list(seen.values())
        try:
            forms = list(map(_FORM, ones))
        except AttributeError:  # some are no arrays
            return None
        if self._forms is None and len(set(forms)) == 1:
            kind, _, shape = forms[0]
            if kind is np.ndarray and len(shape) == 1:
                self.agents, self._forms = list(seen), forms
        if forms != self._forms or list(seen) != self.agents:
            return None
        self.now = np.concatenate(ones).reshape(len(ones), -1)
        return self.now


def _stacked(frames: list[Any]) -> Any:
    """Frames in one, part by part; the newest mask."""
    last = frames[-1]
    if type(last) is np.ndarray and last.ndim in (1, 3):  # first, for speed
        return np.concatenate(frames, -1)
    if isinstance(last, Mapping):
        return {
            key: last[key] if key == MASK else _stacked([frame[key] for frame in frames])
            for key in last
        }
    if isinstance(last, tuple):
        return tuple(_stacked(list(parts)) for parts in zip(*frames, strict=True))
    if np.ndim(last) == 0:
        return np.array(frames, np.int64 if isinstance(last, int) else None)
    return np.stack(frames, -1) if np.ndim(last) == 2 else np.concatenate(frames, -1)


def _zeros(space: Space[Any]) -> Any:
    if isinstance(space, spaces.Dict):
        return {key: _zeros(part) for key, part in space.spaces.items()}
    if isinstance(space, spaces.Tuple):
        return tuple(_zeros(part) for part in space.spaces)
    zeros = np.zeros(space.shape or (), space.dtype)
    return zeros if space.shape else zeros[()]


class Flatten(Transform):
    """Use `flatten_observations`."""

    def bind(self, env: Any) -> None:
        """Begins without spaces."""
        self._parts: dict[AgentId, Space[Any]] = {}

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """A vector, beside the mask where there is one."""
        mask = None
        if isinstance(space, spaces.Dict) and MASK in space.spaces:
            mask = space.spaces[MASK]
            space = spaces.Dict({k: part for k, part in space.spaces.items() if k != MASK})
        self._parts[agent] = space
        try:
            flat = flatten_space(space)
        except NotImplementedError:
            flat = None
        if not isinstance(flat, spaces.Box):
            raise unfit(
                "flatten_observations",
                agent,
                expected="parts of a fixed size",
                actual=space,
                fix="leave out its Text, Graph and Sequence parts in the environment",
            )
        low, high = flat.low.astype(np.float32), flat.high.astype(np.float32)
        vector = spaces.Box(low, high, dtype=np.float32)
        return vector if mask is None else spaces.Dict({VIEW: vector, MASK: mask})

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The parts in one vector."""
        if isinstance(seen, np.ndarray) and isinstance(self._parts[agent], spaces.Box):
            return seen.astype(np.float32).reshape(-1)
        if not (isinstance(seen, Mapping) and MASK in seen):
            return self._vector(agent, seen)
        rest = {key: part for key, part in seen.items() if key != MASK}
        return {VIEW: self._vector(agent, rest), MASK: seen[MASK]}

    def _vector(self, agent: AgentId, seen: Any) -> Any:
        return np.asarray(flatten(self._parts[agent], seen)).astype(np.float32)
