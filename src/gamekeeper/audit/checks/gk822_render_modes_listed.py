"""GK822."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LISTED = (
    "modes = make().metadata.get('render_modes', [])\n"
    "assert isinstance(modes, (list, tuple)), modes\n"
    "assert all(isinstance(mode, str) for mode in modes), modes"
)
DECLARED = (
    "env = make()\nmodes = env.metadata.get('render_modes', ())\n"
    "assert env.render_mode in modes, (env.render_mode, modes)"
)


@check(
    "GK822",
    needs=("metadata",),
    severity=LOW,
    mend='metadata = {"render_modes": ["human", "rgb_array"], ...}, with every mode that render() '
    "knows",
)
def render_modes_are_listed(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """metadata["render_modes"] is a list of texts, and has the mode that is in use.

    Tools choose a mode from it. Having none to choose from is no fault as long as nothing renders.

    Source: PettingZoo's `render_test`: "Environments that support rendering must define
    render_modes in metadata".

    Bad:
        metadata = {"name": "farm_v0", "render_modes": "rgb_array"}

    Good:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"]}
    """
    for fact in evidence.facts("metadata", "metadata"):
        fields, own = fact.value["fields"], fact.value["own"]
        modes = fields.get("render_modes", [])
        is_list = isinstance(modes, list | tuple) and all(isinstance(mode, str) for mode in modes)
        where = replace(fact.where, field="metadata.render_modes")
        if "render_modes" in fields:
            proof = Proof(LISTED, plays=False)
            yield Occasion(where, is_list, "a list of texts", modes, proof=proof)
        if own is not None and is_list:
            where = replace(fact.where, field="render_mode")
            proof = Proof(DECLARED, plays=False)
            seen = list(modes) if modes else "no render modes"
            yield Occasion(where, own in modes, f"{own!r} among them", seen, proof=proof)
