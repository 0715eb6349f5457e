"""GK632."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._handed import handed
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LINES = """\
env = make()
options = {}
env.reset(seed=SEED, options=options)
assert options == {}, options"""


@check(
    "GK632",
    needs=("handed_over",),
    severity=LOW,
    mend="work with a copy: `options = {**DEFAULTS, **(options or {})}`",
)
def reset_leaves_options_alone(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The options that are handed to reset are as before once it returns.

    One dictionary of options is handed to every reset, of several environments perhaps: what one
    reset writes into it governs all the others.

    Bad:

    ```python
    options.setdefault("wind", self.rng.uniform())
    ```

    Good:

    ```python
    wind = (options or {}).get("wind", self.rng.uniform())
    ```
    """
    yield from handed(evidence, "options", Proof(LINES, plays=False))
