"""What an agent may do now, and what stands in for an action that it may not do."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete, MultiDiscrete, Space
from numpy.typing import NDArray

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.agent_spec import as_action
from gamekeeper.game.casting.mask import for_sample, legal_flags, reader
from gamekeeper.game.door import AgentId
from gamekeeper.run.stress.numbers import Numbers, are_numbers
from gamekeeper.run.stress.part import Part, blank_of_rare, parts_of, scalar_like
from gamekeeper.run.stress.stressor import action_space

Flags = NDArray[np.bool_]


class Offer:
    """An agent's actions, as its space, its noop and its mask of the moment leave them.

    A mask counts for Discrete spaces and for MultiDiscrete ones of one axis, also within others;
    elsewhere, and where a mask leaves nothing, all is legal.

    Attributes:
        space: of its actions.
        parts: of the space.
        has_noop: an action that does nothing is declared, and is one of the space's.
    """

    def __init__(self, contract: Contract, agent: AgentId, space: Space[Any]) -> None:
        self.space, self.parts = space, tuple(parts_of(space))
        self._read = reader(contract.mask_of(agent))
        self._noop = _noop(contract, agent, space)
        self.has_noop = self._noop is not None
        self._mask: Any = None

    def take(self, observation: Any, info: Any) -> None:
        """Notes the mask in what the agent is given now."""
        self._mask = self._read(observation, info)

    def flags(self, part: Part) -> tuple[Flags, ...] | None:
        """What of a part is legal, for each of its whole numbers; None: everything."""
        mask = self._mask
        for key in part.path:
            inside = isinstance(mask, Mapping | tuple | list)
            mask = _within(mask, key) if inside else None
        if mask is None:
            return None
        if isinstance(part.space, Discrete):
            flags = legal_flags(mask, int(part.space.n))
            return (flags,) if flags.any() else None
        if isinstance(part.space, MultiDiscrete) and part.space.nvec.ndim == 1:
            return tuple(np.asarray(each, bool) for each in for_sample(part.space, mask))
        return None

    def allows(self, action: Any) -> bool:
        """Whether an action of the space is legal now."""
        if self._mask is None:
            return True
        for part in self.parts:
            flags = self.flags(part)
            if flags is None:
                continue
            if isinstance(part.space, Discrete):
                if not flags[0][int(part.of(action)) - int(part.space.start)]:
                    return False
                continue
            first = np.asarray(getattr(part.space, "start", 0)).reshape(-1)
            chosen = np.asarray(part.of(action)).reshape(-1) - first
            if not all(flag[int(at)] for flag, at in zip(flags, chosen, strict=True)):
                return False
        return True

    def noop(self, like: Any) -> Any:
        """The action that does nothing, new at every call, of the type of another."""
        if isinstance(self.space, Discrete):
            return scalar_like(like, self._noop)
        return copy.deepcopy(self._noop)

    def stand_in(self, like: Any) -> Any:
        """What is done in place of an illegal action, by one rule for all.

        The declared noop where that is legal; else part by part the first legal number, of a Box
        0 or what is nearest to it.

        Args:
            like: what the agent has chosen, whose types are kept, and whose texts stay.
        """
        if self.has_noop:
            noop = self.noop(like)
            if self.allows(noop):
                return noop
        action = like
        for part in self.parts:
            action = self._first(part, action)
        return action

    def _first(self, part: Part, action: Any) -> Any:
        if not are_numbers(part.space):
            return part.put(action, blank_of_rare(part.space, part.of(action)))
        numbers, flags = Numbers(part), self.flags(part)
        if numbers.read(action) is None:
            return action
        if flags is not None:
            return numbers.write(action, numbers.low + [float(np.argmax(x)) for x in flags])
        is_listed = isinstance(part.space, Discrete | MultiDiscrete)
        return numbers.write(action, numbers.low if is_listed else numbers.blank())


def _within(mask: Any, key: Any) -> Any:
    """The mask of one part within that of the whole; None where it has none."""
    if isinstance(mask, Mapping):
        return mask.get(key)
    return mask[key] if isinstance(key, int) and key < len(mask) else None


def offer_of(contract: Contract, env: Any, agent: AgentId) -> Offer | None:
    """What an agent may do; None where the environment doesn't say."""
    space = action_space(env, agent)
    return None if space is None else Offer(contract, agent, space)


def _noop(contract: Contract, agent: AgentId, space: Space[Any]) -> Any:
    declared = contract.noop_of(agent)
    if declared is None:
        return None
    try:
        return as_action(space, declared)
    except ValueError:  # what is declared is no action: as if none were
        return None
