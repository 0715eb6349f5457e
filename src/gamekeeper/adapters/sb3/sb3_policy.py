"""A trained model as a policy (`sb3:model.zip`, or in memory), and callbacks that play it.

The callbacks evaluate it by agent and role over episodes, and record it as it learns.
"""

from __future__ import annotations

import copy
from collections import defaultdict
from collections.abc import Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from gamekeeper.adapters.requirements import role_of, weights_digest
from gamekeeper.adapters.sb3.sb3_normalization import normalization_of, save, saved_normalization
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import PolicyError
from gamekeeper.interface.action_mask import reader
from gamekeeper.interface.wrappers.normalization import Normalization
from gamekeeper.runs.recording import rollout
from gamekeeper.vector.vector_form import MASK

mask_of = reader(None)


class ModelPolicy:
    """A model of Stable-Baselines3 that plays an agent.

    Args:
        model: with `predict`.
        version: kept with the evidence.
        deterministic: takes the likeliest action; else one is drawn, from a generator that the
            agent's own stream seeds, so that the draws of a learner meanwhile stay the same.
        normalization: of observations; None: they are shown as they are.
    """

    def __init__(
        self,
        model: Any,
        *,
        version: str,
        deterministic: bool = True,
        normalization: Normalization | None = None,
    ) -> None:
        self.model, self.version, self.deterministic = model, version, deterministic
        self.normalization = normalization
        self._is_masked = type(model).__name__.startswith("Maskable")

    def __deepcopy__(self, memo: dict[int, Any]) -> ModelPolicy:
        """A policy with the same weights and buffers, which playing leaves alone.

        The space is copied: some algorithms sample from it, and it keeps its generator.
        """
        model = copy.copy(self.model)
        model.action_space = copy.deepcopy(model.action_space, memo)
        return ModelPolicy(
            model,
            version=self.version,
            deterministic=self.deterministic,
            normalization=copy.deepcopy(self.normalization, memo),
        )

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """The action of one agent."""
        more: dict[str, Any] = {}
        mask: Any = mask_of(observation, info)
        if isinstance(observation, dict) and MASK in observation:
            rest = {key: part for key, part in observation.items() if key != MASK}
            observation = next(iter(rest.values())) if len(rest) == 1 else rest
        if self._is_masked and mask is not None:
            parts = mask if isinstance(mask, tuple | list) else [mask]
            more["action_masks"] = np.concatenate([np.atleast_1d(part) for part in parts]) != 0
        if self.normalization is not None:
            observation = self.normalization(observation)
        if self.deterministic:
            action, _ = self.model.predict(observation, deterministic=True, **more)
        else:
            with torch.random.fork_rng():
                torch.manual_seed(int(rng.integers(2**31)))
                action, _ = self.model.predict(observation, deterministic=False, **more)
        return (
            action.item() if np.ndim(action) == 0 else action.astype(self.model.action_space.dtype)
        )


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
        path, model = Path(model), _loaded(Path(model))
        statistics = saved_normalization(path)
        if statistics is None and _was_normalized(model):
            raise PolicyError(
                "the model learnt from normalized observations, and their statistics aren't saved",
                where=str(path),
                expected="a file that gamekeeper.adapters.sb3.save(model, path) wrote",
                actual="one of model.save(path)",
                fix="save it so; or policy(model), with the model in memory",
            )
    else:
        statistics = normalization_of(model)
    if version is None:
        digest = weights_digest(sorted(model.policy.state_dict().items()))
        version = f"{model.num_timesteps} steps, {digest}"
        if statistics is not None:
            seen = blake2b(statistics.to_json().encode(), digest_size=4).hexdigest()
            version += f", normalized by {seen}"
    return ModelPolicy(
        model, version=version, deterministic=deterministic, normalization=statistics
    )


def _was_normalized(model: Any) -> bool:
    """True if a loaded model's buffer remembers that its environment was normalized."""
    arguments = [
        getattr(model, name, None) or {}
        for name in ("rollout_buffer_kwargs", "replay_buffer_kwargs")
    ]
    return any(getattr(each.get("watched"), "is_normalized", False) for each in arguments)


def _loaded(path: Path) -> Any:
    """A saved model; the algorithms are tried, as the file doesn't name its own."""
    if not path.exists() and not path.with_suffix(".zip").exists():
        raise PolicyError(
            "there is no such model",
            where=str(path),
            expected="a file that model.save(path) wrote",
            actual="no file",
            fix="check the path, or save the model first",
        )
    import sb3_contrib
    import stable_baselines3 as sb3

    kinds: list[Any] = [sb3_contrib.MaskablePPO, sb3.PPO, sb3.A2C, sb3.DQN, sb3.SAC, sb3.TD3]
    kinds += [sb3_contrib.QRDQN, sb3_contrib.TQC]
    failed: list[str] = []
    for kind in kinds:
        try:
            return kind.load(path, device="cpu")
        except Exception as error:  # another algorithm's parameters don't fit: each says it its way
            failed.append(f"{kind.__name__}: {type(error).__name__}")
    raise PolicyError(
        "no algorithm of Stable-Baselines3 reads this model",
        where=str(path),
        actual="; ".join(failed),
        fix="gamekeeper.adapters.sb3.policy(Algorithm.load(path))",
    )


class EvalCallback(BaseCallback):
    """Plays whole episodes every so often and logs the mean return of each agent and each role.

    An episode is the unit: agents of one episode aren't counted as many. In the logger stand
    `eval/<agent>/return`, `eval/<role>/return`, `eval/team/return` and `eval/episodes`; `history`
    keeps every evaluation, [step, {agent: [return of each episode]}].

    Args:
        spec: the environment.
        role: role that the model plays; None: all agents.
        others: policies of the others.
        episodes: of each evaluation.
        seed: of the run that is played, the same at every evaluation.
        every: steps of all slots between two evaluations.
        best_path: path of the best model, by the mean return of the agents it plays; None: it isn't
            saved.
    """

    def __init__(
        self,
        spec: object,
        *,
        role: str | None = None,
        others: Any = None,
        episodes: int = 20,
        seed: int = 1_000_000,
        every: int = 10_000,
        deterministic: bool = True,
        best_path: str | Path | None = None,
        env_kwargs: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.spec, self.role, self.others = spec, role, others
        self.episodes, self.seed, self.every = episodes, seed, every
        self.deterministic, self.env_kwargs = deterministic, env_kwargs
        self.best_path = best_path
        self.best = -np.inf
        self.history: list[tuple[int, dict[str, list[float]]]] = []
        self._due = every

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._due:
            self._due = self.num_timesteps + self.every
            self.evaluate()
        return True

    def evaluate(self) -> dict[str, list[float]]:
        """Plays the episodes now; returns each agent's returns, episode by episode."""
        played = _played(self)
        returns = returns_by_agent(played)
        roles = {agent: role_of(played.contract, agent) for agent in returns}
        self.history.append((self.num_timesteps, returns))
        by_role: dict[str, list[float]] = defaultdict(list)
        for agent, values in returns.items():
            self.logger.record(f"eval/{agent}/return", float(np.mean(values)))
            by_role[roles[agent]].append(float(np.mean(values)))
        for role, means in by_role.items():
            if role not in returns:
                self.logger.record(f"eval/{role}/return", float(np.mean(means)))
        team = float(np.mean(np.sum(list(returns.values()), axis=0)))
        self.logger.record("eval/team/return", team)
        self.logger.record("eval/episodes", self.episodes)
        mine = [v for a, v in returns.items() if self.role in (None, a, roles[a])]
        score = float(np.mean(mine))
        if score > self.best:
            self.best = score
            if self.best_path is not None:
                save(self.model, self.best_path)
        return returns


class RecordCallback(BaseCallback):
    """Records episodes of the policy as it learns, as evidence with the policy's version.

    Args:
        spec, role, others, env_kwargs: as `EvalCallback` has them.
        path: a folder; each recording is a run in it, `step_00010000`.
        episodes: of each recording.
        every: steps of all slots between two recordings; the first comes before any learning.
    """

    def __init__(
        self,
        spec: object,
        path: str | Path,
        *,
        role: str | None = None,
        others: Any = None,
        episodes: int = 5,
        seed: int = 0,
        every: int = 50_000,
        deterministic: bool = True,
        env_kwargs: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.spec, self.role, self.others, self.path = spec, role, others, Path(path)
        self.episodes, self.seed, self.every = episodes, seed, every
        self.deterministic, self.env_kwargs = deterministic, env_kwargs
        self._due = 0

    def _on_training_start(self) -> None:
        self._record()

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._due:
            self._record()
        return True

    def _record(self) -> None:
        self._due = self.num_timesteps + self.every
        out = self.path / f"step_{self.num_timesteps:08d}"
        _played(self, out)


def _played(callback: Any, out: Path | None = None) -> Evidence:
    """Plays a callback's episodes with its model as it is now."""
    mine = policy(callback.model, deterministic=callback.deterministic)
    policies: Any = mine
    if callback.role is not None:
        rest = callback.others
        others = dict(rest) if isinstance(rest, Mapping) else {"*": rest or "random"}
        policies = {**others, callback.role: mine}
    return rollout(
        callback.spec,
        policies=policies,
        episodes=callback.episodes,
        seed=callback.seed,
        out=out,
        env_kwargs=callback.env_kwargs,
    )


def returns_by_agent(evidence: Evidence) -> dict[str, list[float]]:
    """Return of each agent in each episode; 0 in an episode that it wasn't in."""
    table = (
        evidence.agent_steps.group_by(["episode", "agent"], use_threads=False)
        .aggregate([("reward", "sum")])
        .to_pydict()
    )
    count = max(table["episode"], default=-1) + 1
    returns = {agent: [0.0] * count for agent in sorted(set(table["agent"]))}
    rows = zip(table["episode"], table["agent"], table["reward_sum"], strict=True)
    for episode, agent, paid in rows:
        returns[agent][episode] = float(paid or 0.0)
    return returns
