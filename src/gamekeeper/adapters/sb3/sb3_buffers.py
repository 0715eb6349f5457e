"""Buffers of Stable-Baselines3 that hold agents' decisions only.

Steps in which an agent waits or has ended are left out; each reward goes to the action before it.
"""

from __future__ import annotations

import sys
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from sb3_contrib.common.maskable.buffers import MaskableDictRolloutBuffer, MaskableRolloutBuffer
from stable_baselines3.common.buffers import (
    DictReplayBuffer,
    DictRolloutBuffer,
    ReplayBuffer,
    RolloutBuffer,
)
from stable_baselines3.common.vec_env import VecNormalize

from gamekeeper.adapters.decisions import decided
from gamekeeper.adapters.sb3.sb3_envs import FIX_OF_MASKED
from gamekeeper.adapters.slot_views import at
from gamekeeper.adapters.slots import Slots
from gamekeeper.errors import SpecError

FIX: Final = (
    "load(path, env=venv, **sb3.buffer(venv)); of a replay buffer, model.replay_buffer.watch(venv)"
)


def buffer(venv: Any, *, masked: bool = False) -> dict[str, Any]:
    """Keyword arguments of PPO, A2C or MaskablePPO: `PPO("MlpPolicy", venv, **buffer(venv))`.

    A saved model doesn't hold the environment: to learn on, `PPO.load(path, env=venv,
    **buffer(venv))`.

    Args:
        venv: what `vec_env` or `normalized` returned.
        masked: for sb3-contrib's MaskablePPO.
    """
    plain, of_dicts = (
        (DecisionsMaskableRolloutBuffer, DecisionsMaskableDictRolloutBuffer)
        if masked
        else (DecisionsRolloutBuffer, DecisionsDictRolloutBuffer)
    )
    if not masked:
        _note_masks(venv)
    is_dict = isinstance(venv.observation_space, spaces.Dict)
    return {
        "rollout_buffer_class": of_dicts if is_dict else plain,
        "rollout_buffer_kwargs": {"watched": _watched(venv)},
    }


def replay_buffer(venv: Any) -> dict[str, Any]:
    """Keyword arguments of DQN, QRDQN, SAC, TD3 or TQC: `DQN(..., venv, **replay_buffer(venv))`.

    These algorithms don't read action masks: an environment with masks refuses their illegal
    actions, unless its rules have a penalty for them.

    Args:
        venv: what `vec_env` or `normalized` returned.
    """
    _note_masks(venv)
    is_dict = isinstance(venv.observation_space, spaces.Dict)
    return {
        "replay_buffer_class": DecisionsDictReplayBuffer if is_dict else DecisionsReplayBuffer,
        "replay_buffer_kwargs": {"watched": _watched(venv)},
    }


def _note_masks(venv: Any) -> None:
    """Says on stderr that agents have masks, to somebody whose algorithm reads none."""
    if venv.slots.masks.size:
        sys.stderr.write(
            "gamekeeper: agents have action masks, and of all algorithms MaskablePPO alone reads"
            f" them (fix: {FIX_OF_MASKED})\n"
        )


def _watched(venv: Any) -> Watched:
    return Watched(venv.slots, is_normalized=isinstance(venv, VecNormalize))


class Watched:
    """Slots that a buffer looks at; a saved model holds it without them.

    Attributes:
        slots: None once it was saved and loaded.
        is_normalized: the environment's observations or rewards were normalized.
    """

    def __init__(self, slots: Slots | None, *, is_normalized: bool = False) -> None:
        self.slots, self.is_normalized = slots, is_normalized
        if slots is not None:
            slots.is_watched = True

    def __reduce__(self) -> tuple[Any, tuple[bool]]:
        return _saved, (self.is_normalized,)

    def seen(self) -> Slots:
        """The slots.

        Raises:
            SpecError: they are those of another process.
        """
        if self.slots is None:
            raise SpecError(
                "a loaded model doesn't know which agents acted in its environment",
                where="rollout_buffer_kwargs",
                fix=FIX,
            )
        return self.slots


def _saved(is_normalized: bool) -> Watched:
    return Watched(None, is_normalized=is_normalized)


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
        buffer: Any = self  # a buffer of Stable-Baselines3 stands behind
        last = last_values.clone().cpu().numpy().flatten()
        ends = np.concatenate([buffer.episode_starts[1:], dones[None]]).astype(bool)
        buffer.advantages, valid = decided(
            buffer.rewards,
            buffer.values,
            self._acted,
            ends,
            last,
            buffer._watched.seen().acting,
            gamma=buffer.gamma,
            gae_lambda=buffer.gae_lambda,
        )
        buffer.returns = buffer.advantages + buffer.values
        if valid.sum() < 2:  # nothing has a deviation of one
            raise SpecError(
                f"{valid.sum()} decisions were made in a whole rollout",
                where="n_steps",
                expected="2 or more, to learn from them",
                actual=f"{len(valid)} steps of {valid.shape[1]} slots",
                fix="take more steps, or more copies",
            )
        self._keep(valid)

    def get(self, batch_size: int | None = None) -> Any:
        """Batches in an order drawn anew, none of them larger than asked for.

        How many decisions there are depends on what was played. Where steps were left out they are
        shared out evenly: a few that are left over, with advantages divided by their own deviation,
        would move the network as far as a whole batch does; one alone has no deviation.
        """
        count, whole = self.buffer_size, int(np.prod(self._whole))
        if batch_size is not None and count * self.n_envs != whole:
            batch_size = -(-count // -(-count // batch_size))
        for batch in super().get(batch_size):  # type: ignore[misc]  # likewise
            if len(batch.actions) > 1:
                yield batch

    def _keep(self, valid: Any) -> None:
        """Leaves nothing in the arrays but these steps, as those of one environment."""

        def kept(value: Any) -> Any:
            is_of_steps = isinstance(value, np.ndarray) and value.shape[:2] == valid.shape
            return value[valid][:, None] if is_of_steps else value

        for name, value in vars(self).items():
            is_dict = isinstance(value, dict)
            parts = {key: kept(part) for key, part in value.items()} if is_dict else kept(value)
            setattr(self, name, parts)
        self.buffer_size, self.n_envs = int(valid.sum()), 1


class DecisionsRolloutBuffer(_Decisions, RolloutBuffer):
    """Rollout buffer of PPO and A2C."""


class DecisionsDictRolloutBuffer(_Decisions, DictRolloutBuffer):
    """Rollout buffer of PPO and A2C, for observations that are dictionaries."""


class DecisionsMaskableRolloutBuffer(_Decisions, MaskableRolloutBuffer):
    """Rollout buffer of MaskablePPO."""


class DecisionsMaskableDictRolloutBuffer(_Decisions, MaskableDictRolloutBuffer):
    """Rollout buffer of MaskablePPO, for observations that are dictionaries."""


class _Transitions:
    """Stores an agent's decision once its outcome is known: it decides again, or has ended.

    Its reward is all that came until then, and what follows is the observation of that moment. What
    was paid before an agent had done anything is left out. The buffer is that of one environment,
    as slots decide at different times.
    """

    def __init__(
        self, *args: Any, watched: Watched, n_envs: int = 1, device: Any = "auto", **kwargs: Any
    ) -> None:
        buffer: Any = super()  # of Stable-Baselines3
        buffer.__init__(*args, device=device, n_envs=1, **kwargs)
        self._watched, self._run = watched, -1
        self._open: dict[int, list[Any]] = {}  # by slot: observation, action, reward up to now

    def watch(self, venv: Any) -> None:
        """Goes on with another environment, as a buffer does that was saved and loaded."""
        self._watched, self._run = Watched(venv.slots), -1

    def add(
        self, obs: Any, next_obs: Any, action: Any, reward: Any, done: Any, infos: list[Any]
    ) -> None:
        """Adds the transitions whose outcome this step shows."""
        slots = self._watched.seen()
        if slots.runs != self._run:  # what was open belongs to a run that was left
            self._open, self._run = {}, slots.runs
        for slot in range(slots.count):
            if slots.acted[slot]:
                self._open[slot] = [at(obs, slice(slot, slot + 1)), action[slot], 0.0]
            if slot not in self._open:
                continue
            self._open[slot][2] += reward[slot]
            if done[slot] or slots.acting[slot]:
                seen, did, paid = self._open.pop(slot)
                follows = at(next_obs, slice(slot, slot + 1))
                super().add(  # type: ignore[misc]  # a buffer of Stable-Baselines3 stands behind
                    seen, follows, did[None], np.array([paid]), done[[slot]], [infos[slot]]
                )


class DecisionsReplayBuffer(_Transitions, ReplayBuffer):
    """Replay buffer of DQN, SAC and their kin."""


class DecisionsDictReplayBuffer(_Transitions, DictReplayBuffer):
    """Replay buffer of DQN, SAC and their kin, for observations that are dictionaries."""
