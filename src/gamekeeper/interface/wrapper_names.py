"""Names of the wrappers around an environment."""

from typing import Any, Final

from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers.base import BaseWrapper
from pettingzoo.utils.wrappers.base_parallel import BaseParallelWrapper

from gamekeeper.interface.packing import type_name_of

CONVERTER: Final = f"{parallel_to_aec_wrapper.__name__} ({parallel_to_aec_wrapper.__module__})"
"""PettingZoo's converter of a Parallel environment, which stands among the wrappers."""


def wrappers_of(env: Any) -> tuple[str, ...]:
    """Names of the classes of PettingZoo's wrappers around an environment, the outermost first."""
    found = []
    while isinstance(env, BaseWrapper | BaseParallelWrapper | parallel_to_aec_wrapper):
        module, _, name = type_name_of(type(env)).rpartition(".")
        found.append(f"{name} ({module})")
        env = env.env
    return tuple(found)
