"""GK600."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.drawn import draws_nothing
from gamekeeper.audit.played_twice import program
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

SEEDS: Final = 16
"""Seeds that the program tries."""


@check(
    "GK600",
    needs=("unseeded",),
    severity=HIGH,
    mend="build the generator from `seed` in reset(), and draw from nothing else",
    applies=draws_nothing,
)
def seeds_make_a_difference(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Where a game draws at random, different seeds give different plays; the seed isn't ignored.

    Who trains on a thousand seeds trains on one, and a test on other seeds tests nothing. A game
    without any randomness keeps it: judged only where there is chance, seen in one of two ways.
    Resets without a seed lead to different openings, while 16 seeds give equal plays: where seeds
    are obeyed that needs one opening of a probability near 1, and happens in fewer than one of
    1,000 environments. Or resets without a seed give that same play too, and yet it goes another
    way where a generator that the environment holds is moved elsewhere in its stream after the
    reset, one that every reset begins at the same place. What is drawn in the reset alone, from a
    constant, is a layout like any other.

    Bad: a generator from the constructor, whatever the seed.

    ```python
    def __init__(self):
        self.rng = np.random.default_rng(42)
    def reset(self, seed=None, options=None):
        self.board = self.rng.permutation(9)
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.board = self.rng.permutation(9)
    ```
    """
    for look in evidence.looks.get("unseeded", ()):
        facts = {fact.name: fact for fact in look.facts}
        seeded = facts["seeded"].value
        openings = facts["openings"].value if "openings" in facts else ()
        if len(set(seeded)) > 1:
            yield Occasion(facts["seeded"].where, True, "plays that differ", "plays that differ")
        elif len(set(openings)) > 1:
            yield Occasion(
                facts["seeded"].where, False, "plays that differ, as unseeded ones do",
                f"{len(seeded)} seeds, and all of them give the same play",
                _proof(evidence.api),
            )  # fmt: skip
        elif "elsewhere" in facts and facts["elsewhere"].value is not None:
            yield Occasion(
                facts["elsewhere"].where, False, "plays that differ, as the game draws at random",
                f"all seeds and no seed give the same play; with other draws "
                f"{facts['elsewhere'].value}",
                _proof(evidence.api),
            )  # fmt: skip


def _proof(api: str) -> Proof:
    line = f"assert len({{play(make(), seed) for seed in range({SEEDS})}}) > 1"
    return program(api, line)
