"""Rollout buffers that learn from what agents did: waiting and being gone are no decisions."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer

from gamekeeper.adapters.decisions import decided


def buffer(venv: Any, *, masked: bool = False) -> dict[str, Any]:
    """Keyword arguments of PPO, A2C or MaskablePPO: `PPO("MlpPolicy", venv, **buffer(venv))`.

    Args:
        venv: what `vec_env` returned, before it is wrapped in anything.
        masked: for sb3-contrib's MaskablePPO.
    """
    is_dict = isinstance(venv.observation_space, spaces.Dict)
    return {
        "rollout_buffer_class": _buffer_class(is_dict=is_dict, masked=masked),
        "rollout_buffer_kwargs": {"slots": venv.slots},
    }


class _Decisions:
    """Keeps steps in which a slot acted, each with all it was paid until it acted again.

    Generalised advantage estimation runs over a slot's own decisions: a reward that comes while it
    waits (or the bootstrap of its truncation) is added to that of its last action, the next value
    is that of its next decision. What was still open as the rollout ended is left out, and so is
    what was paid before an agent had done anything. Where everybody acts in every step this is
    Stable-Baselines3's own estimate.
    """

    buffer_size: int
    n_envs: int

    def __init__(self, *args: Any, slots: Any, **kwargs: Any) -> None:
        self._slots = slots
        super().__init__(*args, **kwargs)
        self._whole = self.buffer_size, self.n_envs

    def reset(self) -> None:
        self.buffer_size, self.n_envs = getattr(self, "_whole", (self.buffer_size, self.n_envs))
        self._acted = np.zeros((self.buffer_size, self.n_envs), bool)
        super().reset()  # type: ignore[misc]  # a buffer of Stable-Baselines3 stands behind

    def add(self, *args: Any, **kwargs: Any) -> None:
        self._acted[self.pos] = self._slots.acted  # type: ignore[attr-defined]  # likewise
        super().add(*args, **kwargs)  # type: ignore[misc]  # likewise

    def compute_returns_and_advantage(self, last_values: Any, dones: Any) -> None:
        last = last_values.clone().cpu().numpy().flatten()
        ends = np.concatenate([self.episode_starts[1:], dones[None]]).astype(bool)  # type: ignore[attr-defined]  # likewise
        self.advantages, valid = decided(
            self.rewards, self.values, self._acted, ends, last, self._slots.acting,  # type: ignore[attr-defined]  # likewise
            gamma=self.gamma, trace=self.gae_lambda,  # type: ignore[attr-defined]  # likewise
        )  # fmt: skip
        self.returns = self.advantages + self.values  # type: ignore[attr-defined]  # likewise
        self._keep(valid)

    def _keep(self, valid: Any) -> None:
        """Leaves nothing in the arrays but these steps, as those of one environment."""
        shape = valid.shape
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and value.shape[:2] == shape:
                setattr(self, name, value[valid][:, None])
            elif isinstance(value, dict):
                parts = {key: part[valid][:, None] for key, part in value.items()}
                setattr(self, name, parts)
        self.buffer_size, self.n_envs = int(valid.sum()), 1


@cache
def _buffer_class(*, is_dict: bool, masked: bool) -> Any:
    """The buffer of Stable-Baselines3 or sb3-contrib for these observations, with decisions."""
    base: Any = DictRolloutBuffer if is_dict else RolloutBuffer
    if masked:
        from sb3_contrib.common.maskable import buffers

        base = buffers.MaskableDictRolloutBuffer if is_dict else buffers.MaskableRolloutBuffer
    return type(f"Decisions{base.__name__}", (_Decisions, base), {})
