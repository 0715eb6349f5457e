"""GK605."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.played_twice import (
    FIELD,
    SAME,
    parted,
    program,
    settled_by_seed,
    told_of,
    whole,
)
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

AGAIN: Final = 8
"""Plays that the program compares: of few possible ones two are often equal."""


@check(
    "GK605",
    needs=("special_seeds",),
    severity=HIGH,
    mend="ask `if seed is not None`, never `if seed`, and take any non-negative integer",
    applies=settled_by_seed,
)
def seed_zero_is_a_seed(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Seed 0 is a seed like any other, and so is 2**31 - 1.

    0 is the seed that most people try first; where it is taken for no seed, exactly their runs
    don't repeat. Looked at beside a plain seed, which goes well.

    Bad:

    ```python
    def reset(self, seed=None, options=None):
        if seed:
            self.rng = np.random.default_rng(seed)
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        if seed is not None:
            self.rng = np.random.default_rng(seed)
    ```
    """
    for look in evidence.looks.get("special_seeds", ()):
        facts = {fact.name: fact.value for fact in look.facts}
        for twin in look.twins:
            seed = twin.change["seed"]
            proof = _proof(evidence.api, seed, told_of(contract, twin))
            if "plain" not in facts:
                yield Occasion(whole(twin), True, SAME, SAME)
            elif facts["plain"] and "refused" in facts:
                at = twin.base.at(0, None, FIELD)
                yield Occasion(at, False, "a seed like any other", facts["refused"], proof)
            elif facts["plain"]:
                yield from parted(twin, proof, expected=f"the same play for seed {seed} again")


def _proof(api: str, seed: int, tells: frozenset[str]) -> Proof:
    line = f"assert len({{play(make(), seed={seed}) for _ in range({AGAIN})}}) == 1"
    return program(api, line, tells=tells)
