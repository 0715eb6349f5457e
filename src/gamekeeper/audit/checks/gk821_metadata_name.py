"""GK821."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PROOF = "name = make().metadata.get('name')\nassert isinstance(name, str) and name, name"


@check(
    "GK821",
    needs=("metadata",),
    severity=LOW,
    mend='metadata = {"name": "farm_v0", ...}',
)
def metadata_names_the_environment(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Metadata is a dictionary and has the environment's name, as text.

    Results and videos are filed under it. Nothing in PettingZoo stops without: `str(env)` then is
    the name of the class.

    Bad:
        metadata = {"render_modes": ["rgb_array"]}

    Good:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"]}
    """
    for fact in evidence.facts("metadata", "metadata"):
        name, kind = fact.value["fields"].get("name"), fact.value["kind"]
        is_named = kind == "dict" and isinstance(name, str) and bool(name.strip())
        seen = name if kind == "dict" else f"metadata is a {kind}"
        where = replace(fact.where, field="metadata.name")
        yield Occasion(where, is_named, "a name", seen, proof=Proof(PROOF, plays=False))
