"""The tape of kernels in which all act at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.kernels.batch import Batch
from gamekeeper.vector.kernel_tape import Tape, put


class TickTape(Tape):
    """Of kernels in which all act at once: a row for everybody who is there at a tick.

    Beside what the batch shows stands who has a row (`present`).
    """

    given_more = (("present", "?"), ("began", "?"))

    def __init__(self, batch: Batch, *, is_next: bool) -> None:
        """As of all tapes."""
        super().__init__(batch, is_next=is_next)
        a = batch.arrays
        for name, array in (("received", a.rewards), ("ended", a.live), ("cut", a.live)):
            self.given[name] = np.zeros((self.slots + 1, *array.shape), array.dtype)

    def _before(self) -> NDArray[np.bool_]:
        live: NDArray[np.bool_] = self.batch.arrays.live.copy()
        return live

    def _keep(self, t: int, over: NDArray[np.intp], before: Any) -> None:
        a, given = self.batch.arrays, self.given
        self.was_live = before
        self.has_acted |= before & given["open"][t][:, None]
        if not len(over):
            return
        over = over[a.ended[over]]
        m, i = np.nonzero(a.last[over])
        e = over[m]
        clock = given["clock"][t] + 1
        put(
            self.apart.rows,
            episode=given["episode"][t, e], turn=clock[e], agent=i.astype(np.int32),
            received=a.rewards[e, i], terminated=a.terminated[e, i], truncated=a.truncated[e, i],
            **self.finals(e, i),
        )  # fmt: skip
        episode = given["episode"][t, over]
        put(self.apart.ends, episode=episode, turns=clock[over], **self.end_of(over))
        if "state" in given:
            put(self.apart.states, episode=episode, turn=clock[over], state=a.state[over])

    def _show(self, t: int, began: NDArray[np.bool_]) -> None:
        super()._show(t, began)
        a, given = self.batch.arrays, self.given
        if not t:
            given["present"][0], given["began"][0] = a.live, True
            return
        goes_on = ~began[:, None]
        given["received"][t] = np.where(goes_on, a.rewards, 0.0)
        given["ended"][t] = a.terminated & goes_on
        given["cut"][t] = a.truncated & goes_on
        gone = (self.was_live | a.terminated | a.truncated) & goes_on
        given["present"][t] = a.live | gone
        given["began"][t] = began
