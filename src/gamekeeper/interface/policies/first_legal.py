"""`first-legal`: the first action that the mask allows; deterministic."""

import copy
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.errors import PolicyError
from gamekeeper.interface.action_mask import for_sample, reader
from gamekeeper.interface.policy import AgentSlot, Start, masks_blamed_on

VERSION: Final = "1"
"""Changes when it would choose other actions."""


def start_for(given: AgentSlot) -> Start:
    """The lowest legal number, part by part in compound spaces.

    Box: the lower bound, or what is nearest to zero where there is none. Text: the shortest.
    Sequence: empty. OneOf: of its first space.
    """
    space, read = given.space, reader(given.mask)
    unmasked = _first(
        space, None
    )  # a space that it can't choose from is told before the game begins

    def play(observation: object, info: object) -> Any:
        mask = read(observation, info)
        if mask is None:
            return copy.deepcopy(unmasked) if is_compound else unmasked
        with masks_blamed_on(given, mask):
            return _first(space, for_sample(space, mask))

    is_compound = not isinstance(unmasked, np.generic | str)
    return lambda rng: play


def _first(space: spaces.Space[Any], mask: Any) -> Any:
    if isinstance(space, spaces.Discrete):
        lowest = 0 if mask is None else int(np.argmax(mask))
        return space.dtype.type(int(space.start) + lowest)
    if isinstance(space, spaces.MultiDiscrete):
        return _lowest_each(space, mask)
    if isinstance(space, spaces.MultiBinary):
        return np.zeros(space.shape, space.dtype) if mask is None else np.where(mask == 1, 1, 0)
    if isinstance(space, spaces.Box):
        return np.where(np.isfinite(space.low), space.low, np.minimum(space.high, 0)).astype(
            space.dtype
        )
    if isinstance(space, spaces.Dict):
        return {key: _first(part, mask and mask[key]) for key, part in space.items()}
    if isinstance(space, spaces.Tuple):
        masks = mask or (None,) * len(space.spaces)
        return tuple(_first(part, one) for part, one in zip(space.spaces, masks, strict=True))
    return _first_of_rare(space, mask)


def _lowest_each(space: spaces.MultiDiscrete, mask: Any) -> Any:
    def lowest(part: Any) -> Any:
        return [lowest(one) for one in part] if isinstance(part, tuple) else int(np.argmax(part))

    offsets = np.zeros(space.shape) if mask is None else np.asarray(lowest(mask))
    return (space.start + offsets).astype(space.dtype)


def _first_of_rare(space: spaces.Space[Any], mask: Any) -> Any:
    if isinstance(space, spaces.Text):
        return min(space.character_list) * space.min_length
    if isinstance(space, spaces.Sequence) and not space.stack:
        return ()
    if isinstance(space, spaces.OneOf):
        return (np.int64(0), _first(space.spaces[0], mask and mask[0]))
    raise PolicyError(
        f"'first-legal' has no first action in {type(space).__qualname__}",
        actual=str(space),
        fix="take 'random', or a policy of your own",
    )
