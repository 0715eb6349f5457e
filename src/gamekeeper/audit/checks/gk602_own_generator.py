"""GK602."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.played_twice import parted, program, settled_by_seed, told_of
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK602",
    needs=("generators",),
    severity=HIGH,
    mend="draw from a generator of the environment's own, built in reset(seed): "
    "np.random.default_rng(seed)",
    applies=settled_by_seed,
)
def draws_come_from_an_own_generator(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The game draws from a generator of its own, not from the global ones of numpy, random, torch.

    Whoever else draws from them, a learner or a second environment, changes the game, and reset's
    seed doesn't settle it. They are seeded anew before the reset and between all turns; a play in
    which nobody does is compared with that.

    Bad:

    ```python
    def step(self, actions):
        wind = np.random.normal()
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
    def step(self, actions):
        wind = self.rng.normal()
    ```
    """
    for look in evidence.looks.get("generators", ()):
        moved = [fact.value[0] for fact in look.facts if fact.name == "moved"]
        for twin in look.twins:
            proof = _proof(evidence.api, moved, told_of(contract, twin))
            yield from parted(twin, proof, expected="the same, whoever draws from them")


def _proof(api: str, moved: list[str], tells: frozenset[str]) -> Proof:
    seeding = ["np.random.seed(n)", "random.seed(n)"]
    if "torch" in moved:
        seeding.append("torch.manual_seed(n)")
    return program(
        api,
        "def seed_all(n):",
        *(f"    {line}" for line in seeding),
        "seed_all(1)",
        "alone = play(make())",
        "seed_all(2)",
        "beside = play(make(), between=lambda: seed_all(3))",
        "assert alone == beside",
        tells=tells,
        imports=("random", *(["torch"] if "torch" in moved else [])),
    )
