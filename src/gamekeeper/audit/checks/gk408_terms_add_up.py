"""GK408."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._terms import is_zero
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


def _undeclared(contract: Contract, evidence: Gathered) -> str | None:
    if not contract.rewards:
        return "no reward terms are declared"
    told = any(turn.terms for trace in evidence["rollout"] for turn in trace.turns)
    return None if told else "the environment doesn't tell its rewards by term (`terms`)"


@check(
    "GK408",
    needs=("rollout",),
    severity=HIGH,
    mend="pay every part of the reward under a term that the contract declares",
    applies=_undeclared,
)
def terms_add_up(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The declared reward terms add up to the reward: nothing is paid beside them.

    Attribution and the report tell who earned what by term; a part that has no term is credited to
    nobody.

    Bad:
    ```python
    self.pay(agent, 1.0, term="delivery")
    self.rewards[agent] += bonus              # under no term
    ```
    Good:
    ```python
    self.pay(agent, 1.0, term="delivery")
    self.pay(agent, bonus, term="bonus")      # declared: [rewards.bonus]
    ```
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            for agent, terms in turn.terms.items():
                reward = turn.rewards.get(agent)
                if reward is None:
                    continue
                left = reward - sum(terms.values())
                scale = abs(reward) + sum(map(abs, terms.values()))
                yield Occasion(
                    trace.at(turn, agent, "terms"), is_zero(left, scale),
                    f"{reward!r}, the reward", f"{dict(terms)!r}, which leaves {left!r}",
                    proof=_proof(evidence.api, agent),
                )  # fmt: skip


def _proof(api: str, agent: str) -> str:
    reward = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"paid = {{str(a): r for a, r in {reward}.items()}}[{agent!r}]\n"
        f"terms = {{str(a): t for a, t in env.unwrapped.terms.items()}}[{agent!r}]\n"
        f"assert np.isclose(sum(terms.values()), paid, atol=1e-9), (paid, terms)"
    )
