"""Wrappers of what agents are paid: clipped, or terms and objectives weighed into one number."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gamekeeper.errors import ContractError, SpecError
from gamekeeper.interface.author_calls import AgentId
from gamekeeper.interface.wrappers.transform import Transform
from gamekeeper.interface.wrappers.wrapped_env import wrapped


def clip_rewards(env: Any, low: float = -1.0, high: float = 1.0) -> Any:
    """Clips what one step pays an agent; in an AEC environment one turn, of whomever.

    Cumulative rewards are sums of clipped ones.

    Args:
        env: AECEnv or ParallelEnv.
        low: least reward, 0 or less: an agent that is paid nothing gets nothing.
        high: greatest reward, 0 or more.
    """
    return wrapped(env, ClippedRewards(low, high))


def weigh_rewards(env: Any, weights: Mapping[str, float] | Sequence[float]) -> Any:
    """Pays one number: the weighed sum of reward terms, or of the parts of a vector reward.

    Args:
        env: AECEnv or ParallelEnv.
        weights: by term, for an environment that pays in terms (`TurnEnv`, `TickEnv`); terms
            without a weight count 0. Or a number for each part of rewards that are arrays.
    Raises:
        SpecError: weights by term, and the environment has no terms.
    """
    if isinstance(weights, Mapping):
        return wrapped(env, WeighedTerms(weights))
    return wrapped(env, WeighedVector(weights))


class ClippedRewards(Transform):
    """Use `clip_rewards`."""

    def __init__(self, low: float, high: float) -> None:
        if not low <= 0 <= high:
            raise SpecError(
                "rewards can't be clipped to these bounds",
                where="clip_rewards",
                expected="low <= 0 <= high",
                actual=f"low={low!r}, high={high!r}",
                fix="take 0 in: agents that are paid nothing in a step would be paid a bound",
            )
        self._low, self._high = low, high

    def reward(self, agent: AgentId, reward: Any) -> Any:
        """The reward within the bounds; 0, NaN and what lies within as they are."""
        if reward < self._low:
            return self._low
        return self._high if reward > self._high else reward


class WeighedTerms(Transform):
    """Use `weigh_rewards`."""

    def __init__(self, weights: Mapping[str, float]) -> None:
        self._weights = dict(weights)

    def bind(self, env: Any) -> None:
        """Takes the environment whose terms are read."""
        self._env = env
        if not isinstance(getattr(env, "terms", None), dict):
            raise SpecError(
                "there are no reward terms to weigh",
                where="weigh_rewards",
                expected="an environment that pays in terms: add_reward(agent, 1.0, term='goal')",
                actual=str(env),
                fix="weigh the parts of a vector reward by a list, or pay in terms",
            )

    def reward(self, agent: AgentId, reward: Any) -> Any:
        """The weighed sum of the terms of the last step."""
        paid = self._env.terms.get(agent, {})
        return float(sum(self._weights.get(term, 0.0) * amount for term, amount in paid.items()))


class WeighedVector(Transform):
    """Use `weigh_rewards`."""

    def __init__(self, weights: Sequence[float]) -> None:
        self._weights = np.array(weights, float)

    def reward(self, agent: AgentId, reward: Any) -> Any:
        """The weighed sum; a reward of one number 0, as before a first step, is 0.

        Raises:
            ContractError: the reward has another number of parts.
        """
        parts = np.asarray(reward, float)
        if parts.shape == self._weights.shape:
            return float(self._weights @ parts)
        if not parts.any():
            return 0.0
        raise ContractError(
            f"the reward of {agent!r} has another number of parts than there are weights",
            where="weigh_rewards",
            expected=f"{len(self._weights)} parts",
            actual=f"shape {parts.shape}",
            fix="give one weight for each objective",
        )
