"""GK525."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES: Final = {
    "before any reset": "env = make()\nenv.close()",
    "after a reset": "env = make()\nenv.reset(seed=SEED)\nenv.close()",
    "twice": "env = make()\nenv.reset(seed=SEED)\nenv.close()\nenv.close()",
}


@check(
    "GK525",
    needs=("lifecycle",),
    severity=LOW,
    mend="let close() look whether there is anything to close: `if self.screen is not None: ...`",
)
def close_never_raises(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`close` raises at no time: not before a reset, and not when it is called twice.

    It is called while cleaning up, often after another error, which its own would then hide; and
    `finally` blocks, wrappers and garbage collection may call it more than once.

    Bad:
    ```python
    def close(self):
        self.screen.close()                   # None before the first frame
    ```
    Good:
    ```python
    def close(self):
        if self.screen is not None:
            self.screen.close()
            self.screen = None
    ```
    """
    for fact in evidence.facts("lifecycle", "close"):
        for when, raised in fact.value.items():
            yield Occasion(
                fact.where, raised is None, f"close() {when} does nothing, or closes", raised,
                proof=Proof(LINES[when], plays=False),
            )  # fmt: skip
