"""GK833."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

WARM: Final = 4
"""Episodes in which caches may fill."""
LEAST_BYTES: Final = 300
"""An episode may leave that much: a line of a log."""
PROOF: Final = """\
env = make()
def episode():
    env.reset(seed=SEED)
    for action in ACTIONS:
        {look}env.step(action)
for _ in range(4):
    episode()
tracemalloc.start()
others = [tracemalloc.Filter(False, name) for name in ("*_arraypad_impl.py", tracemalloc.__file__)]
sizes = []
for _ in range(12):
    episode()
    gc.collect()
    taken = tracemalloc.take_snapshot().filter_traces(others).traces
    sizes.append(sum(each.size for each in taken))
assert min(np.diff(sizes[2:])) < 300, ('bytes in use after each episode', sizes)
"""


@check(
    "GK833",
    needs=("repeated",),
    severity=LOW,
    mend="let go in reset() of what belongs to an episode",
)
def episodes_leave_nothing_behind(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An episode leaves no memory behind: what is in use doesn't grow from episode to episode.

    A leak ends a long training run after hours. One short play is repeated from the same seed in
    one instance. Nine of ten episodes, after the first four, leaving 300 bytes or more are a leak.
    Memory that compiled libraries take by themselves isn't seen, nor what NumPy's own `pad` keeps.

    Bad:
        def reset(self, seed=None, options=None):
            self.episodes.append([])                  # and step() writes into the last one

    Good:
        def reset(self, seed=None, options=None):
            self.episode = []
    """
    for fact in evidence.facts("repeated", "episodes"):
        left = [after - before for before, after in pairwise(fact.value["sizes"][WARM:])]
        often = sum(size >= LEAST_BYTES for size in left)
        look = "" if evidence.api == "parallel" else "env.last()\n        "
        lines = PROOF.format(look=look)
        yield Occasion(
            replace(fact.where, field="episodes.memory"), often < 0.9 * len(left),
            f"less than {LEAST_BYTES} bytes more an episode",
            f"{sorted(left)[len(left) // 2]} bytes more an episode",
            proof=Proof(lines, plays=False, imports=("gc", "tracemalloc")),
        )  # fmt: skip
