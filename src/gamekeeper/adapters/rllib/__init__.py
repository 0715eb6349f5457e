"""RLlib's new API stack: `register`, `policy_mapping`, `modules`, `policy`, returns by agent."""

from __future__ import annotations

from gamekeeper.errors import not_installed

try:
    import ray.rllib
except ImportError as error:
    raise not_installed(error, "RLlib", "rllib", "gamekeeper.adapters.rllib") from error

from gamekeeper.adapters.rllib.rllib_env import multi_agent_env
from gamekeeper.adapters.rllib.rllib_game import Options
from gamekeeper.adapters.rllib.rllib_setup import (
    ReturnsCallback,
    modules,
    policy,
    policy_mapping,
    register,
)

VERSION = ray.__version__
__all__ = [
    "Options",
    "ReturnsCallback",
    "modules",
    "multi_agent_env",
    "policy",
    "policy_mapping",
    "register",
]
