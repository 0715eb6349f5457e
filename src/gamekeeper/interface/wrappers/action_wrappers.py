"""Wrappers of what agents do: clipped, repeated, of one size, and their masks' place."""

import secrets
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import Space

from gamekeeper.errors import ActionError, ContractError, SpecError
from gamekeeper.interface.action_mask import for_sample, reader
from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.legality import allows
from gamekeeper.interface.wrappers.observation_wrappers import MASK, VIEW
from gamekeeper.interface.wrappers.transform import Transform, possible, unfit
from gamekeeper.interface.wrappers.wrapped_env import wrapped
from gamekeeper.randomness.stream import Stream

LANE: Final = 0x57C4
"""First lane of the streams of sticky actions; no task of ours draws from it."""
_READ: Final = reader(None)


def clip_actions(env: Any) -> Any:
    """Clips actions of Box spaces to their bounds; other actions pass as they are.

    The spaces stay: an action outside them is taken, one of another shape isn't changed.
    """
    return wrapped(env, ClippedActions())


def sticky_actions(env: Any, probability: float = 0.25) -> Any:
    """Repeats an agent's last action instead of the one it chose, with a probability.

    Each agent has a stream of its own from the seed of the reset, so that nothing depends on the
    order of a dictionary of actions. An action that the mask forbids isn't repeated; the first of
    an episode isn't replaced.
    """
    return wrapped(env, RepeatedActions(probability))


def pad_actions(env: Any, *, instead: int | None = None) -> Any:
    """Gives all agents the largest of their Discrete action spaces, and masks what is added.

    Agents with fewer actions have an `action_mask`, in their info or where their own stands; the
    others keep theirs.

    Args:
        env: AECEnv or ParallelEnv.
        instead: action in the place of one that an agent doesn't have; None: it is refused.
    Raises:
        SpecError: the spaces aren't all Discrete and from 0, or `instead` isn't in all of them.
    """
    return wrapped(env, PadActions(instead))


def mask_to_observation(env: Any) -> Any:
    """Moves the mask from the infos into observations, `{"observation": ..., "action_mask": ...}`.

    An agent without a mask in its info has ones. Of MultiDiscrete the masks of the parts stand one
    after the other. The info keeps its mask.

    Raises:
        SpecError: an action space is neither Discrete nor MultiDiscrete.
    """
    return wrapped(env, MaskToObservation())


def mask_to_info(env: Any) -> Any:
    """Moves the mask from Dict observations into the infos.

    Of an observation of which only the key `observation` is left, that part is shown alone.
    """
    return wrapped(env, MaskToInfo())


class ClippedActions(Transform):
    """Use `clip_actions`."""

    def bind(self, env: Any) -> None:
        """Reads bounds as spaces are asked for."""
        self._boxes: dict[AgentId, spaces.Box] = {}

    def action_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The space itself."""
        if isinstance(space, spaces.Box):
            self._boxes[agent] = space
        return space

    def action(self, agent: AgentId, action: Any) -> Any:
        """The action within the bounds; a new array where it wasn't."""
        box = self._boxes.get(agent)
        if box is None or np.shape(action) != box.shape:
            return action
        return np.clip(action, box.low, box.high).astype(box.dtype, copy=False)


class RepeatedActions(Transform):
    """Use `sticky_actions`."""

    def __init__(self, probability: float) -> None:
        if not 0 <= probability < 1:
            raise SpecError(
                "actions can't be repeated with this probability",
                where="sticky_actions",
                expected="a number in [0, 1)",
                actual=repr(probability),
                fix="give 0.25, as the Arcade Learning Environment has it",
            )
        self._probability = probability
        self._rng: Stream | None = None

    def bind(self, env: Any) -> None:
        """Numbers the agents for their streams."""
        agents = possible(env, "sticky_actions")
        self._lanes = {agent: LANE + place for place, agent in enumerate(agents)}
        self._spaces = {agent: env.action_space(agent) for agent in agents}

    def begin(self, seed: int | None) -> None:
        """Takes the seed, or the next episode of the last one."""
        if seed is not None:
            self._rng = Stream(seed)
        elif self._rng is None:
            self._rng = Stream(secrets.randbits(63))
        else:
            self._rng = self._rng.next_episode()
        self._streams: dict[AgentId, Stream] = {}
        self._draws: dict[AgentId, int] = {}
        self._last: dict[AgentId, Any] = {}
        self._forbidden: set[AgentId] = set()

    def given(self, agent: AgentId, seen: Any, info: Mapping[str, Any]) -> None:
        """Finds out whether the last action may be repeated."""
        mask = _READ(seen, info)
        self._forbidden.discard(agent)
        if mask is None or agent not in self._last:
            return
        space = self._spaces[agent]
        if not allows(space, for_sample(space, mask), self._last[agent]):
            self._forbidden.add(agent)

    def action(self, agent: AgentId, action: Any) -> Any:
        """The last action of the agent, or this one.

        What is drawn is counted in `keep`: an action that is refused takes no draw.
        """
        if agent not in self._last:
            return action
        rng = self._streams.get(agent)
        if rng is None:
            assert self._rng is not None
            rng = self._streams[agent] = self._rng.fork(self._lanes[agent])
        draws = rng.draws
        repeats = rng.uniform() < self._probability
        self._draws[agent], rng.draws = rng.draws, draws
        if not repeats or agent in self._forbidden:
            return action
        last = self._last[agent]
        return last.copy() if isinstance(last, np.ndarray) else last

    def note(self, agent: AgentId, seen: Any, action: Any) -> Any:
        """Copy of the action that was taken."""
        return action.copy() if isinstance(action, np.ndarray) else action

    def keep(self, agent: AgentId, noted: Any) -> None:
        """Remembers it."""
        self._last[agent] = noted
        if agent in self._streams:
            self._streams[agent].draws = self._draws[agent]


class PadActions(Transform):
    """Use `pad_actions`."""

    def __init__(self, instead: int | None) -> None:
        self._instead = instead

    def bind(self, env: Any) -> None:
        """Finds the largest space."""
        own = {agent: env.action_space(agent) for agent in possible(env, "pad_actions")}
        for agent, space in own.items():
            if not isinstance(space, spaces.Discrete) or space.start:
                raise unfit(
                    "pad_actions",
                    agent,
                    expected="a Discrete space from 0",
                    actual=space,
                    fix="give it Discrete actions in the environment",
                )
        self._sizes = {agent: int(space.n) for agent, space in own.items()}
        self._size = max(self._sizes.values())
        least = min(self._sizes.values())
        if self._instead is not None and not 0 <= self._instead < least:
            raise SpecError(
                "this action can't stand in for others",
                where="pad_actions, instead",
                expected=f"an action of every agent, 0 to {least - 1}",
                actual=repr(self._instead),
                fix="name an action that all agents have, or leave it out",
            )

    def action_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The largest of them."""
        return spaces.Discrete(self._size)

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The space with a mask of the common size, where a mask is in it."""
        if isinstance(space, spaces.Dict) and MASK in space.spaces:
            mask = _flags_space(self._size, space.spaces[MASK])
            return spaces.Dict({**space.spaces, MASK: mask})
        return space

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The observation with its mask padded, where it has one."""
        if isinstance(seen, Mapping) and MASK in seen:
            return {**seen, MASK: self._padded(seen[MASK])}
        return seen

    def info(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The info with a padded mask, where the observation has none."""
        if self._sizes[agent] == self._size or (isinstance(seen, Mapping) and MASK in seen):
            return info
        mask = info.get(MASK)
        own = np.ones(self._sizes[agent], np.int8) if mask is None else mask
        return {**info, MASK: self._padded(own)}

    def action(self, agent: AgentId, action: Any) -> Any:
        """The action, or what stands in for one that the agent doesn't have.

        Raises:
            ActionError: it hasn't got it, and nothing stands in.
        """
        if not self._sizes[agent] <= action < self._size:
            return action
        if self._instead is None:
            raise ActionError(
                f"agent {agent!r} doesn't have this action",
                where="pad_actions",
                expected=f"0 to {self._sizes[agent] - 1}",
                actual=repr(action),
                fix="choose by the action mask, or name an action that stands in: instead=0",
            )
        return self._instead

    def _padded(self, mask: Any) -> Any:
        flags = np.asarray(mask)
        return np.pad(flags, (0, self._size - len(flags)))


def _flags_space(size: int, like: Space[Any]) -> Space[Any]:
    if isinstance(like, spaces.Box):
        return spaces.Box(like.low.min(), like.high.max(), (size,), like.dtype.type)
    return spaces.MultiBinary(size)


class MaskToObservation(Transform):
    """Use `mask_to_observation`."""

    def bind(self, env: Any) -> None:
        """Reads action spaces."""
        self._env = env
        self._sizes: dict[AgentId, int] = {}

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """A Dict of the observation and the mask."""
        acts: Space[Any] = self._env.action_space(agent)
        if isinstance(space, spaces.Dict) and MASK in space.spaces:
            raise unfit(
                "mask_to_observation",
                agent,
                expected=f"no {MASK!r} in it yet",
                actual=space,
                fix="leave the wrapper out: the mask stands there",
            )
        if isinstance(acts, spaces.Discrete):
            size = int(acts.n)
        elif isinstance(acts, spaces.MultiDiscrete) and acts.nvec.ndim == 1:
            size = int(acts.nvec.sum())
        else:
            raise unfit(
                "mask_to_observation",
                agent,
                expected="a Discrete or MultiDiscrete action space",
                actual=acts,
                fix="leave it out: such actions have no mask in one row",
            )
        self._sizes[agent] = size
        flags = spaces.Box(0, 1, (size,), np.int8)
        own = space.spaces if isinstance(space, spaces.Dict) else {VIEW: space}
        return spaces.Dict({**own, MASK: flags})

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The observation with its mask; a new array.

        Raises:
            ContractError: the mask in the info is of another length.
        """
        mask, size = info.get(MASK), self._sizes[agent]
        if mask is None:
            flags = np.ones(size, np.int8)
        else:
            parts = mask if isinstance(mask, tuple | list) else [mask]
            flags = np.concatenate([np.ravel(part) for part in parts]).astype(np.int8)
        if flags.shape != (size,):
            raise ContractError(
                f"the action mask of {agent!r} doesn't fit its action space",
                where="mask_to_observation, info['action_mask']",
                expected=f"{size} numbers",
                actual=f"{len(flags)}",
                fix="give one number for each action, of MultiDiscrete part by part",
            )
        own = seen if isinstance(seen, Mapping) else {VIEW: seen}
        return {**own, MASK: flags}


class MaskToInfo(Transform):
    """Use `mask_to_info`."""

    def observation_space(self, agent: AgentId, space: Space[Any]) -> Space[Any]:
        """The space without its mask."""
        if not isinstance(space, spaces.Dict) or MASK not in space.spaces:
            return space
        rest = {key: part for key, part in space.spaces.items() if key != MASK}
        return rest[VIEW] if list(rest) == [VIEW] else spaces.Dict(rest)

    def observation(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The observation without its mask."""
        if not isinstance(seen, Mapping) or MASK not in seen:
            return seen
        rest = {key: part for key, part in seen.items() if key != MASK}
        return rest[VIEW] if list(rest) == [VIEW] else rest

    def info(self, agent: AgentId, seen: Any, info: Any) -> Any:
        """The info with the mask."""
        if not isinstance(seen, Mapping) or MASK not in seen:
            return info
        return {**info, MASK: seen[MASK]}
