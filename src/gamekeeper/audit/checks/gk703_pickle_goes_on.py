"""GK703."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._copies import copied, refused
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK703",
    needs=("copies",),
    severity=MEDIUM,
    mend="leave nothing of the game's state out of __getstate__, or raise there",
    applies=refused("pickle"),
)
def pickled_copies_go_on_the_same(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A copy by pickle that is made in mid-episode goes on like its original, state() too.

    Checkpoints and worker processes pickle environments. What is left out of the pickle, such as
    the place in the random stream, is another game from there on.

    Bad:

    ```python
    def __getstate__(self):
        return {k: v for k, v in self.__dict__.items() if k != "rng"}
    ```

    Good: pickle the generator too; `np.random.Generator` can be pickled.

    Refusing to be pickled is fine, and so is a copy that begins anew and wants a reset (EzPickle).
    """
    yield from copied(evidence, "pickle", "copy")
