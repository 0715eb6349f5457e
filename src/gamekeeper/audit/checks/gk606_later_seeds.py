"""GK606."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.played_twice import place, program, settled_by_seed, told, whole
from gamekeeper.audit.used import is_blind_later
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

SEEDS: Final = 16
"""Seeds that the program tries."""


@check(
    "GK606",
    needs=("second_episode",),
    severity=HIGH,
    mend="build the generator anew whenever reset() is given a seed, not only where there is none "
    "yet",
    applies=settled_by_seed,
)
def later_seeds_are_obeyed(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every reset(seed) seeds the play, not only the first one of an instance.

    Where later seeds are ignored, an evaluation on fixed seeds in one instance isn't one: its
    episodes depend on what was played before. In a used instance several seeds give one and the
    same play, while in fresh instances they give different ones.

    Bad:

    ```python
    def reset(self, seed=None, options=None):
        if self.rng is None:
            self.rng = np.random.default_rng(seed)
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
    ```
    """
    for look in evidence.looks.get("second_episode", ()):
        for twin in look.twins:
            if twin.divergence is None:
                yield Occasion(whole(twin), True, "seeds are obeyed", "seeds are obeyed")
            elif twin.noise is None and is_blind_later(look):
                yield Occasion(
                    place(twin, twin.divergence), False, "the play of this seed",
                    f"the same play for any seed: {told(twin.divergence)}", _proof(evidence.api),
                )  # fmt: skip


def _proof(api: str) -> Proof:
    return program(
        api,
        "def later(seed):",
        "    env = make()",
        "    play(env)",
        "    return play(env, seed)",
        f"assert len({{later(seed) for seed in range({SEEDS})}}) > 1",
    )
