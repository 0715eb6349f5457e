"""GK701."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._copies import copied, refused
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK701",
    needs=("copies",),
    severity=MEDIUM,
    mend="let every attribute be copied (views of arrays and closures aren't), or raise in "
    "__deepcopy__",
    applies=refused("deepcopy"),
)
def deepcopies_go_on_the_same(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A copy.deepcopy that is made in mid-episode goes on like its original, state() too.

    Tree search and counterfactual estimates play on in copies. A copy that has lost a part of the
    state, a view of an array or the place in the random stream, plays another game.

    Bad:

    ```python
    self.world = np.zeros(8)
    self.position = self.world[:4]          # a view: in a deep copy it is an array of its own
    ```

    Good:

    ```python
    self.position, self.goal = np.zeros(4), np.zeros(4)
    def state(self):
        return np.concatenate([self.position, self.goal])
    ```

    Refusing to be copied is fine: nobody promises it.
    """
    yield from copied(evidence, "deepcopy", "copy")
