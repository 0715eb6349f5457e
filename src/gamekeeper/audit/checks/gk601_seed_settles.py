"""GK601."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.played_twice import parted, program, settled_by_seed, told_of
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

AGAIN: Final = 8
"""Plays that the program compares: of few possible ones two are often equal."""


@check(
    "GK601",
    needs=("same_seed", "other_process"),
    severity=HIGH,
    mend="draw everything from one generator that reset(seed) builds from the seed; nothing from "
    "the clock, the system's entropy, or spaces that nobody seeded",
    applies=settled_by_seed,
)
def seed_settles_the_play(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A seed settles the play: after reset(seed) the same actions give the same play again.

    Otherwise the seed is ignored, or part of the randomness isn't seeded, and no result can be
    reproduced. Observations, masks, infos, rewards, ends, the order of agents and state() are
    compared, over whole episodes; the generators of numpy, random and torch that all of a process
    shares are held still meanwhile (see GK602). Options that are empty make no difference either,
    nor does the time of day.

    Bad:

    ```python
    def step(self, actions):
        wind = np.random.default_rng().normal()
    ```

    Good:

    ```python
    def step(self, actions):
        wind = self.rng.normal()
    ```
    """
    if any(fact.value for fact in evidence.facts("other_process", "settled in new processes")):
        return  # instances share something, and that is another promise
    for twin in evidence.twins("same_seed"):
        if twin.change["change"] == "nothing":
            yield from parted(twin, _again(evidence.api, told_of(contract, twin)))
        elif twin.change["change"] == "the time of day":
            proof = _later(evidence.api, twin.change["later_s"], told_of(contract, twin))
            yield from parted(twin, proof, expected="the same play, whatever the clock says")
        elif not any(each.divergence for each in evidence.twins("same_seed") if each is not twin):
            yield from parted(twin, _empty(evidence.api), expected="as without options")


def _again(api: str, tells: frozenset[str]) -> Proof:
    return program(api, f"assert len({{play(make()) for _ in range({AGAIN})}}) == 1", tells=tells)


def _later(api: str, seconds: int, tells: frozenset[str]) -> Proof:
    lines = (
        "first, now = play(make()), time.time",
        f"time.time = lambda: now() + {seconds}  # as if it were run again later",
        f"time.time_ns = lambda: int(now() + {seconds}) * 10**9",
        "assert play(make()) == first",
    )
    return program(api, *lines, tells=tells, imports=("time",))


def _empty(api: str) -> Proof:
    see = "seen" if api == "parallel" else "env.last()"
    lines = ["def first(**options):", "    env = make()"]
    lines.append("    seen = env.reset(seed=SEED, **options)")
    lines += [f"    return repr({see})", "assert first() == first(options={})"]
    return Proof("\n".join(lines), plays=False)
