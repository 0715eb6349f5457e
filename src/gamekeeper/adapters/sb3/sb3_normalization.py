"""Observations and rewards in units of their own spread, with statistics saved in the model's file.

A policy that learnt from normalized observations is worth nothing without their statistics, and
Stable-Baselines3 saves these in a file of their own, or not at all.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from gamekeeper.adapters.sb3.sb3_buffers import Watched
from gamekeeper.errors import PolicyError, SpecError
from gamekeeper.interface.wrappers.normalization import Normalization

MEMBER: Final = "normalization.json"
"""Part of a model's zip that holds the statistics; Stable-Baselines3 passes it over."""


class _ActingOnly(RunningMeanStd):
    """Statistics of what agents decide by: slots that wait or have ended are left out."""

    def __init__(self, watched: Watched, shape: tuple[int, ...]) -> None:
        super().__init__(shape=shape)
        self._watched = watched

    def update(self, arr: Any) -> None:
        """Takes the rows of slots that act next."""
        rows = np.asarray(arr)[self._watched.seen().acting]
        if len(rows):
            super().update(rows)


class Normalized(VecNormalize):
    """Use `normalized`."""

    obs_rms: Any
    returns: Any

    def __init__(self, venv: Any, **options: Any) -> None:
        super().__init__(venv, **options)
        watched = Watched(venv.slots)
        if self.norm_obs:
            rms = self.obs_rms
            self.obs_rms = (
                {key: _ActingOnly(watched, one.mean.shape) for key, one in rms.items()}
                if isinstance(rms, dict)
                else _ActingOnly(watched, rms.mean.shape)
            )

    def _update_reward(self, reward: Any) -> None:
        """Discounts a return once for each decision of its agent."""
        acted = self.venv.slots.acted
        self.returns = np.where(acted, self.returns * self.gamma, self.returns) + reward
        if acted.any():
            self.ret_rms.update(self.returns[acted])

    def now(self) -> Normalization:
        """The statistics as they stand."""
        rms: Any = self.obs_rms if self.norm_obs else {}
        parts = rms if isinstance(rms, dict) else {"": rms}
        return Normalization(
            {
                key: (one.mean.copy(), one.var.copy(), float(one.count))
                for key, one in parts.items()
            },
            (float(self.ret_rms.var), float(self.ret_rms.count)),
            self.clip_obs,
            self.epsilon,
        )

    def take(self, statistics: Normalization) -> None:
        """Goes on from these statistics."""
        rms: Any = self.obs_rms if self.norm_obs else {}
        for key, one in (rms if isinstance(rms, dict) else {"": rms}).items():
            mean, variance, count = statistics.parts[key]
            one.mean, one.var, one.count = mean.copy(), variance.copy(), count
        self.ret_rms.var, self.ret_rms.count = np.float64(statistics.paid[0]), statistics.paid[1]


def normalized(
    venv: Any,
    *,
    observations: bool = True,
    rewards: bool = True,
    saved: str | Path | None = None,
    clip: float = 10.0,
    gamma: float = 0.99,
) -> Normalized:
    """Shows observations and rewards in units of their spread, as measured on the way.

    Statistics are of agents' decisions: steps in which a slot waits or has ended aren't counted.
    Of a Dict only float parts are normalized. `save(model, path)` keeps the statistics in the
    model's file, where `policy`, `sb3:model.zip` and the callbacks find them.

    Args:
        venv: what `vec_env` returned.
        observations, rewards: kinds that are normalized.
        saved: model file to go on from.
        clip: largest size of a normalized observation or reward.
        gamma: discount of the returns by whose spread rewards are divided.
    Raises:
        SpecError: observations hold no part of floats.
        PolicyError: the file has no statistics.
    """
    space = venv.observation_space
    parts = dict(space.spaces) if isinstance(space, spaces.Dict) else {"": space}
    keys = [key for key, part in parts.items() if _is_of_floats(part)]
    if observations and not keys:
        raise SpecError(
            "observations have no part to be normalized",
            where="observation_space",
            expected="a Box of floats, or a Dict with one",
            actual=str(space)[:200],
            fix="normalized(venv, observations=False); networks for pictures scale them themselves",
        )
    found = Normalized(
        venv,
        norm_obs=observations,
        norm_reward=rewards,
        clip_obs=clip,
        clip_reward=clip,
        gamma=gamma,
        norm_obs_keys=keys if observations and isinstance(space, spaces.Dict) else None,
    )
    if saved is not None:
        statistics = saved_normalization(Path(saved))
        if statistics is None:
            raise PolicyError(
                "the model's file has no statistics",
                where=str(saved),
                fix="save(model, path) of gamekeeper.adapters.sb3 keeps them",
            )
        found.take(statistics)
    return found


def _is_of_floats(space: Any) -> bool:
    return isinstance(space, spaces.Box) and np.issubdtype(space.dtype, np.floating)


def save(model: Any, path: str | Path) -> Path:
    """Saves a model with the statistics that normalized its observations; returns the file."""
    path = Path(path)
    model.save(path)
    file = path if path.suffix else path.with_suffix(".zip")
    statistics = normalization_of(model)
    if statistics is not None:
        with zipfile.ZipFile(file, "a") as archive:
            archive.writestr(MEMBER, statistics.to_json())
    return file


def normalization_of(model: Any) -> Normalization | None:
    """The statistics of the environment that a model learns in; None: nothing is normalized.

    Raises:
        PolicyError: it is normalized by other means than `normalized`.
    """
    env = model.get_vec_normalize_env()
    if env is None:
        return None
    if not isinstance(env, Normalized):
        raise PolicyError(
            "observations are normalized by statistics that count steps of waiting agents",
            where="VecNormalize",
            fix="venv = gamekeeper.adapters.sb3.normalized(venv)",
        )
    return env.now()


def saved_normalization(path: Path) -> Normalization | None:
    """The statistics in a model's file; None: it has none."""
    file = path if path.exists() else path.with_suffix(".zip")
    with zipfile.ZipFile(file) as archive:
        if MEMBER not in archive.namelist():
            return None
        return Normalization.of_json(archive.read(MEMBER).decode())
