"""Whether agents of one role fare alike: the same game up to names, as far as it was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gamekeeper.core.stats import FloatArray
from gamekeeper.core.trace import Trace

ROUNDS: Final = 1_999
FEWEST: Final = 6
"""Episodes; fewer can't tell chance from a difference."""


def fares(trace: Trace, agents: Sequence[str]) -> FloatArray:
    """How each agent fared in one episode, [agents, features]: return, actions, terminated."""
    rows = np.zeros((len(agents), 3))
    place = {agent: row for row, agent in enumerate(agents)}
    for turn in trace.turns:
        for agent, paid in turn.rewards.items():
            if agent in place:
                rows[place[agent], 0] += paid
        for agent in turn.order:
            if agent in place:
                rows[place[agent], 1] += 1
        for agent in turn.ended:
            if agent in place:
                rows[place[agent], 2] = float(bool(turn.terminated.get(agent)))
    return rows


def exchangeable(episodes: FloatArray, *, seed: int = 0, rounds: int = ROUNDS) -> float:
    """The p-value of agents being interchangeable: their rows permuted within each episode.

    The statistic is the largest deviation of an agent's mean from that of all, over agents and
    features, each feature in units of its spread.

    Args:
        episodes: [episodes, agents, features].
        seed: of the permutations.
        rounds: permutations.
    Source: Good 2005, "Permutation, Parametric and Bootstrap Tests of Hypotheses", ch. 6 (blocks).
    """
    centred = episodes - episodes.mean(axis=1, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=(0, 1)))
    centred = centred[:, :, spread > 1e-12] / spread[spread > 1e-12]
    if centred.shape[2] == 0:
        return 1.0
    rng = np.random.default_rng([17, seed])
    seen = np.abs(centred.sum(axis=0)).max()
    blocks = np.arange(len(centred))[:, None]
    hits = 0
    for _ in range(rounds):
        order = rng.permuted(np.tile(np.arange(centred.shape[1]), (len(centred), 1)), axis=1)
        hits += bool(np.abs(centred[blocks, order].sum(axis=0)).max() >= seen - 1e-12)
    return (1 + hits) / (rounds + 1)


def p_by_role(traces: Sequence[Trace], roles: Mapping[str, Sequence[str]]) -> dict[str, float]:
    """The p-value of each role with two agents at least, where enough episodes were played."""
    found = {}
    for role, agents in roles.items():
        if len(agents) > 1 and len(traces) >= FEWEST:
            found[role] = exchangeable(np.array([fares(trace, agents) for trace in traces]))
    return found
