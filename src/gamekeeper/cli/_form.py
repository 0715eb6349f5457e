"""The structure of an environment, looked at in a worker process and put together again here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gamekeeper.cli._screen import Screen
from gamekeeper.cli._worker import value_of_task

if TYPE_CHECKING:
    from gamekeeper.contract import Contract
    from gamekeeper.contract.toml import Question
    from gamekeeper.episodes.agent_spec import AgentSpec


@dataclass(frozen=True, slots=True)
class GameForm:
    """Structure of an environment: what it shows before its first step, and its contract.

    Attributes:
        name: of the environment.
        contract: declared, or drafted from what can be seen.
        is_declared: the contract is a file, not a draft.
        agents: spaces and role of each.
        questions: declarations that are missing.
        made_of: lines on its wrappers: those that `gk.make` replaces, and those that stay.
    """

    name: str
    contract: Contract
    is_declared: bool
    agents: tuple[AgentSpec, ...]
    questions: tuple[Question, ...]
    made_of: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper contract --json` prints."""
        from gamekeeper.reporting.card import card_json

        card = card_json(self.contract, self.agents, questions=self.questions)
        return {**card, "name": self.name, "declared": self.is_declared}


def look_at(
    spec: str,
    *,
    env_kwargs: Mapping[str, Any],
    contract: Path | None,
    silence_s: float,
    policies: Any = None,
) -> GameForm:
    """The structure of an environment; it is opened in a process of its own, never stepped.

    Args:
        policies: by agent, role or `*`; one that can't play there is refused.
    Raises:
        GamekeeperError: it can't be opened, or a contract or a policy doesn't fit.
        KeyboardInterrupt: by Ctrl-C.
    """
    task = "gamekeeper.runs.worker_tasks:contract_task"
    arguments = {
        "spec": spec,
        "env_kwargs": dict(env_kwargs),
        "contract": None if contract is None else str(contract),
        "policies": policies,
    }
    return _form(value_of_task(task, arguments, silence_s=silence_s))


def show_form(screen: Screen, form: GameForm) -> None:
    """Shows the card's short form."""
    from gamekeeper.reporting.results_text import brief_card

    screen.show(brief_card(form.contract, form.agents, name=form.name, width=screen.width))


def _form(value: Any) -> GameForm:
    from gamekeeper.contract import Contract
    from gamekeeper.contract.toml import Question
    from gamekeeper.episodes.agent_spec import agent_spec

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
    return GameForm(
        value["name"],
        contract,
        value["is_declared"],
        tuple(agents),
        tuple(questions),
        tuple(value["made_of"]),
    )


def _space(described: Any) -> Any:
    from gamekeeper.episodes.spaces.space_json import space_from_json

    return None if described is None else space_from_json(described)
