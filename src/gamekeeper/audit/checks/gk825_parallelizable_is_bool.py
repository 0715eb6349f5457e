"""GK825."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PROOF: Final = "says = make().metadata['is_parallelizable']\nassert isinstance(says, bool), says"


@check(
    "GK825",
    needs=("metadata",),
    severity=LOW,
    mend='metadata = {"is_parallelizable": False, ...}',
)
def parallelizable_is_a_bool(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """metadata["is_parallelizable"], where it is there, is True or False.

    A converter asks whether it is true: the text "False" is.

    Bad:
        metadata = {"name": "farm_v0", "is_parallelizable": "False"}

    Good:
        metadata = {"name": "farm_v0", "is_parallelizable": False}
    """
    for fact in evidence.facts("metadata", "metadata"):
        if "is_parallelizable" in fact.value["fields"]:
            says = fact.value["fields"]["is_parallelizable"]
            where = replace(fact.where, field="metadata.is_parallelizable")
            proof = Proof(PROOF, plays=False)
            yield Occasion(where, isinstance(says, bool), "True or False", says, proof=proof)
