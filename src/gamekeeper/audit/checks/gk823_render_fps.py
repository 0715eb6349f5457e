"""GK823."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PICTURES: Final = ("rgb_array", "rgb_array_list")
PROOF: Final = "fps = make().metadata.get('render_fps')\nassert fps is not None and fps > 0, fps"


@check(
    "GK823",
    needs=("metadata",),
    severity=LOW,
    mend='metadata = {"render_fps": 10, ...}',
)
def pictures_have_a_rate(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An environment that renders pictures says in metadata["render_fps"] how many make a second.

    Recorders read it; where it is missing they guess (PettingZoo's take 30, which shows a board
    game thirty moves a second), or stop. No environment goes wrong for it, so this is a nuisance.

    Source: Gymnasium's `Env.metadata`; PettingZoo's `RecordVideo`.

    Bad:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"]}

    Good:
        metadata = {"name": "farm_v0", "render_modes": ["rgb_array"], "render_fps": 5}
    """
    for fact in evidence.facts("metadata", "metadata"):
        fields = fact.value["fields"]
        modes = fields.get("render_modes", ())
        if isinstance(modes, list | tuple) and any(mode in PICTURES for mode in modes):
            where = replace(fact.where, field="metadata.render_fps")
            fps = fields.get("render_fps")
            proof = Proof(PROOF, plays=False)
            yield Occasion(where, _is_rate(fps), "a number above 0", fps, proof=proof)


def _is_rate(fps: Any) -> bool:
    try:
        return not isinstance(fps, bool | str) and math.isfinite(fps) and float(fps) > 0
    except TypeError:
        return False
