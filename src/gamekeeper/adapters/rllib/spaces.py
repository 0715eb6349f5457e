"""How RLlib sees one agent: an observation that a network reads, its mask beside it, actions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import SpecError
from gamekeeper.game.casting.mask import Reader, reader
from gamekeeper.vector.block import put_mask
from gamekeeper.vector.form import MASK, Group

OBSERVATIONS: Final = "observations"
"""The name of the bare observation beside its mask, as RLlib's ActionMaskingRLModule reads it."""


@dataclass(frozen=True, slots=True)
class Sight:
    """One agent as RLlib sees it.

    Attributes:
        observation_space: of what `shown` gives.
        action_space: of what `meant` takes; a Discrete counts from 0.
        bare: the observation's own space, without the mask.
        key: under which the observation stands in a Dict that else holds the mask alone.
        flags: how long the mask is; 0: none is shown.
        place: where the mask stands, by the contract; None: the contract doesn't say.
        flat: whether the observation is one row of numbers.
        start: what is added to an action.
    """

    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]
    bare: spaces.Space[Any]
    key: str | None
    flags: int
    place: str | None
    flat: bool
    start: Any

    def shown(self, observation: Any, info: Any) -> Any:
        """An observation of the environment as RLlib gets it."""
        seen = observation
        if isinstance(seen, dict) and MASK in seen:
            rest = {key: part for key, part in seen.items() if key != MASK}
            seen = rest if self.key is None else rest[self.key]
        if self.flat:
            seen = np.asarray(spaces.flatten(self.bare, seen), np.float32)
        if not self.flags:
            return seen
        mask = np.empty(self.flags, np.float32)
        put_mask(mask, _reader(self.place)(observation, info))
        return {MASK: mask, OBSERVATIONS: seen}

    def meant(self, action: Any) -> Any:
        """An action of RLlib as the environment takes it."""
        return action if self.start is None else action + self.start


def sight(group: Group, place: str | None, *, masks: bool, flatten: bool) -> Sight:
    """How RLlib sees the agents of a group.

    Args:
        group: their spaces, and how long their masks are.
        place: where a mask stands, by the contract.
        masks: whether masks stand in observations.
        flatten: makes one row of numbers of an observation.
    """
    bare, key = _bare(group.observation_space)
    shown: spaces.Space[Any] = bare
    if flatten:
        shown = _row(bare, group)
    flags = group.flags if masks else 0
    if flags:
        legal = spaces.Box(0.0, 1.0, (flags,), np.float32)
        shown = spaces.Dict({MASK: legal, OBSERVATIONS: shown})
    action, start = _from_zero(group.action_space)
    return Sight(shown, action, bare, key, flags, place, flatten, start)


@cache
def _reader(place: str | None) -> Reader:
    return reader(place)


def _bare(space: spaces.Space[Any]) -> tuple[spaces.Space[Any], str | None]:
    if not isinstance(space, spaces.Dict) or MASK not in space.spaces:
        return space, None
    rest = {key: part for key, part in space.spaces.items() if key != MASK}
    if len(rest) == 1:
        (key,) = rest
        return rest[key], key
    return spaces.Dict(rest), None


def _row(space: spaces.Space[Any], group: Group) -> spaces.Box:
    row = spaces.flatten_space(space)
    if not isinstance(row, spaces.Box):
        raise SpecError(
            "an observation can't be made one row of numbers", where=f"agents {group.agents}",
            expected="Box, Discrete, MultiDiscrete, MultiBinary, and Dict or Tuple of them",
            seen=str(space)[:200], mend="flatten=False, and a module that reads such observations",
        )  # fmt: skip
    return spaces.Box(row.low.astype(np.float32), row.high.astype(np.float32), dtype=np.float32)


def _from_zero(space: spaces.Space[Any]) -> tuple[spaces.Space[Any], Any]:
    """An action space that counts from 0, as RLlib's distributions draw, and what is added."""
    if isinstance(space, spaces.Discrete) and space.start:
        return spaces.Discrete(int(space.n), dtype=space.dtype), space.start
    if isinstance(space, spaces.MultiDiscrete) and np.any(space.start):
        return spaces.MultiDiscrete(space.nvec, dtype=space.dtype), space.start
    return space, None
