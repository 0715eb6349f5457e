"""GK604."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.drawn import ignores_seeds
from gamekeeper.audit.played_twice import parted, settled_by_seed, told_of
from gamekeeper.audit.used import is_blind_later, used_beside_fresh
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK604",
    needs=("second_episode", "unseeded"),
    severity=HIGH,
    mend="set everything that the rules read in reset(), and take nothing over from the episode "
    "before",
    applies=settled_by_seed,
)
def nothing_survives_a_reset(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """reset(seed) starts the same play in a used instance as in a fresh one; no state survives it.

    Training runs thousands of episodes in one instance; where something of the last one is left,
    no episode can be played again on its own. The same episode goes before, or one of another seed
    that is cut in its middle.

    Bad: what one step has noted stays for the next episode.

    ```python
    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)   # and self.collected is as it was
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.collected = set()
    ```
    """
    if ignores_seeds(evidence):
        return  # an episode hangs on what was drawn before, which is another promise
    for look in evidence.looks.get("second_episode", ()):
        if is_blind_later(look):
            continue  # later seeds are ignored, which is another promise
        before = next((fact.value for fact in look.facts if fact.name == "before"), None)
        for twin in look.twins:
            proof = used_beside_fresh(evidence.api, before, told_of(contract, twin))
            yield from parted(twin, proof, expected="the same play as in a fresh instance")
