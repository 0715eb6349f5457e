"""GK702."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._copies import copied, refused
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK702",
    needs=("copies",),
    severity=MEDIUM,
    mend="keep the game's state in the instance: no class attributes, globals or shared "
    "generators, and copy all of it in __deepcopy__",
    applies=refused("deepcopy"),
)
def originals_go_on_beside_a_deepcopy(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Stepping a copy.deepcopy doesn't move its original.

    A planner that tries a move in a copy would have made it in the game itself.

    Bad:

    ```python
    def __deepcopy__(self, memo):
        twin = type(self)()
        twin.__dict__.update(self.__dict__)     # the same board, the same generator
        return twin
    ```

    Good: leave `__deepcopy__` alone, or copy every attribute in it.
    """
    yield from copied(evidence, "deepcopy", "original")
