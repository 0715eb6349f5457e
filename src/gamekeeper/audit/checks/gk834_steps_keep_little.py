"""GK834."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._growth import LEAST_TURNS
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LEAST_BYTES: Final = 32 << 10
"""A step may keep that much: a game may know its history."""
PROOF: Final = """\
env = make()
env.reset(seed=SEED)
tracemalloc.start()
sizes = []
for action in ACTIONS:
    {look}env.step(action)
    sizes.append(tracemalloc.get_traced_memory()[0])
assert np.median(np.diff(sizes)) < 32768, ('bytes in use after each step', sizes)
"""


@check(
    "GK834",
    needs=("long",),
    severity=LOW,
    mend="keep what the rules need of the past, not whole observations or pictures",
)
def steps_keep_little(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A step keeps no more than 32 kB of memory until the end of the episode.

    Many copies of the environment run at once, and each would hold a whole film of its episode. A
    game may know its history: only every second step that keeps so much, over forty turns or more,
    is called a fault.

    Bad:
        self.film.append(self.draw())

    Good:
        self.moves.append(action)
    """
    for fact in evidence.facts("long", "work"):
        if len(fact.value.get("sizes", ())) >= LEAST_TURNS:
            kept = sorted(after - before for before, after in pairwise(fact.value["sizes"]))
            middle = kept[len(kept) // 2]
            look = "" if evidence.api == "parallel" else "env.last()\n    "
            proof = Proof(PROOF.format(look=look), plays=False, imports=("tracemalloc",))
            yield Occasion(
                replace(fact.where, field="step.memory"), middle < LEAST_BYTES,
                f"less than {LEAST_BYTES} bytes a step", f"{middle} bytes a step", proof=proof,
            )  # fmt: skip
