"""The contract that an environment comes with, or that its user hands over."""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.contract import Contract, Role
from gamekeeper.contract.contradictions import CHANGING
from gamekeeper.contract.sections import patterns
from gamekeeper.contract.validation import Path as KeyPath
from gamekeeper.contract.validation import SourcePath, mistakes_in, nearest, together
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.layout import role as stem_of
from gamekeeper.errors import ContractError, GamekeeperError
from gamekeeper.interface.authoring import Authored
from gamekeeper.interface.contract_draft import agent_specs, spaces_of
from gamekeeper.interface.conversion import is_parallelizable
from gamekeeper.interface.env_source import Opened, api_of, possible_agents_of

MOST_AGENTS: Final = 12
"""Agents that an error names."""


def check_fit(contract: Contract, opened: Opened) -> None:
    """Refuses a contract that contradicts the environment: its name, API, agents, spaces, horizon.

    A roster that is only known after reset isn't judged. Arguments may leave a role without
    agents (a task for three pickers and no carrier), which is right as long as every agent is in a
    role; nor is then judged what follows from the number of agents, or the horizon.

    Raises:
        ContractError: lists each such declaration.
    """
    agents = [agent_name(each) for each in possible_agents_of(opened.env)]
    is_default = not opened.identity.get("kwargs")
    mistakes = [*_name_mistakes(contract, opened), *_api_mistakes(contract, opened)]
    if agents:
        mistakes += _roster_mistakes(contract, agents, is_default=is_default)
        mistakes += _symmetry_mistakes(contract, opened)
    if is_default:
        mistakes += _horizon_mistakes(contract, opened)
    if any(role.noop is not None or role.mask is not None for role in contract.roles.values()):
        try:
            agent_specs(opened.env, contract)
        except ContractError as error:
            mistakes += mistakes_in(error)
    if mistakes:
        raise together(mistakes, contract.places)


def _place(contract: Contract, *path: str) -> SourcePath:
    return SourcePath(contract.places, path)


def _name_mistakes(contract: Contract, opened: Opened) -> Iterator[GamekeeperError]:
    """The name is another environment's; an environment without a name isn't judged."""
    metadata = getattr(opened.env, "metadata", None)
    name = metadata.get("name") if isinstance(metadata, Mapping) else None
    declared = contract.name
    if not isinstance(name, str) or declared is None:
        return
    if declared.replace("-", "_") != name.replace("-", "_"):
        yield _place(contract, "name").error(
            f"the contract is of {declared!r}, and the environment calls itself {name!r}",
            expected=name,
            actual=declared,
            fix=f"hand over the contract of {name!r}; or write its name, where the rest is true of "
            "it",
        )


def _api_mistakes(contract: Contract, opened: Opened) -> Iterator[GamekeeperError]:
    """The API is neither the one that is used, nor that of the environment before conversion."""
    if contract.api is None or contract.api in _apis(opened):
        return
    base = "AECEnv" if opened.api == "aec" else "ParallelEnv"
    yield _place(contract, "api").error(
        f"the contract declares api = {contract.api!r}, and the environment is a {base}",
        expected=opened.api,
        actual=contract.api,
        fix=f'write api = "{opened.api}", or hand over the contract of this environment',
    )


def _apis(opened: Opened) -> set[str | None]:
    """The APIs that may be declared: of the environment, under its conversions, of its rounds."""
    apis = {opened.api, api_of(getattr(opened.env, "unwrapped", None))}
    if opened.api == "aec" and is_parallelizable(opened.env):
        apis.add("parallel")
    return apis


def _roster_mistakes(
    contract: Contract, agents: Sequence[str], *, is_default: bool
) -> Iterator[GamekeeperError]:
    roles: dict[str, list[str]] = {name: [] for name in contract.roles}
    stray: list[str] = []
    for agent in agents:
        role = contract.role_of(agent)
        (stray if role is None else roles[role]).append(agent)
    empty = [name for name, members in roles.items() if not members]
    if empty and (is_default or stray):
        yield from (_empty_role(contract, name, agents) for name in empty)
    elif stray and roles:
        yield _stray_agents(contract, stray)
    if is_default:
        yield from _number_mistakes(contract, roles)


def _empty_role(contract: Contract, name: str, agents: Sequence[str]) -> GamekeeperError:
    wanted = patterns(name, contract.roles[name])
    near = nearest(wanted[0], agents)
    return SourcePath(contract.places, _place_of(contract, name)).error(
        f"role {name!r} matches no agent of the environment",
        expected=f"a pattern of one of its possible agents: {_listed(agents)}",
        actual=" or ".join(wanted),
        fix=f"write a pattern that matches {near!r}, or leave the role out"
        if near
        else "write a pattern that matches one of them, or leave the role out",
    )


def _stray_agents(contract: Contract, stray: Sequence[str]) -> GamekeeperError:
    stem = stem_of(stray[0])
    pattern = stray[0] if stem == stray[0] else f"{stem}_*"
    declared = [
        pattern for name, role in contract.roles.items() for pattern in patterns(name, role)
    ]
    return _place(contract, "roles").error(
        f"no role matches {_listed([repr(agent) for agent in stray])}",
        expected="each possible agent in a role",
        actual=", ".join(declared),
        fix=f'add a role: [roles.{stem}] with agents = "{pattern}"; or widen a pattern',
    )


def _listed(agents: Sequence[str]) -> str:
    return ", ".join(agents[:MOST_AGENTS]) + ", ..." * (len(agents) > MOST_AGENTS)


def _number_mistakes(contract: Contract, roles: dict[str, list[str]]) -> Iterator[GamekeeperError]:
    """Declarations that take more agents than there are."""
    stages = contract.schedule.stages or ((*roles,),)
    sizes = [sum(len(roles.get(name, ())) for name in stage) for stage in stages]
    if contract.schedule.order in CHANGING and roles and max(sizes) == 1:
        yield _place(contract, "schedule", "order").error(
            "each stage has one agent, which leaves no order to change",
            expected='"fixed", or "none"',
            actual=contract.schedule.order,
            fix='write order = "fixed"',
        )
    for name, term in contract.rewards.items():
        paid = [*roles] if term.payee == ("all",) else list(term.payee or ())
        count = sum(len(roles.get(role, ())) for role in paid)
        if term.kind == "zero-sum" and term.payee and count == 1:
            yield _place(contract, "rewards", name, "payee").error(
                f"the zero-sum term {name!r} has one payee in this environment, so it always pays "
                "0",
                expected="two payees or more",
                actual=", ".join(agent for role in paid for agent in roles.get(role, ())),
                fix="name the other payees, or another kind",
            )


def _symmetry_mistakes(contract: Contract, opened: Opened) -> Iterator[GamekeeperError]:
    """Roles that are declared symmetric, two of whose agents have different spaces."""
    first: dict[str, tuple[Any, Any]] = {}
    for agent in opened.env.possible_agents:
        name = contract.role_of(agent)
        if name is None or not contract.roles[name].symmetric:
            continue
        kind = spaces_of(opened.env, agent)
        other, known = first.setdefault(name, (agent, kind))
        if known == kind or None in (*known, *kind):
            continue
        place = 0 if known[0] != kind[0] else 1
        side = "observation" if place == 0 else "action"
        yield _place(contract, "roles", name, "symmetric").error(
            f"agents of role {name!r} aren't interchangeable: {agent_name(other)!r} and "
            f"{agent_name(agent)!r} have different {side} spaces",
            expected=str(known[place]),
            actual=str(kind[place]),
            fix="write symmetric = false, or give them roles of their own",
        )
        return


def _horizon_mistakes(contract: Contract, opened: Opened) -> Iterator[GamekeeperError]:
    """The horizon of a contract that isn't the class's own, where the base class keeps another."""
    own, horizon = getattr(opened.env, "unwrapped", None), contract.schedule.horizon
    if horizon is None or not isinstance(own, Authored):
        return
    try:
        own_horizon = own.known_sections()["schedule"].horizon
        is_own = own.declared == contract
    except ContractError:  # its own contract can't be read, and isn't the one that is asked for
        return
    if own_horizon is not None and own_horizon != horizon and not is_own:
        yield _place(contract, "schedule", "horizon").error(
            f"the environment truncates after {own_horizon} ticks",
            expected=str(own_horizon),
            actual=horizon,
            fix=f"write horizon = {own_horizon}, or build the environment with horizon={horizon}",
        )


def _place_of(contract: Contract, name: str) -> KeyPath:
    """The place that says which agents a role holds; a stage, for one that stands only there."""
    if contract.roles[name] == Role():
        for number, stage in enumerate(contract.schedule.stages or ()):
            if name in stage and ("roles", name) not in contract.places.lines:
                return ("schedule", "stages", number, stage.index(name))
    return ("roles", name, "agents")


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
