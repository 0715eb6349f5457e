"""The contract that an environment comes with, or that its user hands over."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract, Role
from gamekeeper.contract.sections import covers, patterns
from gamekeeper.contract.validation import Path as KeyPath
from gamekeeper.contract.validation import SourcePath, mistakes_in, nearest, together
from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import ContractError, GamekeeperError
from gamekeeper.interface.contract_draft import agent_specs
from gamekeeper.interface.env_source import Opened

MOST_AGENTS: Final = 12
"""Agents that an error names."""


def declared_contract(
    contract: Contract | str | PathLike[str] | None, opened: Opened
) -> Contract | None:
    """The contract for `opened`: the one handed over, else the one that lies beside it, else None.

    Beside an environment lies the file that its class names in `contract`, or the file of its
    module's name with the suffix `.toml`.

    Raises:
        ContractError: the file can't be read, contradicts itself, or doesn't fit the environment.
    """
    declared = _declared(contract, opened)
    if declared is not None:
        check_fit(declared, opened)
    return declared


def _declared(contract: Contract | str | PathLike[str] | None, opened: Opened) -> Contract | None:
    if isinstance(contract, Contract):
        return contract
    if contract is not None:
        return Contract.load(contract)
    own = getattr(opened.env.unwrapped, "contract", None)
    if isinstance(own, Contract):
        return own
    source = _source_file(opened.env.unwrapped)
    if source is None:
        return None
    beside = source.with_name(own) if isinstance(own, str) else source.with_suffix(".toml")
    return Contract.load(beside) if isinstance(own, str) or _is_contract(beside) else None


def _source_file(env: Any) -> Path | None:
    try:
        return Path(inspect.getfile(type(env)))
    except (TypeError, OSError):  # a class made in an interactive session has no file
        return None


def _is_contract(path: Path) -> bool:
    return path.name != "pyproject.toml" and path.is_file()


def check_fit(contract: Contract, opened: Opened) -> None:
    """Refuses a contract whose roles hold no agent, or whose noops are no actions of its agents.

    A roster that is only known after reset isn't judged. Arguments may leave a role without
    agents (a task for three pickers and no carrier), which is right as long as every agent is in a
    role.

    Raises:
        ContractError: lists each such declaration.
    """
    agents = [agent_name(each) for each in getattr(opened.env, "possible_agents", None) or ()]
    mistakes: list[GamekeeperError] = []
    if agents and not (
        opened.identity.get("kwargs") and all(contract.role_of(agent) for agent in agents)
    ):
        mistakes += _empty_roles(contract, agents)
    if any(role.noop is not None or role.mask is not None for role in contract.roles.values()):
        try:
            agent_specs(opened.env, contract)
        except ContractError as error:
            mistakes += mistakes_in(error)
    if mistakes:
        raise together(mistakes, contract.places)


def _empty_roles(contract: Contract, agents: list[str]) -> Iterator[GamekeeperError]:
    shown = ", ".join(agents[:MOST_AGENTS]) + ", ..." * (len(agents) > MOST_AGENTS)
    for name, role in contract.roles.items():
        if any(covers(name, role, agent) for agent in agents):
            continue
        place = SourcePath(contract.places, _place_of(contract, name))
        near = nearest(patterns(name, role)[0], agents)
        yield place.error(
            f"role {name!r} matches no agent of the environment",
            expected=f"a pattern of one of its possible agents: {shown}",
            actual=" or ".join(patterns(name, role)),
            fix=f"write a pattern that matches {near!r}, or leave the role out"
            if near
            else "write a pattern that matches one of them, or leave the role out",
        )


def _place_of(contract: Contract, name: str) -> KeyPath:
    """The place that says which agents a role holds; a stage, for one that stands only there."""
    if contract.roles[name] == Role():
        for number, stage in enumerate(contract.schedule.stages or ()):
            if name in stage and ("roles", name) not in contract.places.lines:
                return ("schedule", "stages", number, stage.index(name))
    return ("roles", name, "agents")
