"""Which of PettingZoo's two interfaces a task asks for, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

ORDER_SAYS: Final = {
    "fixed": "a fixed order",
    "rotating": "an order that rotates",
    "random": "an order that is drawn",
}


@dataclass(frozen=True, slots=True)
class Advice:
    """An interface, and the reason for it in one sentence; `reasons` are all that speak for it."""

    api: str
    why: str
    reasons: tuple[str, ...] = ()


def advise(stages: Sequence[Sequence[str]], *, order: str, observe: str, conflicts: str) -> Advice:
    """The interface that fits a schedule.

    AEC where what an agent sees, or whether it acts, hangs on what others did in the same round: a
    Parallel environment hands all observations out before anybody acts. Parallel everywhere else:
    it has no order that a policy could come to lean on, and a joint step is cheaper than turns.

    Args:
        stages: roles that act together, group after group.
        order: within a group.
        observe: observations show what was `after tick` or `after turn`.
        conflicts: what settles actions that exclude each other.
    """
    reasons = []
    if order == "state":
        reasons.append("who acts next depends on the state")
    if observe == "after turn":
        if len(stages) > 1:
            first, then = (" and ".join(stage) for stage in stages[:2])
            reasons.append(f"{then} must see what {first} did in the same round")
        elif order in ORDER_SAYS:
            reasons.append(f"agents act in {ORDER_SAYS[order]} and see each turn before theirs")
        else:
            reasons.append("an agent sees what others did in the same round before it acts")
    if conflicts == "ordered":
        reasons.append("of two actions that exclude each other the earlier one counts")
    if reasons:
        return Advice("aec", "; ".join(reasons), tuple(reasons))
    how = {"priority": "by priority", "random": "by a draw"}.get(conflicts, "by one joint rule")
    reason = f"nobody sees what others do in a round before acting, and a tick is resolved {how}"
    if len(stages) > 1:
        reason += ", group after group inside it"
    elif order in ORDER_SAYS:
        reason += f", in {ORDER_SAYS[order]} inside it"
    return Advice("parallel", reason, (reason,))
