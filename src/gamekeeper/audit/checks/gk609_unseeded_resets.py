"""GK609."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.drawn import draws_nothing
from gamekeeper.audit.played_twice import program
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

FALSE_ALARM: Final = 1e-3
RESETS: Final = 16
"""Resets that the program tries."""


@check(
    "GK609",
    needs=("unseeded",),
    severity=HIGH,
    mend="let reset() without a seed go on with the generator that is there; build one only where "
    "a seed is given or none was built yet",
    applies=draws_nothing,
)
def unseeded_resets_draw_anew(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A reset without a seed goes on drawing; it doesn't re-seed with a constant or the last seed.

    Training resets without a seed, and would see one and the same episode again and again. Judged
    only where seeds make a difference. Fisher's exact test on how often plays of 16 resets without
    a seed and of 16 seeds are the most frequent one, one-sided, once per audit: in fewer than one
    of 1,000 environments that are right is this broken.

    Bad:

    ```python
    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(0 if seed is None else seed)
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
    ```
    """
    for look in evidence.looks.get("unseeded", ()):
        facts = {fact.name: fact for fact in look.facts}
        seeded, unseeded = facts["seeded"].value, facts["unseeded"].value
        at = facts["unseeded"].where
        if len(set(unseeded)) > 1:
            yield Occasion(at, True, "plays that differ", "plays that differ")
        elif len(set(seeded)) > 1:
            p = p_all_alike(seeded, len(unseeded))
            if p < FALSE_ALARM:
                yield Occasion(
                    at, False, "plays that differ, as those of seeds do",
                    f"{len(unseeded)} resets without a seed, and the same play after each",
                    _proof(evidence.api), confidence=1.0 - p,
                )  # fmt: skip


def p_all_alike(seeded: Sequence[str], count: int) -> float:
    """Probability that `count` further plays are all the most frequent of the seeded ones.

    Source: Fisher's exact test, one-sided, for a table with one empty cell.
    """
    often = max(Counter(seeded).values())
    return math.comb(often + count, count) / math.comb(len(seeded) + count, count)


def _proof(api: str) -> Proof:
    return program(
        api,
        "env = make()",
        "env.reset(seed=SEED)",
        f"assert len({{play(env) for _ in range({RESETS})}}) > 1",
        reset="env.reset()",
    )
