"""Callbacks: evaluation by agent and role over episodes, evidence of the policy as it learns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from gamekeeper.adapters.sb3.policy import policy
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.layout import role as role_in_name
from gamekeeper.record.recording import rollout


class EvalCallback(BaseCallback):
    """Plays whole episodes every so often and logs the mean return of each agent and each role.

    An episode is the unit: agents of one episode aren't counted as many. In the logger stand
    `eval/<agent>/return`, `eval/<role>/return`, `eval/team/return` and `eval/episodes`; `history`
    keeps every evaluation, [step, {agent: [return of each episode]}].

    Args:
        spec: the environment.
        role: who the model plays; None: everybody.
        others: policies of the others.
        episodes: of each evaluation.
        seed: of the run that is played, the same at every evaluation.
        every: steps of all slots between two evaluations.
        best_path: where the best model is saved, by the mean return of those it plays; None: not.
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
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
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
        """Plays the episodes now; returns of each agent, episode by episode."""
        played = _played(self, episodes=self.episodes, seed=self.seed)
        returns = returns_by_agent(played)
        roles = _roles(played, returns)
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
                self.model.save(self.best_path)
        return returns


class RecordCallback(BaseCallback):
    """Records episodes of the policy as it learns, as evidence with the policy's version.

    Args:
        spec, role, others, env_kwargs: as `EvalCallback` has them.
        path: a folder; each recording is a bundle in it, `step_00010000`.
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
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
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
        _played(self, episodes=self.episodes, seed=self.seed, out=out)


def _played(callback: Any, *, episodes: int, seed: int, out: Path | None = None) -> Evidence:
    mine = policy(callback.model, deterministic=callback.deterministic)
    policies: Any = mine
    if callback.role is not None:
        rest = callback.others
        others = dict(rest) if isinstance(rest, Mapping) else {"*": rest or "random"}
        policies = {**others, callback.role: mine}
    return rollout(
        callback.spec, policies=policies, episodes=episodes, seed=seed, out=out,
        env_kwargs=callback.env_kwargs,
    )  # fmt: skip


def _roles(played: Evidence, agents: Iterable[str]) -> dict[str, str]:
    """By the contract, else by the agent's name."""
    return {agent: played.contract.role_of(agent) or role_in_name(agent) for agent in agents}


def returns_by_agent(evidence: Evidence) -> dict[str, list[float]]:
    """What each agent was paid in each episode; 0 in an episode that it wasn't in."""
    steps = evidence.steps
    table = (
        steps.group_by(["episode", "agent"], use_threads=False)
        .aggregate([("reward", "sum")])
        .to_pydict()
    )
    count = max(table["episode"], default=-1) + 1
    agents = sorted(set(table["agent"]))
    returns = {agent: [0.0] * count for agent in agents}
    rows = zip(table["episode"], table["agent"], table["reward_sum"], strict=True)
    for episode, agent, paid in rows:
        returns[agent][episode] = float(paid or 0.0)
    return returns
