"""`noop`: always the action that the contract declares to do nothing."""

import copy
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Dict, Space, Tuple

from gamekeeper.errors import PolicyError
from gamekeeper.interface.policy import AgentSlot, Start

VERSION: Final = "1"
"""Changes when it would choose other actions."""


def start_for(given: AgentSlot) -> Start:
    """The declared action in the space's own types; arrays are new at every turn.

    Raises:
        PolicyError: the contract declares none for this agent, or one that isn't in its action
            space.
    """
    check(given.agent, given.role, given.noop)
    action = _typed(given.space, given.noop)
    if action is None or not given.space.contains(action):
        raise PolicyError(
            f"the noop of {given.agent!r} is outside its action space",
            where=f"{_key(given.role)} in the contract",
            expected=f"an action of {given.space}",
            actual=repr(given.noop),
            fix="declare an action that the environment takes",
        )

    is_compound = not isinstance(action, np.generic | str)

    def play(observation: object, info: object) -> Any:
        return copy.deepcopy(action) if is_compound else action

    return lambda rng: play


def check(agent: object, role: str | None, noop: object) -> None:
    """The agent has a declared noop.

    Raises:
        PolicyError: it has none; names the key of the contract where the answer goes.
    """
    if noop is None:
        raise PolicyError(
            f"'noop' can't play {agent!r}: no action is declared that does nothing",
            where=f"{_key(role)} in the contract",
            expected="an action",
            actual="not declared",
            fix=f"declare {_key(role)}, or give {agent!r} another policy",
        )


def _key(role: str | None) -> str:
    return f"roles.{role or '<role>'}.noop"


def _typed(space: Space[Any], noop: Any) -> Any:
    """The action in the space's types, from the numbers, texts and lists of a contract."""
    if isinstance(space, Tuple) and isinstance(noop, list | tuple):
        return tuple(map(_typed, space.spaces, noop)) if len(noop) == len(space) else None
    if isinstance(space, Dict) and isinstance(noop, Mapping):
        return {key: _typed(space[key], one) for key, one in noop.items() if key in space.spaces}
    try:
        return space.from_jsonable([noop])[0]
    except Exception:
        return None
