"""TorchRL: `env`, `advantages` and `decisions`, `policy`."""

from __future__ import annotations

from gamekeeper.errors import SpecError

try:
    import torchrl
except ImportError as error:
    raise SpecError(
        "TorchRL isn't installed",
        where="gamekeeper.adapters.torchrl",
        fix="pip install 'gamekeeper[torchrl]'",
    ) from error

from gamekeeper.adapters.torchrl.torchrl_env import GameEnv, env
from gamekeeper.adapters.torchrl.torchrl_policy import advantages, decisions, policy

VERSION = torchrl.__version__
__all__ = ["GameEnv", "advantages", "decisions", "env", "policy"]
