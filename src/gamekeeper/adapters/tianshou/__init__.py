"""Tianshou 2: `vector_env`, `Collector`, `masked`, `unmasked`, `policy`."""

from __future__ import annotations

from gamekeeper.errors import not_installed

try:
    import tianshou
except ImportError as error:
    raise not_installed(error, "Tianshou", "tianshou", "gamekeeper.adapters.tianshou") from error

from gamekeeper.adapters.tianshou.tianshou_envs import Collector, vector_env
from gamekeeper.adapters.tianshou.tianshou_policy import masked, policy, unmasked

VERSION = tianshou.__version__
__all__ = ["Collector", "masked", "policy", "unmasked", "vector_env"]
