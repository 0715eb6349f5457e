"""One agent's line of the structure: its role and noop beside its spaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.contract import Contract, Role
from gamekeeper.contract.sections import NONE, Plain, plain
from gamekeeper.contract.validation import nearest, shown
from gamekeeper.episodes.layout import agent_name
from gamekeeper.errors import ContractError

Space = spaces.Space[Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentSpec:
    """An agent, its role and its spaces; None is *not declared*, or a space that wasn't seen.

    Args:
        role: the role that holds it.
        observation_space: values that it may observe.
        action_space: values that it may choose.
        noop: the action that does nothing, as it is declared; `none`: there is none.
    """

    name: str
    role: str | None = None
    observation_space: Space | None = field(default=None, hash=False)
    action_space: Space | None = field(default=None, hash=False)
    noop: Plain | None = None

    def noop_action(self) -> object | None:
        """A fresh action that does nothing, in its space's own types; None where there is none.

        Without an action space it is the declared value.

        Raises:
            ValueError: the declared noop is no action of the space.
        """
        if self.noop is None or self.noop == NONE:
            return None
        return self.noop if self.action_space is None else as_action(self.action_space, self.noop)


def agent_spec(
    contract: Contract,
    agent: object,
    *,
    observation_space: Space | None = None,
    action_space: Space | None = None,
) -> AgentSpec:
    """The agent's line, checked against its spaces.

    Raises:
        ContractError: the declared noop is no action of the agent's, or its mask stands in an
            observation that has no such key; names the line of the contract.
    """
    name = contract.role_of(agent)
    role = Role() if name is None else contract.roles[name]
    spec = AgentSpec(
        name=agent_name(agent),
        role=name,
        observation_space=observation_space,
        action_space=action_space,
        noop=role.noop,
    )
    try:
        spec.noop_action()
    except ValueError:
        raise ContractError(
            f"the noop of role {spec.role!r} is no action of agent {spec.name!r}",
            where=contract.at("roles", str(spec.role), "noop"),
            expected=f"an action in {spec.action_space}",
            actual=shown(plain(spec.noop)),
            fix="declare the action that does nothing, or leave noop out",
        ) from None
    _check_mask(contract, spec, role.mask or "")
    return spec


def _check_mask(contract: Contract, spec: AgentSpec, mask: str) -> None:
    head, _, path = mask.partition(".")
    space = spec.observation_space
    if head != "observation" or space is None:
        return
    for key in path.split("."):
        known = list(space.spaces) if isinstance(space, spaces.Dict) else []
        if key not in known:
            near = nearest(key, known)
            raise ContractError(
                f"agent {spec.name!r} has no {mask!r} where its mask should stand",
                where=contract.at("roles", str(spec.role), "mask"),
                expected=f"a Dict observation with the key {key!r}",
                actual=", ".join(map(repr, known)) or shown(space),
                fix=f"write {near!r} in its place" if near else "name another place, or none",
            )
        space = space[key] if isinstance(space, spaces.Dict) else space


def as_action(space: Space, value: Plain) -> object:
    """The declared value as an action in the space's own types.

    Arrays are of the space's dtype; nothing is rounded, cut or broadcast on the way.

    Args:
        space: any space of Gymnasium but Graph, whose actions can't be declared.
        value: a number, text, list or table, as a contract holds it.
    Raises:
        ValueError: it is no action of the space.
    """
    action = _built(space, value)
    if not space.contains(action):
        raise ValueError(f"{shown(plain(value))} is outside {space}")
    return action


def _built(space: Space, value: Plain) -> object:
    if isinstance(space, spaces.Dict) and isinstance(value, Mapping):
        if set(value) == set(space.spaces):
            return {key: as_action(inner, value[key]) for key, inner in space.spaces.items()}
    elif isinstance(space, spaces.Tuple) and isinstance(value, tuple):
        if len(value) == len(space.spaces):
            return tuple(map(as_action, space.spaces, value))
    elif isinstance(space, spaces.OneOf) and isinstance(value, tuple) and len(value) == 2:
        index, inner = value
        if type(index) is int and 0 <= index < len(space.spaces):
            return index, as_action(space.spaces[index], inner)
    elif isinstance(space, spaces.Sequence) and isinstance(value, tuple) and not space.stack:
        return tuple(as_action(space.feature_space, item) for item in value)
    elif isinstance(space, spaces.Discrete | spaces.Text):
        if type(value) is (int if isinstance(space, spaces.Discrete) else str):
            return value
    elif isinstance(space, spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        return _array(space, value)
    raise ValueError(f"{shown(plain(value))} has not the form of {space}")


def _array(space: Space, value: Plain) -> np.ndarray[Any, Any]:
    """The numbers as an array of the space's dtype; only floats may lose digits."""
    try:
        given = np.array(plain(value))
    except ValueError:
        raise ValueError(f"{shown(plain(value))} has no shape that fits {space}") from None
    dtype = np.dtype(space.dtype)
    if given.dtype.kind not in "bif" or given.dtype.kind == "b" != dtype.kind:
        raise ValueError(f"{shown(plain(value))} are no numbers")
    with np.errstate(over="ignore", invalid="ignore"):
        made = given.astype(dtype)
    if made.shape != space.shape or (dtype.kind != "f" and not np.array_equal(made, given)):
        raise ValueError(f"{shown(plain(value))} doesn't fit {space}")
    return made
