"""Stable-Baselines3: `vec_env`, buffers, `policy`, and callbacks that evaluate and record."""

from __future__ import annotations

from gamekeeper.errors import not_installed

try:
    import sb3_contrib  # noqa: F401  # that it is there; its users import what they need
    import stable_baselines3
except ImportError as error:
    raise not_installed(
        error, "Stable-Baselines3 or sb3-contrib", "sb3", "gamekeeper.adapters.sb3"
    ) from error

from gamekeeper.adapters.sb3.sb3_buffers import buffer, replay_buffer
from gamekeeper.adapters.sb3.sb3_envs import vec_env
from gamekeeper.adapters.sb3.sb3_normalization import normalized, save
from gamekeeper.adapters.sb3.sb3_policy import EvalCallback, RecordCallback, policy

VERSION = stable_baselines3.__version__
__all__ = [
    "EvalCallback",
    "RecordCallback",
    "buffer",
    "normalized",
    "policy",
    "replay_buffer",
    "save",
    "vec_env",
]
