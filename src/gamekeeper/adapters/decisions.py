"""Advantages of an agent's own decisions, where others act and are paid in between."""

from __future__ import annotations

from typing import Any

import numpy as np


def decided(
    rewards: Any,
    values: Any,
    acted: Any,
    ends: Any,
    last_values: Any,
    acting: Any,
    *,
    gamma: float,
    gae_lambda: float,
) -> tuple[Any, Any]:
    """Advantages of decisions, and which of them are known; all arrays are [step, slot].

    Args:
        rewards: paid in a step.
        values: of what the slot was shown before it.
        acted: whether it acted in it.
        ends: whether its episode ended in it.
        last_values: [slot], of what it is shown after the last step.
        acting: [slot], whether it acts next.
        gamma, gae_lambda: discount and lambda, per decision.
    Source: Schulman et al. 2016, "High-Dimensional Continuous Control Using Generalized Advantage
        Estimation", over each agent's own decisions.
    """
    advantages, valid = np.zeros_like(values), np.zeros_like(acted)
    following = np.asarray(last_values, values.dtype).copy()
    carried, pending = np.zeros_like(following), np.zeros_like(following)
    known = np.asarray(acting, bool).copy()
    for step in reversed(range(len(rewards))):
        end = ends[step]
        following[end] = carried[end] = pending[end] = 0.0
        known |= end
        pending += rewards[step]
        now = acted[step]
        delta = pending + gamma * following - values[step]
        advantage = delta + gamma * gae_lambda * carried
        advantages[step][now] = advantage[now]
        valid[step] = now & known
        carried = np.where(now, np.where(known, advantage, 0.0), carried)
        following = np.where(now, values[step], following)
        pending[now] = 0.0
        known |= now
    return advantages, valid
