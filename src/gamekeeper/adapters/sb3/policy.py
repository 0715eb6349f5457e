"""A trained model as a policy: `sb3:model.zip`, or a model in memory."""

from __future__ import annotations

from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gamekeeper.adapters.slots import MASK
from gamekeeper.errors import PolicyError


class ModelPolicy:
    """A model of Stable-Baselines3 that plays an agent.

    Args:
        model: with `predict`.
        version: kept with the evidence.
        deterministic: takes the likeliest action; else one is drawn, from a generator that the
            agent's own stream seeds, so that whoever is learning meanwhile draws as if nobody had.
    """

    def __init__(self, model: Any, *, version: str, deterministic: bool = True) -> None:
        self.model, self.version, self.deterministic = model, version, deterministic
        self._is_masked = type(model).__name__.startswith("Maskable")

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent."""
        more = {}
        if isinstance(observation, dict):
            mask = observation.get(MASK, info.get(MASK))
            rest = {key: part for key, part in observation.items() if key != MASK}
            observation = (
                next(iter(rest.values())) if len(rest) == 1 and MASK in observation else rest
            )
        else:
            mask = info.get(MASK)
        if self._is_masked and mask is not None:
            more["action_masks"] = np.asarray(mask, bool)
        if self.deterministic:
            action, _ = self.model.predict(observation, deterministic=True, **more)
        else:
            with torch.random.fork_rng():
                torch.manual_seed(int(rng.integers(2**31)))
                action, _ = self.model.predict(observation, deterministic=False, **more)
        return action.item() if np.ndim(action) == 0 else action


def policy(model: Any, *, deterministic: bool = True, version: str | None = None) -> ModelPolicy:
    """A policy of a model in memory, or of a saved one.

    Args:
        model: a model, or the path of one that was saved; which algorithm it is of stands in it.
        deterministic: takes the likeliest action.
        version: kept with the evidence; None: the digest of its weights, and how long it learnt.
    Raises:
        PolicyError: there is no such file, or no model in it.
    """
    if isinstance(model, str | Path):
        model = _loaded(Path(model))
    if version is None:
        version = f"{model.num_timesteps} steps, {_digest(model)}"
    return ModelPolicy(model, version=version, deterministic=deterministic)


def _loaded(path: Path) -> Any:
    """A saved model; the algorithms are tried, as the file doesn't name its own."""
    if not path.exists() and not path.with_suffix(".zip").exists():
        raise PolicyError("there is no such model", where=str(path), seen="no file")
    failed: list[str] = []
    for kind in _algorithms():
        try:
            return kind.load(path, device="cpu")
        except Exception as error:  # another algorithm's parameters don't fit: each says it its way
            failed.append(f"{kind.__name__}: {type(error).__name__}")
    raise PolicyError(
        "no algorithm of Stable-Baselines3 reads this model", where=str(path),
        seen="; ".join(failed), mend="gamekeeper.adapters.sb3.policy(Algorithm.load(path))",
    )  # fmt: skip


def _algorithms() -> list[Any]:
    import sb3_contrib
    import stable_baselines3 as sb3

    found = [sb3_contrib.MaskablePPO, sb3.PPO, sb3.A2C, sb3.DQN, sb3.SAC, sb3.TD3]
    return [*found, sb3_contrib.QRDQN, sb3_contrib.TQC]


def _digest(model: Any) -> str:
    digest = blake2b(digest_size=8)
    for name, value in sorted(model.policy.state_dict().items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value.detach().cpu().numpy()).tobytes())
    return digest.hexdigest()
