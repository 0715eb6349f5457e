"""A callback of RLlib: what each agent and each role was paid, over episodes."""

from __future__ import annotations

from typing import Any, Final

from ray.rllib.callbacks.callbacks import RLlibCallback

from gamekeeper.adapters.rllib.env import AgentsEnv

TEAM: Final = "team"


class ReturnsCallback(RLlibCallback):
    """Logs the mean return over episodes of each agent, each role and the team.

    `config.callbacks(ReturnsCallback)`; they stand in a result under `env_runners/gamekeeper`:
    `agent/<name>`, `role/<name>` (the mean of its agents), `team` (the sum of all), and `episodes`.
    An episode is the unit: one in which an agent wasn't counts as 0 for it, and agents that don't
    learn are told too; RLlib's own `agent_episode_returns_mean` has neither. Likewise under
    `evaluation/env_runners/gamekeeper`.
    """

    def on_episode_end(
        self, *, env: Any, env_index: int, env_runner: Any, metrics_logger: Any, **_: Any
    ) -> None:
        """Logs the episode that is over."""
        copy = env.envs[env_index].unwrapped
        if not isinstance(copy, AgentsEnv):
            return
        window = env_runner.config.metrics_num_episodes_for_smoothing
        returns = copy.returns
        by_role: dict[str, list[float]] = {}
        for agent, paid in returns.items():
            by_role.setdefault(copy.role_of[agent], []).append(paid)
            metrics_logger.log_value(("gamekeeper", "agent", agent), paid, window=window)
        for role, amounts in by_role.items():
            mean = sum(amounts) / len(amounts)
            metrics_logger.log_value(("gamekeeper", "role", role), mean, window=window)
        total = sum(returns.values())
        metrics_logger.log_value(("gamekeeper", TEAM), total, window=window)
        metrics_logger.log_value(("gamekeeper", "episodes"), 1, reduce="lifetime_sum")
