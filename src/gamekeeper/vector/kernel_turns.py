"""The tape of kernels in which agents take turns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.kernels.batch import Batch
from gamekeeper.vector.kernel_tape import Tape, put


class TurnTape(Tape):
    """Of kernels in which agents take turns: a row for who acts, and for whom a turn touched.

    Beside what the batch shows stands who has a row though it isn't its turn (`news`). Who ends has
    a last turn, in which nothing is done: these stand apart.
    """

    given_more = (("news", "?"), ("received", "f8"))

    def __init__(self, batch: Batch, *, is_next: bool, in_turn_first: bool = False) -> None:
        """As of all tapes; `in_turn_first`: who would be in turn leaves before others that end."""
        super().__init__(batch, is_next=is_next)
        self.in_turn_first = in_turn_first
        self.sums = np.zeros((self.copies, self.agents))
        self.places = np.zeros((self.copies, self.agents), np.int64)
        self.terms = np.zeros_like(batch.arrays.terms)
        self.everybody = np.arange(self.copies)

    def _begun(self, began: NDArray[np.bool_]) -> None:
        super()._begun(began)
        self.sums[began] = 0.0
        self.terms[began] = 0.0
        self.places[began] = np.arange(self.agents)

    def _before(self) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        return self.batch.arrays.live.copy(), self.batch.arrays.turn.astype(np.int64)

    def _keep(self, t: int, over: NDArray[np.intp], before: Any) -> None:
        a, given = self.batch.arrays, self.given
        live, actor = before
        is_open = given["open"][t]
        given["received"][t] = self.sums[self.everybody, actor]
        self.has_acted[self.everybody[is_open], actor[is_open]] = True
        self.sums[self.everybody, actor] = 0.0
        self.sums += a.rewards
        self.terms[...] = a.terms
        flags = (a.terminated | a.truncated) & is_open[:, None]
        joined = (a.live | flags) & ~live & is_open[:, None]
        if joined.any():
            late = (given["clock"][t].astype(np.int64) + 1) * self.agents
            self.places = np.where(joined, late[:, None] + np.arange(self.agents), self.places)
        self.count = flags.sum(1)
        self.news = joined & ~flags.any(1)[:, None]
        if flags.any():
            self._bury(t, flags, joined)
        over = over[a.ended[over]]
        if len(over):
            turns = given["clock"][t, over] + 1 + self.count[over].astype(np.int32)
            episode = given["episode"][t, over]
            put(self.apart.ends, episode=episode, turns=turns, **self.end_of(over))
            if "state" in given:
                put(self.apart.states, episode=episode, turn=turns, state=a.state[over])

    def _bury(self, t: int, flags: NDArray[np.bool_], joined: NDArray[np.bool_]) -> None:
        """The last turns of those who ended, in the order of the roster."""
        a, given = self.batch.arrays, self.given
        places = np.where(flags, self.places, np.iinfo(np.int64).max)
        if self.in_turn_first:
            then = self.batch.records["turn"]
            is_first = np.flatnonzero(flags[self.everybody, then])
            places[is_first, then[is_first]] = -1
        order = np.argsort(places, axis=1, kind="stable")
        rank = np.argsort(order, axis=1, kind="stable")
        e, i = np.nonzero(flags)
        turn = given["clock"][t, e] + 1 + rank[e, i].astype(np.int32)
        episode = given["episode"][t, e]
        put(
            self.apart.rows,
            episode=episode, turn=turn, agent=i.astype(np.int32), received=self.sums[e, i],
            terminated=a.terminated[e, i], truncated=a.truncated[e, i], **self.finals(e, i),
        )  # fmt: skip
        if "state" in given:
            put(self.apart.states, episode=episode, turn=turn, state=a.state[e])
        has_ended: Any = flags.any(1)
        others = (flags | joined) & has_ended[:, None] & (rank != 0)
        e, i = np.nonzero(others)
        put(
            self.apart.rows,
            light_episode=given["episode"][t, e], light_turn=given["clock"][t, e] + 1,
            light_agent=i.astype(np.int32), light_terminated=a.terminated[e, i],
            light_truncated=a.truncated[e, i],
        )  # fmt: skip

    def _show(self, t: int, began: NDArray[np.bool_]) -> None:
        super()._show(t, began)
        given = self.given
        if not t:
            given["news"][0] = given["live"][0]
            return
        given["clock"][t] += np.where(began, 0, self.count).astype(np.int32)
        given["news"][t] = np.where(began[:, None], given["live"][t], self.news)
