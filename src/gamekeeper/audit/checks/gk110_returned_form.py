"""GK110."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

EXPECTED: Final = {
    True: "a pair of dictionaries: observations, infos",
    False: "five dictionaries: observations, rewards, terminations, truncations, infos",
}
LAST: Final = "a tuple of five: observation, reward, terminated, truncated, info"
PROOF_AEC: Final = "out = env.last()\nassert isinstance(out, tuple) and len(out) == 5, out"
PROOF: Final = Proof(
    """\
env = make()
out, count = env.reset(seed=SEED), 2
for actions in ACTIONS:
    out, count = env.step(actions), 5
assert isinstance(out, tuple) and len(out) == count, out
assert all(isinstance(part, typing.Mapping) for part in out), out""",
    plays=False,
    imports=("typing",),
)


@check(
    "GK110",
    needs=("surface",),
    severity=HIGH,
    mend="return (observations, infos) from reset and (observations, rewards, terminations, "
    "truncations, infos) from step, each a dictionary by agent, also once the episode is over; "
    "leave last() as AECEnv has it",
)
def reset_returns_two_dictionaries_and_step_five(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """A reset returns two dictionaries by agent, a step five, and last() five values; never fewer.

    The first two are for Parallel environments, `last()` is for AEC ones. Every loop unpacks them.
    Four values are the form of before PettingZoo 1.24, which had no truncations; one flag for all
    can't say who has ended.

    Bad: `return observations, rewards, dones, infos`.

    Good: `return observations, rewards, terminations, truncations, infos`.
    """
    for fact in evidence.facts("surface", "returned"):
        for turn, wrong in enumerate(fact.value):
            if evidence.api == "aec":
                where = replace(fact.where, turn=turn, field="what last returns")
                yield Occasion(where, not wrong, LAST, wrong, proof=PROOF_AEC)
                continue
            field = "what step returns" if turn else "what reset returns"
            yield Occasion(
                replace(fact.where, turn=turn, field=field), not wrong,
                EXPECTED[not turn], wrong, proof=PROOF,
            )  # fmt: skip
