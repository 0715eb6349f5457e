"""TorchRL: `env`, `advantages` and `decisions`, `policy`."""

from __future__ import annotations

from gamekeeper.errors import not_installed

try:
    import torchrl
except ImportError as error:
    raise not_installed(error, "TorchRL", "torchrl", "gamekeeper.adapters.torchrl") from error

from gamekeeper.adapters.torchrl.torchrl_env import TorchRLEnv, env
from gamekeeper.adapters.torchrl.torchrl_policy import advantages, decisions, policy

VERSION = torchrl.__version__
__all__ = ["TorchRLEnv", "advantages", "decisions", "env", "policy"]
