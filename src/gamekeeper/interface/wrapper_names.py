"""Names of the wrappers around an environment."""

from typing import Any

from pettingzoo.utils.wrappers.base import BaseWrapper
from pettingzoo.utils.wrappers.base_parallel import BaseParallelWrapper

from gamekeeper.interface.packing import type_name_of


def wrappers_of(env: Any) -> tuple[str, ...]:
    """Names of the classes of PettingZoo's wrappers around an environment, the outermost first."""
    found = []
    while isinstance(env, BaseWrapper | BaseParallelWrapper):
        module, _, name = type_name_of(type(env)).rpartition(".")
        found.append(f"{name} ({module})")
        env = env.env
    return tuple(found)
