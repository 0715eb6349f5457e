"""GK242."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK242",
    needs=("spaces",),
    severity=LOW,
    mend="put plain data and arrays into infos, not functions, generators or the environment",
)
def infos_can_be_pickled(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Infos hold what can be pickled, and so sent from one process to another.

    Vector environments run copies in processes of their own and send infos through a pipe.

    Bad:

        infos[agent] = {"replay": lambda: self.history}

    Good:

        infos[agent] = {"replay": list(self.history)}
    """
    for fact in evidence.facts("spaces", "info"):
        why = fact.value["unpicklable"]
        infos = "env.infos" if evidence.api == "aec" else "infos"
        yield Occasion(
            fact.where, why is None, "an info that can be pickled", why,
            proof=Proof(
                f"for info in {infos}.values():\n    pickle.dumps(info)", imports=("pickle",)
            ),
        )  # fmt: skip
