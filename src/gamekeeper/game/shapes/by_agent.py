"""Lists and dictionaries of another shape, dealt out to agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.game.shapes.guest import Given, wrong_shape

MASK: Final = "action_mask"
MASKS: Final = (MASK, "avail_actions", "available_actions", "legal_actions")
"""What environments call their masks in an info, a row for each agent."""
ALL: Final = "__all__"
"""The key under which dictionaries of flags tell that the episode is over."""


def dealt(values: Any, agents: Sequence[str], what: str) -> Given:
    """One value for each agent: of a dictionary by name, of a list, tuple or array by place.

    Raises:
        EnvError: it is nothing of these, or of another length.
    """
    if isinstance(values, Mapping):
        if all(agent in values for agent in agents):
            return {agent: values[agent] for agent in agents}
    elif _is_row(values) and len(values) == len(agents):
        return dict(zip(agents, values, strict=True))
    raise wrong_shape(what, expected=f"one of each of {len(agents)} agents", seen=values)


def flags(values: Any, agents: Sequence[str], what: str) -> dict[str, bool]:
    """One flag for each agent; one alone is everybody's.

    Raises:
        EnvError: it is neither a flag nor one of each agent.
    """
    if isinstance(values, bool | np.bool_ | int | np.integer) or (
        isinstance(values, np.ndarray) and not values.ndim
    ):
        return dict.fromkeys(agents, bool(values))
    if isinstance(values, Mapping) and values.get(ALL):
        values = {**dict.fromkeys(agents, True), **values}
    return {agent: bool(flag) for agent, flag in dealt(values, agents, what).items()}


def rewards(values: Any, agents: Sequence[str]) -> dict[str, Any]:
    """One reward for each agent; one alone is paid to everybody in full.

    Raises:
        EnvError: it is neither a number nor one of each agent.
    """
    if isinstance(values, int | float | np.number | np.bool_) or (
        isinstance(values, np.ndarray) and not values.ndim
    ):
        return dict.fromkeys(agents, float(values))
    return {agent: _plain(paid) for agent, paid in dealt(values, agents, "rewards").items()}


def infos(info: Any, agents: Sequence[str]) -> dict[str, dict[str, Any]]:
    """One info for each agent: its own where they come so, else a copy of everybody's.

    A mask with a row for each agent comes apart, and stands under `action_mask`.
    """
    if isinstance(info, list | tuple) and len(info) == len(agents):
        return {
            agent: dict(one) if isinstance(one, Mapping) else {"info": one}
            for agent, one in zip(agents, info, strict=True)
        }
    if not isinstance(info, Mapping):
        raise wrong_shape("infos", expected="a dictionary, or one of each agent", seen=info)
    if info and all(isinstance(info.get(agent), Mapping) for agent in agents):
        common = {key: value for key, value in info.items() if key not in agents}
        return {agent: {**common, **info[agent]} for agent in agents}
    rows = next((name for name in MASKS if _is_rows(info.get(name), len(agents))), None)
    common = {key: value for key, value in info.items() if key != rows}
    if rows is None:
        return {agent: dict(common) for agent in agents}
    return {
        agent: {**common, MASK: np.asarray(row, dtype=np.int8)}
        for agent, row in zip(agents, info[rows], strict=True)
    }


def _is_rows(value: Any, count: int) -> bool:
    return _is_row(value) and len(value) == count and all(map(_is_row, value))


def _is_row(value: Any) -> bool:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _plain(paid: Any) -> Any:
    """A reward out of an array without axes; anything else as it is, also what is no number."""
    return paid.item() if isinstance(paid, np.ndarray) and paid.size == 1 else paid
