"""TorchRL: `env`, `advantages` and `decisions`, `policy`."""

from __future__ import annotations

from gamekeeper.errors import SpecError

try:
    import torchrl
except ImportError as error:
    raise SpecError(
        "TorchRL isn't installed",
        where="gamekeeper.adapters.torchrl",
        mend="pip install 'gamekeeper[torchrl]'",
    ) from error

from gamekeeper.adapters.torchrl.advantages import advantages, decisions
from gamekeeper.adapters.torchrl.env import env
from gamekeeper.adapters.torchrl.game_env import GameEnv
from gamekeeper.adapters.torchrl.policy import policy

VERSION = torchrl.__version__
__all__ = ["GameEnv", "advantages", "decisions", "env", "policy"]
