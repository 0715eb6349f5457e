"""GK832."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._growth import COUNTS, is_rising
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

WARM: Final = 2
"""Episodes in which caches may fill."""
FACTOR: Final = 1.1
LEAST: Final = {"lines": 60.0, "passing": 2048.0}
WORDS: Final = {"lines": "lines of Python", "passing": "bytes at the peak"}
PROOF: Final = """\
env = make()
def episode():
    env.reset(seed=SEED)
    for action in ACTIONS:
        {look}env.step(action)
costs = [work(episode) for _ in range(14)][2:]
assert costs[-1][{column}] < 1.1 * costs[0][{column}], ('lines and bytes by episode', costs)
"""


@check(
    "GK832",
    needs=("repeated",),
    severity=LOW,
    mend="empty in reset() what step() has gathered",
)
def episodes_cost_the_same(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The cost of an episode doesn't grow with the number of episodes before it.

    Otherwise training becomes slower day by day, although nothing of the game has changed. One
    short play is repeated from the same seed in one instance; lines of Python and bytes are
    counted, so the verdict is the same on every run. After two episodes in which caches may fill,
    the last may cost a tenth more than the first at most, or rise and fall.

    Bad:
        def reset(self, seed=None, options=None):
            self.totals = [sum(log) for log in self.logs]      # of all episodes ever

    Good:
        def reset(self, seed=None, options=None):
            self.log = []
    """
    for fact in evidence.facts("repeated", "episodes"):
        for name, least in LEAST.items():
            costs = fact.value[name][WARM:]
            is_growing = is_rising(costs, factor=FACTOR, least=least)
            look = "" if evidence.api == "parallel" else "env.last()\n        "
            lines = PROOF.format(look=look, column=0 if name == "lines" else 1)
            proof = Proof(COUNTS + lines, plays=False, imports=("sys", "tracemalloc"))
            yield Occasion(
                replace(fact.where, field=f"episodes.{name}"), not is_growing,
                f"about {costs[0]} {WORDS[name]} an episode",
                f"{costs[-1]} after {len(costs)} more", proof=proof,
            )  # fmt: skip
