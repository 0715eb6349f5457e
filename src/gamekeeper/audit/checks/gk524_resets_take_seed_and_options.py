"""GK524."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK524",
    needs=("lifecycle",),
    severity=MEDIUM,
    mend="declare `def reset(self, seed=None, options=None):`",
)
def resets_take_seed_and_options(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`reset` takes `seed` and `options` by keyword, and neither is needed.

    Wrappers, vector environments and trainers call `reset(seed=..., options=...)`; where one of
    them isn't known, they crash with a TypeError.

    Bad:
    ```python
    def reset(self, seed=None): ...
    ```
    Good:
    ```python
    def reset(self, seed=None, options=None): ...
    ```
    """
    for fact in evidence.facts("lifecycle", "resets_with"):
        for words, raised in fact.value.items():
            yield Occasion(
                fact.where, raised is None, f"reset({words}) begins an episode", raised,
                proof=Proof(f"make().reset({words})", plays=False),
            )  # fmt: skip
