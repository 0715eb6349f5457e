"""What comes out: what each slot is given next, who acts, and what they may do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gamekeeper.adapters.slots.learners import Learners
from gamekeeper.adapters.slots.trees import at, changed, fill, put, zeros
from gamekeeper.vector.form import ALL, Group, leaves

MASK: Final = "action_mask"


class View:
    """What a vector environment gives, slot by slot. Use `TickView` or `TurnView`.

    Attributes:
        observation_space: of a slot.
        acting: [slot], who acts in the next step.
        live: [slot], who is in its copy's game.
        are_all_live: whether all of them are.
        masks: [slot, action], what each may do; ones where it doesn't act.
    """

    def __init__(self, learners: Learners, groups: Sequence[Group], num_envs: int) -> None:
        """Makes room for so many copies."""
        self._learners, self._copies = learners, num_envs
        self._name, self._places = learners.group.name, learners.places
        self._is_one = groups[0].name == ALL
        self._is_whole = self._is_one and learners.are_all
        self.are_all_live = False
        self.count = num_envs * len(learners)
        self.observation_space, self._key = bare_space(learners.group.observation_space)
        self.acting = np.zeros(self.count, bool)
        self.live = np.zeros(self.count, bool)
        self.masks: NDArray[np.int8] = np.ones((self.count, learners.group.flags), np.int8)

    def by_slot(self, part: Any) -> Any:
        """An array by copy and agent as a new one by slot."""
        return self._rows(self._of_group(part))

    def _rows(self, part: Any) -> Any:
        own = part.copy() if self._is_whole else np.array(part[:, self._places], order="C")
        return own.reshape(self.count, *own.shape[2:])

    def note_live(self, infos: Any) -> bool:
        """Notes who lives; returns whether all did before."""
        were_all, live = self.are_all_live, self._of_group(infos["live"])[:, self._places]
        self.are_all_live = bool(live.all())
        if not (were_all and self.are_all_live):
            self.live.reshape(live.shape)[...] = live
        return were_all

    def look(self, seen: Any, obs: Any, infos: Any, over: Any) -> Any:
        """Notes who acts next, and returns what each slot is given: arrays that nobody changes.

        Args:
            seen: what they were given before; None: nothing.
            obs, infos: what the vector environment gave.
            over: copies that began anew in the last step.
        """
        raise NotImplementedError

    def final(self, slot: int, seen: Any, obs: Any, infos: Any) -> Any:
        """The last observation of a slot that ended; `seen`: what it was given before that."""
        copy, learner = divmod(slot, len(self._learners))
        places = self._places
        place = places.start + learner if isinstance(places, slice) else int(places[learner])
        if "_final_obs" in infos and infos["_final_obs"][copy]:
            return at(self._bare(self._of_group(infos["final_obs"][copy])), place)
        return self._final_in_game(slot, (copy, place), seen, obs)

    def _final_in_game(self, slot: int, index: tuple[int, int], seen: Any, obs: Any) -> Any:
        """The last observation of a slot whose copy goes on without it."""
        raise NotImplementedError

    def _of_group(self, part: Any) -> Any:
        return part if self._is_one else part[self._name]

    def _bare(self, obs: Any) -> Any:
        """Without the mask, which stands apart."""
        if not isinstance(obs, dict):
            return obs
        if self._key is not None:
            return obs[self._key]
        return {key: part for key, part in obs.items() if key != MASK}


class TickView(View):
    """Of Parallel copies: who is live acts."""

    def look(self, seen: Any, obs: Any, infos: Any, over: Any) -> Any:
        """As of all views; zeros where nobody is."""
        were_all_live = self.note_live(infos)
        if not (were_all_live and self.are_all_live):
            self.acting[...] = self.live
        found = changed(self._bare(self._of_group(obs)), self._rows)
        if self.masks.size:
            self.masks[...] = self.by_slot(infos[MASK])
        if not self.are_all_live:
            is_idle = ~self.live
            fill(found, is_idle, 0)
            self.masks[is_idle] = 1
        return found

    def _final_in_game(self, slot: int, index: tuple[int, int], seen: Any, obs: Any) -> Any:
        return at(self._bare(self._of_group(obs)), index)


class TurnView(View):
    """Of AEC copies: who is in turn acts, the others keep what they were shown last."""

    def look(self, seen: Any, obs: Any, infos: Any, over: Any) -> Any:
        """As of all views; zeros for who has ended, or was shown nothing yet."""
        self.note_live(infos)
        if seen is None:
            space = self.observation_space
            found = zeros(space, tuple(leaves(space, "observation_space")), (self.count,))
        else:
            found = changed(seen, np.copy)
        agents = len(self._learners)
        if len(over) or not self.are_all_live:
            is_new = ~self.live
            is_new.reshape(self._copies, agents)[over] = True
            fill(found, is_new, 0)
        copies, slots = self._learners.in_turn(infos["turn"])
        self.acting.fill(False)
        self.acting[slots] = True
        put(found, slots, changed(self._bare(self._of_group(obs)), lambda part: part[copies]))
        if self.masks.size:
            self.masks.fill(1)
            self.masks[slots] = self._of_group(infos[MASK])[copies]
        return found

    def _final_in_game(self, slot: int, index: tuple[int, int], seen: Any, obs: Any) -> Any:
        return at(seen, slot)


def bare_space(space: spaces.Space[Any]) -> tuple[spaces.Space[Any], str | None]:
    """An observation space without the mask in it; of a Dict with one other part, that part."""
    if not isinstance(space, spaces.Dict) or MASK not in space.spaces:
        return space, None
    rest = {key: part for key, part in space.spaces.items() if key != MASK}
    if len(rest) == 1:
        (key,) = rest
        return rest[key], key
    return spaces.Dict(rest), None
