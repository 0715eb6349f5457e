"""One agent's observations, actions and masks as vectors of fixed length."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.core.contract import Contract
from gamekeeper.errors import SpecError
from gamekeeper.game.casting.mask import legal_flags, reader

MASK: Final = "action_mask"


class Seen:
    """How one agent's observations, actions and masks become vectors.

    Attributes:
        length: of its observation.
        actions: how many it has, counted from `start`.
        noop: what it may do where it isn't there.
    """

    def __init__(self, env: Any, contract: Contract, agent: Any) -> None:
        """Reads an agent's spaces.

        Raises:
            SpecError: its actions aren't Discrete, or its observations have no fixed length.
        """
        space, action = env.observation_space(agent), env.action_space(agent)
        if not isinstance(action, spaces.Discrete):
            raise SpecError(
                "EPyMARL has numbered actions only", where=f"action_space({agent!r})",
                expected="Discrete", seen=str(action)[:200],
                mend="choose some actions and number them, in the environment",
            )  # fmt: skip
        if isinstance(space, spaces.Dict):
            rest = {key: part for key, part in space.spaces.items() if key != MASK}
            space = spaces.Dict(rest)
        if not space.is_np_flattenable:
            raise SpecError(
                "observations have no fixed length", where=f"observation_space({agent!r})",
                expected="what Gymnasium flattens to a Box", seen=str(space)[:200],
            )  # fmt: skip
        self._space = space
        self._mask = reader(contract.mask_of(agent))
        self.length = int(spaces.flatdim(space))
        self.start, self.actions = int(action.start), int(action.n)
        noop = contract.noop_of(agent)
        self.noop = noop - self.start if type(noop) is int else 0

    def flat(self, observation: Any) -> NDArray[Any]:
        """An observation as a vector."""
        if isinstance(self._space, spaces.Dict):
            observation = {key: observation[key] for key in self._space.spaces}
        elif isinstance(self._space, spaces.Box):
            return np.asarray(observation).reshape(-1)
        return np.asarray(spaces.flatten(self._space, observation))

    def legal(self, observation: Any, info: Any) -> NDArray[np.bool_]:
        """[action], which of its actions an agent may take; all where nothing says."""
        mask = self._mask(observation, info)
        if mask is None:
            return np.ones(self.actions, bool)
        flags = legal_flags(mask, self.actions)
        return flags if flags.any() else np.ones(self.actions, bool)
