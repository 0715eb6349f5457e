"""GK203."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK203",
    needs=("spaces",),
    severity=HIGH,
    mend="declare the largest space that any episode needs, and mask or pad what isn't used",
)
def spaces_stay_the_same(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent's spaces never change: not by a reset, not in an episode, not in the next one.

    Networks are built for the spaces once. What is drawn from a space that has changed since is
    outside of what the environment, or the network, now takes.

    Bad:

        def reset(self, seed=None, options=None):
            self.action_spaces[agent] = Discrete(self.rng.integers(3, 6))

    Good:

        Discrete(5), and an action mask for the actions that aren't there this time
    """
    for fact in evidence.facts("spaces", "unlike"):
        value, agent, name = fact.value, str(fact.where.agent), fact.where.field
        yield Occasion(
            fact.where, bool(value["is_same"]), value["was"], value["now"],
            proof=_proof(agent, name, is_later=value["when"] == "after another reset"),
        )  # fmt: skip


def _proof(agent: str, name: str, *, is_later: bool) -> Proof:
    """The space before the play, copied, against the one after it, or after the next reset."""
    again = "env.reset(seed=None if SEED is None else SEED + 1)\n" if is_later else ""
    find = f"next(a for a in env.possible_agents if str(a) == {agent!r})"
    return Proof(
        f"{again}agent = {find}\n"
        "fresh = make()\n"
        "try:\n"
        f"    before = fresh.{name}(agent)\n"
        "except Exception:  # spaces that exist only after a reset\n"
        "    fresh.reset(seed=SEED)\n"
        f"    before = fresh.{name}(agent)\n"
        f"assert env.{name}(agent) == copy.deepcopy(before), (before, env.{name}(agent))",
        imports=("copy",),
    )
