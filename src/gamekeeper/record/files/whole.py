"""Which turns of a run that was never sealed are whole: pure arithmetic over key columns.

The rule. Streams are written one after another, so a kill leaves each of them cut at another place.
An episode counts from the moment its first row in `episodes` is there. Turn t of it is whole if

1. `timings`, where that stream exists, has a row for each turn 0..t (one for a finished turn),
2. `states`, where that stream exists, has a row of turn t or a later one of the episode, or has
   rows of later episodes and none of this (its state couldn't be asked for), and
3. `steps` has a row of turn t or a later one of the episode (a turn's rows are never split across
   batches, and a turn without any row carries nothing).

With n whole turns, rows of turns below n are kept. Of turn n, the state is kept, and so are the
rows in `steps` if none of them acted (`order` is null): they are the closing rows, what was given
after the last turn. Rows of a turn n in which someone acted belong to a turn that never finished.
(Without timings there is nothing to tell these by, and the last turn seen counts as whole.) A row
in `episodes` that tells an episode's end counts only if the episode has as many whole turns as it
says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Keys = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Whole:
    """How many whole turns each begun episode has.

    Args:
        episodes: [begun] sorted ids.
        turns: [begun] whole turns.
        acted: [begun] someone acted in the turn that follows the whole ones.
        has_timings: whether closing rows can be told from rows of an unfinished turn.
    """

    episodes: Keys
    turns: Keys
    acted: Mask
    has_timings: bool

    def steps(self, episode: Keys, turn: Keys) -> Mask:
        """[rows] which rows of steps are kept."""
        place, is_begun = self.place(episode)
        kept = turn < self.turns[place]
        if self.has_timings:
            kept |= (turn == self.turns[place]) & ~self.acted[place]
        return kept & is_begun

    def states(self, episode: Keys, turn: Keys) -> Mask:
        """[rows] which rows of states are kept."""
        place, is_begun = self.place(episode)
        return (turn <= self.turns[place]) & is_begun

    def timings(self, episode: Keys, turn: Keys) -> Mask:
        """[rows] which rows of timings are kept."""
        place, is_begun = self.place(episode)
        return (turn < self.turns[place]) & is_begun

    def place(self, episode: Keys) -> tuple[Keys, Mask]:
        """[rows] where each row's episode stands in `episodes`, and whether it stands there."""
        place = np.searchsorted(self.episodes, episode).clip(max=len(self.episodes) - 1)
        return place, self.episodes[place] == episode

    def extent(self, episode: Keys, turn: Keys) -> Keys:
        """[begun] one more than the last turn that any row has."""
        place, is_begun = self.place(episode)
        turns = np.zeros_like(self.episodes)
        np.maximum.at(turns, place[is_begun], turn[is_begun] + 1)
        return turns

    def unbroken(self, episode: Keys, turn: Keys) -> Keys:
        """[begun] how many of the turns 0, 1, 2, ... have a row before the first that has none."""
        place, is_begun = self.place(episode)
        keys = np.unique(place[is_begun].astype(np.int64) << 32 | turn[is_begun])
        place, turn = keys >> 32, keys & 0xFFFFFFFF
        first = np.searchsorted(place, place)
        in_run = turn == np.arange(len(keys)) - first
        return np.bincount(place[in_run], minlength=len(self.episodes)).astype(np.int64)


def whole_turns(
    begun: Keys,
    steps: tuple[Keys, Keys, Mask],
    states: tuple[Keys, Keys] | None,
    timings: tuple[Keys, Keys] | None,
) -> Whole:
    """How many whole turns each episode has, by the rule above.

    Args:
        begun: [rows] ids in the stream of episodes, in any order.
        steps: [rows] episode, turn, and whether the agent acted.
        states: [rows] episode and turn, None where the stream doesn't exist.
        timings: the same.
    """
    # The id -1, which no row has, keeps every look-up within bounds.
    episodes = np.concatenate([np.array([-1]), np.unique(begun)]).astype(np.int64)
    none = Whole(episodes, np.zeros_like(episodes), np.zeros(len(episodes), bool), False)
    turns = none.extent(steps[0], steps[1])
    if states is not None:
        reach = none.extent(*states)
        was_passed = (reach == 0) & (episodes < states[0].max(initial=-1))
        turns = np.where(was_passed, turns, np.minimum(turns, reach))
    if timings is not None:
        turns = np.minimum(turns, none.unbroken(*timings))
    place, is_begun = none.place(steps[0])
    acted = np.zeros(len(episodes), bool)
    acted[place[is_begun & steps[2] & (steps[1] == turns[place])]] = True
    return Whole(episodes, turns, acted, timings is not None)
