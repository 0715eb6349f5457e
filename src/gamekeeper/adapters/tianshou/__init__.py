"""Tianshou 2: `vector_env`, `Collector`, `masked`, `unmasked`, `policy`."""

from __future__ import annotations

from gamekeeper.errors import DependencyError

try:
    import tianshou
except ImportError as error:
    raise DependencyError(
        "Tianshou isn't installed",
        where="gamekeeper.adapters.tianshou",
        mend="pip install 'gamekeeper[tianshou]'",
    ) from error

from gamekeeper.adapters.tianshou.collector import Collector
from gamekeeper.adapters.tianshou.nets import masked, unmasked
from gamekeeper.adapters.tianshou.policy import policy
from gamekeeper.adapters.tianshou.vector_env import vector_env

VERSION = tianshou.__version__
__all__ = ["Collector", "masked", "policy", "unmasked", "vector_env"]
