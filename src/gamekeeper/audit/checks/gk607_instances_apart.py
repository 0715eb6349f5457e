"""GK607."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.literal import literal
from gamekeeper.audit.played_twice import parted, place, program, settled_by_seed, told, told_of
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK607",
    needs=("alternated", "other_process"),
    severity=HIGH,
    mend="keep generators and state in the instance: set them in __init__ and reset, not on the "
    "class, the module or in a mutable default argument",
    applies=settled_by_seed,
)
def instances_share_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Instances of the environment share nothing: no generator and no state of a class or module.

    A vector environment steps many instances in turns, an evaluation runs beside the training; what
    one of them does then changes the others. A second instance is built, reset and stepped in
    turns with the first. Where an instance plays otherwise only because another one was there
    before, two new processes agree with each other.

    Bad:

    ```python
    class Game(ParallelEnv):
        rng = np.random.default_rng()
        def reset(self, seed=None, options=None):
            Game.rng = np.random.default_rng(seed)
    ```

    Good:

    ```python
    class Game(ParallelEnv):
        def reset(self, seed=None, options=None):
            self.rng = np.random.default_rng(seed)
    ```
    """
    for look in evidence.looks.get("alternated", ()):
        other = next((fact.value for fact in look.facts if fact.name == "other"), None)
        for twin in look.twins:
            proof = _beside(evidence.api, other, told_of(contract, twin))
            yield from parted(twin, proof, expected="the same play as alone")
    for look in evidence.looks.get("other_process", ()):
        if any(fact.name == "settled in new processes" and fact.value for fact in look.facts):
            for twin in look.twins:
                if twin.noise is not None:
                    line = "assert play(make()) == play(make())"
                    yield Occasion(
                        place(twin, twin.noise), False, "the same play as in a first instance",
                        told(twin.noise),
                        program(evidence.api, line, tells=told_of(contract, twin)),
                    )  # fmt: skip


def _beside(api: str, other: Any, tells: frozenset[str]) -> Proof:
    seed, actions = other or (0, ())
    turns = [dict(a) if api == "parallel" else next(iter(a.values()), None) for a in actions]
    return program(
        api,
        "alone = play(make())",
        "env, other = make(), make()",
        "calls = [lambda: None]",
        f"calls += [lambda: other.reset(seed={seed})]",
        f"calls += [lambda actions=actions: other.step(actions) for actions in {literal(turns)}]",
        "calls = iter(calls)",
        "assert alone == play(env, between=lambda: next(calls, lambda: None)())",
        tells=tells,
    )
