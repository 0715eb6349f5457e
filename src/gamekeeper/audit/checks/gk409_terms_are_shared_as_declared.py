"""GK409."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._terms import Paid, all_paid, is_zero
from gamekeeper.core.contract import Contract, RewardTerm
from gamekeeper.core.gathered import Gathered

JUDGED: Final = ("shared", "zero-sum")


def _undeclared(contract: Contract, evidence: Gathered) -> str | None:
    if not any(term.kind in JUDGED for term in contract.rewards.values()):
        return "no term is declared as shared or as zero-sum"
    return None


@check(
    "GK409",
    needs=("rollout",),
    severity=HIGH,
    mend="pay a shared term to all its payees alike and let a zero-sum term's payments cancel out "
    "in every step, or declare another kind",
    applies=_undeclared,
)
def terms_are_shared_as_declared(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A shared reward term pays all its payees the same, and a zero-sum term's payments sum to 0.

    Looked at in every step, among payees that hadn't ended before it. Methods for teams assume one
    common reward, methods for two players that one's gain is the other's loss.

    Bad:
    ```toml
    [rewards.delivery]
    kind = "shared"                           # and only who delivers is paid
    ```
    Good:
    ```python
    for agent in self.agents:
        self.pay(agent, 1.0, term="delivery")
    ```
    """
    for paid in all_paid(contract, evidence):
        for name, term in contract.rewards.items():
            if term.kind in JUDGED and name in paid.terms:
                yield from _look(contract, evidence.api, paid, name, term)


def _look(
    contract: Contract, api: str, paid: Paid, name: str, term: RewardTerm
) -> Iterator[Occasion]:
    values = {
        agent: paid.terms[name].get(agent, 0.0)
        for agent in sorted(paid.payable)
        if _is_payee(contract, term, agent)
    }
    if len(values) < 2 or not any(values.values()):
        return
    scale = sum(map(abs, values.values()))
    is_shared = term.kind == "shared"
    left = max(values.values()) - min(values.values()) if is_shared else sum(values.values())
    yield Occasion(
        paid.trace.at(paid.turn, None, "rewards"), is_zero(left, scale),
        f"{name}: the same for all payees" if is_shared else f"{name}: payments that sum to 0",
        f"{values!r}", proof=_proof(api, name, list(values), is_shared=is_shared),
    )  # fmt: skip


def _is_payee(contract: Contract, term: RewardTerm, agent: str) -> bool:
    payees = term.payee or ("all",)
    return "all" in payees or contract.role_of(agent) in payees


def _proof(api: str, name: str, payees: list[str], *, is_shared: bool) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    fault = "max(paid) - min(paid)" if is_shared else "sum(paid)"
    return (
        f"terms = getattr(env.unwrapped, 'terms', None) or {{}}\n"
        f"found = {{str(a): t.get({name!r}, 0.0) for a, t in terms.items()}}\n"
        f"found = found or {{str(a): r for a, r in {rewards}.items()}}\n"
        f"paid = [found.get(a, 0.0) for a in {payees!r}]\n"
        f"assert abs({fault}) < 1e-9 * max(1.0, sum(map(abs, paid))), paid"
    )
