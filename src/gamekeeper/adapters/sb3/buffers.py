"""Rollout buffers that learn from what agents did: waiting and being gone are no decisions."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from sb3_contrib.common.maskable.buffers import MaskableDictRolloutBuffer, MaskableRolloutBuffer
from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer

from gamekeeper.adapters.decisions import decided
from gamekeeper.adapters.slots import Slots
from gamekeeper.errors import SpecError

MEND = "load(path, env=venv, **sb3.buffer(venv))"


def buffer(venv: Any, *, masked: bool = False) -> dict[str, Any]:
    """Keyword arguments of PPO, A2C or MaskablePPO: `PPO("MlpPolicy", venv, **buffer(venv))`.

    A saved model doesn't hold the environment: to learn on, `PPO.load(path, env=venv,
    **buffer(venv))`.

    Args:
        venv: what `vec_env` returned, before it is wrapped in anything.
        masked: for sb3-contrib's MaskablePPO.
    """
    plain, of_dicts = (
        (DecisionsMaskableRolloutBuffer, DecisionsMaskableDictRolloutBuffer)
        if masked
        else (DecisionsRolloutBuffer, DecisionsDictRolloutBuffer)
    )
    is_dict = isinstance(venv.observation_space, spaces.Dict)
    return {
        "rollout_buffer_class": of_dicts if is_dict else plain,
        "rollout_buffer_kwargs": {"watched": Watched(venv.slots)},
    }


class Watched:
    """Slots that a buffer looks at; a saved model holds it without them.

    Attributes:
        slots: None once it was saved and loaded.
    """

    def __init__(self, slots: Slots | None) -> None:
        """Takes hold of the slots."""
        self.slots = slots

    def __reduce__(self) -> tuple[type[Watched], tuple[None]]:
        return Watched, (None,)

    def seen(self) -> Slots:
        """The slots.

        Raises:
            SpecError: they are those of another process.
        """
        if self.slots is None:
            raise SpecError(
                "a loaded model doesn't know who acted in its environment",
                where="rollout_buffer_kwargs", mend=MEND,
            )  # fmt: skip
        return self.slots


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

    def __init__(self, *args: Any, watched: Watched, **kwargs: Any) -> None:
        self._watched = watched
        super().__init__(*args, **kwargs)
        self._whole = self.buffer_size, self.n_envs

    def reset(self) -> None:
        self.buffer_size, self.n_envs = getattr(self, "_whole", (self.buffer_size, self.n_envs))
        self._acted = np.zeros((self.buffer_size, self.n_envs), bool)
        super().reset()  # type: ignore[misc]  # a buffer of Stable-Baselines3 stands behind

    def add(self, *args: Any, **kwargs: Any) -> None:
        self._acted[self.pos] = self._watched.seen().acted  # type: ignore[attr-defined]  # likewise
        super().add(*args, **kwargs)  # type: ignore[misc]  # likewise

    def compute_returns_and_advantage(self, last_values: Any, dones: Any) -> None:
        last = last_values.clone().cpu().numpy().flatten()
        ends = np.concatenate([self.episode_starts[1:], dones[None]]).astype(bool)  # type: ignore[attr-defined]  # likewise
        self.advantages, valid = decided(
            self.rewards, self.values, self._acted, ends, last, self._watched.seen().acting,  # type: ignore[attr-defined]  # likewise
            gamma=self.gamma, trace=self.gae_lambda,  # type: ignore[attr-defined]  # likewise
        )  # fmt: skip
        self.returns = self.advantages + self.values  # type: ignore[attr-defined]  # likewise
        if valid.sum() < 2:  # nothing has a deviation of one
            raise SpecError(
                f"{valid.sum()} decisions were made in a whole rollout",
                where="n_steps",
                expected="2 or more, to learn from them",
                seen=f"{len(valid)} steps of {valid.shape[1]} slots",
                mend="take more steps, or more copies",
            )
        self._keep(valid)

    def get(self, batch_size: int | None = None) -> Any:
        """Batches in an order drawn anew; one decision left over waits for another time.

        How many decisions there are depends on what was played, so that now and then one is left
        over, and MaskablePPO divides by its deviation: the network would be no numbers from then.
        """
        for batch in super().get(batch_size):  # type: ignore[misc]  # likewise
            if len(batch.actions) > 1:
                yield batch

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


class DecisionsRolloutBuffer(_Decisions, RolloutBuffer):
    """Of PPO and A2C."""


class DecisionsDictRolloutBuffer(_Decisions, DictRolloutBuffer):
    """Of PPO and A2C, for observations that are dictionaries."""


class DecisionsMaskableRolloutBuffer(_Decisions, MaskableRolloutBuffer):
    """Of MaskablePPO."""


class DecisionsMaskableDictRolloutBuffer(_Decisions, MaskableDictRolloutBuffer):
    """Of MaskablePPO, for observations that are dictionaries."""
