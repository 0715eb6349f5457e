"""GK831."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._growth import COUNTS, LEAST_TURNS, is_rising, means
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

FACTOR: Final = 2.0
LEAST: Final = {"lines": 100.0, "passing": 4096.0}
"""Lines of Python, and bytes taken at the peak, by which a step must have grown."""
WORDS: Final = {"lines": "lines of Python a step", "passing": "bytes taken by a step"}
PROOF: Final = """\
env = make()
env.reset(seed=SEED)
costs = []
def turn(action):
    {look}env.step(action)
for action in ACTIONS:
    costs.append(work(turn, action))
part = len(costs) // 8
first, last = sum(costs[:part]) / part, sum(costs[-part:]) / part
assert last[{column}] < 2 * first[{column}], ('lines and bytes a step, first and last', first, last)
"""


@check(
    "GK831",
    needs=("long",),
    severity=LOW,
    confidence=0.9,
    mend="keep what is needed of the past up to date in step(), instead of going through all of it "
    "again",
)
def steps_cost_the_same_all_along(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The cost of a step doesn't grow with the length of the episode.

    A step, or an observation, that goes through the whole history makes an episode's cost
    quadratic. Counted are lines of Python and bytes, not seconds, so the verdict is the same on
    every run; work inside compiled code that takes no memory isn't seen. The play is cut into eight
    stretches of equal length; the cost counts as growing where it rises from each to the next but
    one, to twice the first and by a hundred lines or 4 kB; where two plays were looked at, in both.
    Growth that agents who joined explain isn't counted.

    Bad:
        self.history.append(self.cells.copy())
        self.path = sum(np.linalg.norm(b - a) for a, b in pairwise(self.history))

    Good:
        self.path += np.linalg.norm(self.cells - before)
    """
    plays = [
        fact
        for fact in evidence.facts("long", "work")
        if len(fact.value.get("live", ())) >= LEAST_TURNS
    ]
    for name, least in LEAST.items():
        looks = [means(_by_agent(fact.value, name)) for fact in plays]
        if not looks:
            return
        is_growing = all(is_rising(look, factor=FACTOR, least=least) for look in looks)
        first, last = round(looks[0][0]), round(looks[0][-1])
        look = "" if evidence.api == "parallel" else "env.last()\n    "
        column = 0 if name == "lines" else 1
        proof = Proof(
            COUNTS + PROOF.format(look=look, column=column),
            plays=False, imports=("sys", "tracemalloc"),
        )  # fmt: skip
        yield Occasion(
            _where(plays[0].where, name), not is_growing, f"about {first} {WORDS[name]}",
            f"{last} after {len(plays[0].value['live'])} turns", proof=proof,
        )  # fmt: skip


def _by_agent(work: Mapping[str, Sequence[int]], name: str) -> list[float]:
    """The series, scaled down where there are more agents than at first."""
    live = work["live"]
    return [value / max(now / live[0], 1.0) for value, now in zip(work[name], live, strict=True)]


def _where(where: Any, name: str) -> Any:
    return type(where)(where.probe, where.play, None, None, f"step.{name}")
