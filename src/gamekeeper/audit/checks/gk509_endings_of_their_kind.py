"""GK509."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

FLAGS = {"termination": "terminated", "truncation": "truncated"}


def _undeclared(contract: Contract, evidence: Gathered) -> str | None:
    if not contract.endings:
        return "no endings are declared"
    named = any(trace.endings for trace in evidence["rollout"])
    return None if named else "the environment names no reasons in `endings`"


@check(
    "GK509",
    needs=("rollout",),
    severity=HIGH,
    mend="set the flag that the contract declares for the reason, or declare the reason's kind as "
    "it is: limits from outside truncate, rules of the task terminate",
    applies=_undeclared,
)
def endings_are_of_their_declared_kind(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """An ending that is declared a truncation truncates, one declared a termination terminates.

    A learner bootstraps past a truncation and not past a termination: told the one for the other
    it values the states before it wrongly.

    Bad: `battery = { kind = "truncation" }` in the contract, `self.terminate(agent, "battery")` in
    the rules.

    Good: `self.truncate(agent, "battery")`.
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            for agent in sorted(turn.ended):
                reason = trace.endings.get(agent)
                declared = None if reason is None else contract.endings.get(reason)
                if declared is None:
                    continue
                flag = FLAGS[declared.kind]
                other = next(kind for kind in FLAGS if kind != declared.kind)
                yield Occasion(
                    trace.at(turn, agent, "endings"), bool(getattr(turn, flag).get(agent)),
                    f"a {declared.kind} by {reason!r}", f"a {other}",
                    proof=_proof(evidence.api, agent, declared.kind),
                )  # fmt: skip


def _proof(api: str, agent: str, kind: str) -> Proof:
    book = f"{kind}s" if api == "parallel" else f"env.{kind}s"
    return Proof(f"flags = {book}\nassert flags.get({agent!r}), flags")
