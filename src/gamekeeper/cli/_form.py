"""The game form of an environment, looked at in a worker process and put together again here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gamekeeper.cli._worker import error_in
from gamekeeper.run.workers import run_task

if TYPE_CHECKING:
    from gamekeeper.core.contract import Contract
    from gamekeeper.core.contract.agent_spec import AgentSpec
    from gamekeeper.core.contract.question import Question


@dataclass(frozen=True, slots=True)
class Form:
    """What can be seen of an environment from outside, and what is declared of it.

    Attributes:
        name: of the environment.
        contract: declared, or drafted from what can be seen.
        is_declared: somebody wrote the contract.
        agents: a line for each.
        questions: what is still open.
        made_of: lines on its wrappers: which of them `gk.make` replaces, which stay.
        policies: words for policies of its own, as `reference`.
    """

    name: str
    contract: Contract
    is_declared: bool
    agents: tuple[AgentSpec, ...]
    questions: tuple[Question, ...]
    made_of: tuple[str, ...] = ()
    policies: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper contract --json` prints."""
        from gamekeeper.report.card import card_json

        card = card_json(self.contract, self.agents, questions=self.questions)
        return {**card, "name": self.name, "declared": self.is_declared}


def look_at(
    spec: str, *, env_kwargs: Mapping[str, Any], contract: Path | None, silence_s: float
) -> Form:
    """The game form of an environment; it is opened in a process of its own, never stepped.

    Raises:
        GamekeeperError: it can't be opened, or a contract doesn't fit.
        KeyboardInterrupt: by Ctrl-C.
    """
    task = "gamekeeper.record.tasks:contract_task"
    arguments = {
        "spec": spec,
        "env_kwargs": dict(env_kwargs),
        "contract": None if contract is None else str(contract),
    }
    outcome = run_task(task, arguments, silence_s=silence_s)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    error = error_in(outcome)
    if error is not None:
        raise error
    return _form(outcome.value)


def _form(value: Any) -> Form:
    from gamekeeper.core.contract import Contract
    from gamekeeper.core.contract.agent_spec import agent_spec
    from gamekeeper.core.contract.question import Question

    contract = Contract.from_json(value["contract"])
    agents = [
        agent_spec(
            contract,
            each["name"],
            observation_space=_space(each["observation_space"]),
            action_space=_space(each["action_space"]),
        )
        for each in value["agents"]
    ]
    questions = [
        Question(**{**each, "path": tuple(each["path"]), "lines": tuple(each["lines"])})
        for each in value["questions"]
    ]
    return Form(
        value["name"],
        contract,
        value["is_declared"],
        tuple(agents),
        tuple(questions),
        tuple(value["made_of"]),
        tuple(value["policies"]),
    )


def _space(described: Any) -> Any:
    from gamekeeper.core.space.plain import space_from_json

    return None if described is None else space_from_json(described)
