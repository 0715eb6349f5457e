"""GK603."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.played_twice import program, settled_by_seed
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK603",
    needs=("generators",),
    severity=MEDIUM,
    mend="leave np.random.seed, random.seed and torch.manual_seed to whoever runs the environment; "
    "build a generator of the environment's own",
)
def global_generators_are_left_alone(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The environment leaves the global generators of numpy, random and torch as they are.

    One that seeds them makes the exploration of a learner repeat itself with every episode, and
    results of a whole run hang on how often it was reset. Not looked at where the game's own draws
    come from them: that is GK602.

    Bad:

    ```python
    def reset(self, seed=None, options=None):
        np.random.seed(seed)
    ```

    Good:

    ```python
    def reset(self, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
    ```
    """
    is_judged = settled_by_seed(contract, evidence) is None
    for look in evidence.looks.get("generators", ()):
        parts = any(twin.divergence is not None and twin.noise is None for twin in look.twins)
        if parts and is_judged:
            continue
        for fact in look.facts:
            if fact.name == "left alone":
                yield Occasion(fact.where, True, "as it was", "as it was")
            elif fact.name == "moved":
                name, call = fact.value
                yield Occasion(
                    fact.where, False, "as it was", f"{name} was seeded or drawn from in {call}",
                    _proof(evidence.api, name),
                )  # fmt: skip


def _proof(api: str, name: str) -> Proof:
    state = {
        "numpy.random": "[list(part) if hasattr(part, '__len__') else part "
        "for part in np.random.get_state()]",
        "random": "random.getstate()",
        "torch": "torch.get_rng_state().tolist()",
    }[name]
    lines = [f"state = lambda: {state}", "before = state()", "play(make())"]
    imports = () if name == "numpy.random" else (name,)
    return program(api, *lines, "assert state() == before", imports=imports)
