"""GK204."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK204",
    needs=("spaces",),
    severity=HIGH,
    mend="give bounds with low <= high, at least one value, and a sample() that is in the space",
)
def spaces_are_sound(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every space can hold a value: low isn't above high, no bound is NaN, sample() gives a member.

    Nothing is in a space whose bounds are the wrong way round; normalising by it flips signs or
    divides by nothing.

    Bad:

        space.low, space.high = space.high, space.low

    Good:

        spaces.Box(low=-1.0, high=1.0, shape=(2,), dtype=np.float32)
    """
    for fact in evidence.facts("spaces", "sound"):
        found, name, agent = fact.value["faults"], fact.where.field, str(fact.where.agent)
        yield Occasion(
            fact.where, not found, "a space that holds values", "; ".join(found),
            proof=(
                f"agent = next(a for a in env.possible_agents if str(a) == {agent!r})\n"
                f"space = env.{name}(agent)\n"
                "assert space.contains(space.sample()), space"
            ),
        )  # fmt: skip
