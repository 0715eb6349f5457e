"""GK237."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._illegal import proof
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


def _none_declared(contract: Contract, evidence: Gathered) -> str | None:
    is_declared = any(role.illegal is not None for role in contract.roles.values())
    return None if is_declared else "the contract says of no role what a masked action brings"


@check(
    "GK237",
    needs=("illegal",),
    severity=HIGH,
    mend="do with a masked action what roles.<role>.illegal says, or declare what is done",
    applies=_none_declared,
)
def masked_actions_bring_what_is_declared(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """An action that the mask forbids raises, costs, or ends, as the contract declares.

    A learner without masks learns the rules from this alone: if what is forbidden is quietly taken,
    it learns another game.

    Bad:

        illegal = "error"             # and the environment plays the forbidden move

    Good:

        if not mask[action]: raise ValueError(f"{action} is forbidden now")
    """
    for fact in evidence.facts("illegal", "illegal"):
        role = contract.role_of(fact.where.agent)
        declared = None if role is None else contract.roles[role].illegal
        value: Mapping[str, Any] = fact.value
        if value["case"] != "masked" or declared is None:
            continue
        agent = str(fact.where.agent)
        yield Occasion(
            fact.where, _is_as(declared, value), EXPECTED[declared], _seen(value),
            proof=proof(evidence.api, fact.where.turn, value, _then(evidence.api, declared, agent)),
        )  # fmt: skip


EXPECTED = {
    "error": "the step raises",
    "penalty": "the agent is paid less than for a legal action, or less than 0",
    "end": "the agent has ended",
}


def _is_as(declared: str, value: Mapping[str, Any]) -> bool:
    if declared == "error":
        return value["raised"] is not None
    if value["raised"] is not None:
        return False
    if declared == "end":
        return bool(value["is_over"])
    paid, legal = value["reward"], value["legal_reward"]
    return paid is not None and (paid < 0 or (legal is not None and paid < legal))


def _seen(value: Mapping[str, Any]) -> str:
    if value["raised"] is not None:
        return f"it raised {value['raised']}"
    ended = "it has ended" if value["is_over"] else "it goes on"
    return f"the action was taken, it was paid {value['reward']}, {ended}"


def _then(api: str, declared: str, agent: str) -> str:
    if declared == "error":
        return "assert error is not None, 'the forbidden action was taken'"
    lines = ["assert error is None, error"]
    if declared == "end":
        over = f"all(str(a) != {agent!r} for a in env.agents)"
        if api == "aec":
            flags = (
                "{**env.terminations, **{a: True for a in env.truncations if env.truncations[a]}}"
            )
            over += f" or any(f for a, f in {flags}.items() if str(a) == {agent!r})"
        lines.append(f"assert {over}, 'it goes on'")
    else:
        rewards = "out[1]" if api == "parallel" else "env.rewards"
        lines.append(f"reward = next(r for a, r in {rewards}.items() if str(a) == {agent!r})")
        lines.append("assert reward < 0, reward")
    return "\n".join(lines)
