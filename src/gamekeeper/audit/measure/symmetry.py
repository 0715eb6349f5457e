"""Whether agents of one role fare alike: the same game up to names, as far as it was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.stats import FloatArray
from gamekeeper.core.trace import Trace, Turn

ROUNDS: Final = 1_999
FEWEST: Final = 6
"""Episodes; fewer can't tell chance from a difference."""


def fares(trace: Trace, agents: Sequence[str]) -> FloatArray:
    """How each agent fared in one episode, [agents, features]: return, actions, terminated.

    Of an episode that was cut off only whole rounds count.
    """
    rows = np.zeros((len(agents), 3))
    place = {agent: row for row, agent in enumerate(agents)}
    for turn in _whole_rounds(trace):
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


def _whole_rounds(trace: Trace) -> Sequence[Turn]:
    """The turns before the last one of whoever is still there and acted first.

    Where agents take turns and we stop in mid-round, those before that place would have had an
    action more: that is our doing and not the game's.
    """
    turns = list(trace.turns)
    if trace.header.get("end") == "ended" or not turns:
        return turns
    gone = {agent for turn in turns for agent in turn.ended}
    first = next((agent for turn in turns for agent in turn.order if agent not in gone), None)
    return turns[: max((at for at, turn in enumerate(turns) if first in turn.order), default=0)]


def started(trace: Trace, agents: Sequence[str]) -> NDArray[np.bool_]:
    """Whether each agent stood in the roster from the reset on, [agents]."""
    first = next(trace.turns, None)
    return np.array([first is not None and agent in first.live for agent in agents])


def exchangeable(
    episodes: FloatArray,
    there: NDArray[np.bool_] | None = None,
    *,
    seed: int = 0,
    rounds: int = ROUNDS,
) -> float:
    """The p-value of agents being interchangeable: their rows permuted within each episode.

    The statistic is the largest deviation of an agent's sum from that of all, over agents and
    features, each feature in units of its spread.

    Args:
        episodes: [episodes, agents, features].
        there: [episodes, agents] whose rows count; None: all.
        seed: of the permutations.
        rounds: permutations.
    Source: Good 2005, "Permutation, Parametric and Bootstrap Tests of Hypotheses", ch. 6 (blocks).
    """
    there = np.ones(episodes.shape[:2], np.bool_) if there is None else there
    count = np.maximum(there.sum(axis=1), 1)[:, None, None]
    kept = np.where(there[:, :, None], episodes, 0.0)
    centred = np.where(there[:, :, None], kept - kept.sum(axis=1, keepdims=True) / count, 0.0)
    spread = np.sqrt((centred**2).mean(axis=(0, 1)))
    centred = centred[:, :, spread > 1e-12] / spread[spread > 1e-12]
    if centred.shape[2] == 0:
        return 1.0
    rng = np.random.default_rng([17, seed])
    seen = np.abs(centred.sum(axis=0)).max()
    blocks = np.arange(len(centred))[:, None]
    first = np.argsort(~there, axis=1, kind="stable")  # those who count stand before the others
    order = np.empty_like(first)
    hits = 0
    for _ in range(rounds):
        keys = np.where(there, rng.random(there.shape), np.inf)
        order[blocks, first] = np.argsort(keys, axis=1, kind="stable")
        hits += bool(np.abs(centred[blocks, order].sum(axis=0)).max() >= seen - 1e-12)
    return (1 + hits) / (rounds + 1)


def p_by_role(traces: Sequence[Trace], roles: Mapping[str, Sequence[str]]) -> dict[str, float]:
    """The p-value of each role, where enough episodes began with two of its agents at least.

    Who joins later had less time than the others: only those count who were there from the start.
    """
    found = {}
    for role, agents in roles.items():
        there = np.array([started(trace, agents) for trace in traces]).reshape(-1, len(agents))
        if (there.sum(axis=1) > 1).sum() >= FEWEST:
            rows = np.array([fares(trace, agents) for trace in traces])
            found[role] = exchangeable(rows, there)
    return found
