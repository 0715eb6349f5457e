"""Checks of roles: agents of one role fare alike."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.checks.check import MEDIUM, Case, Cases, check
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import agents_fare_alike
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.where import Where
from gamekeeper.statistics.significance import FloatArray, holm

ROUNDS: Final = 1_999
ROUNDING: Final = 1e-9
"""Rounding, as a part of the largest value of a feature: sums in another order differ."""
FEWEST: Final = 6
"""Episodes; fewer can't tell chance from a difference."""


def fares(episode: Episode, agents: Sequence[str]) -> FloatArray:
    """Features of each agent in one episode, [agents, features]: return, actions, terminated.

    Of an episode that was cut off only whole rounds count.
    """
    rows = np.zeros((len(agents), 3))
    place = {agent: row for row, agent in enumerate(agents)}
    for turn in _whole_rounds(episode):
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


def _whole_rounds(episode: Episode) -> Sequence[Turn]:
    """The turns before the last one of whoever is still there and acted first.

    Where agents take turns and we stop in mid-round, those before that place would have had an
    action more: that is our doing and not the game's.
    """
    turns = episode.turns
    if episode.header.get("end") == "ended" or not turns:
        return turns
    gone = {agent for turn in turns for agent in turn.ended}
    first = next((agent for turn in turns for agent in turn.order if agent not in gone), None)
    return turns[: max((at for at, turn in enumerate(turns) if first in turn.order), default=0)]


def started(episode: Episode, agents: Sequence[str]) -> NDArray[np.bool_]:
    """Flags of agents that stood in the roster from the reset on, [agents]."""
    live = episode.turns[0].live if episode.turns else ()
    return np.array([agent in live for agent in agents])


def exchangeable(
    episodes: FloatArray,
    there: NDArray[np.bool_] | None = None,
    *,
    seed: int = 0,
    rounds: int = ROUNDS,
) -> float | None:
    """The p-value of agents being interchangeable: their rows permuted within each episode.

    None where no feature tells agents apart in any episode: nothing could have been seen.

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
    varies = spread > ROUNDING * np.abs(kept).max(axis=(0, 1), initial=0.0)
    centred = centred[:, :, varies] / spread[varies]
    if centred.shape[2] == 0:
        return None
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


def p_by_role(episodes: Sequence[Episode], roles: Mapping[str, Sequence[str]]) -> dict[str, float]:
    """The p-value of each role, where enough episodes began with two of its agents at least.

    Who joins later had less time than the others: only those count who were there from the start.
    """
    found = {}
    for role, agents in roles.items():
        there = np.array([started(episode, agents) for episode in episodes]).reshape(
            -1, len(agents)
        )
        if (there.sum(axis=1) > 1).sum() >= FEWEST:
            rows = np.array([fares(episode, agents) for episode in episodes])
            value = exchangeable(rows, there)
            if value is not None:
                found[role] = value
    return found


LEVEL = 0.01
"""Chance of calling interchangeable agents different, over all roles together."""
EPISODES = 40
"""Episodes of the reproducer."""


def _declared(contract: Contract, evidence: ProbeEvidence) -> str | None:
    if not any(role.symmetric for role in contract.roles.values()):
        return "no role is declared symmetric"
    schedule = contract.schedule
    if schedule.conflicts in ("priority", "ordered") or schedule.order == "fixed":
        return "the contract declares that some agents come first"
    return None


@check(
    "GK511",
    MEDIUM,
    "rollout",
    confidence=0.99,
    applies=_declared,
    looks_at="six episodes or more that two agents or more of a symmetric role begin",
)
def symmetric_agents_fare_alike(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Agents of a role that is declared symmetric are interchangeable: names don't decide.

    One policy for all agents of a role, and swapping them in evaluation, rely on it. A hidden
    priority (the lowest index wins every conflict) shows here too.

    Under random play the returns, numbers of actions and terminations of the agents that begin an
    episode are compared (who joins later had less time): their rows are permuted within each
    episode (1,999 times, the largest deviation over agents and features), at least six episodes,
    corrected by Holm over roles: the chance of a false alarm is at most 1 %. A difference that
    random play doesn't show is not seen.

    Bad:
        for agent in self.agents:              # the lowest index always gets the sample
            if self.cells[agent] in self.samples:
                self.collect(agent)

    Good:
        for agent in self.rng.permutation(self.agents):
            if self.cells[agent] in self.samples:
                self.collect(agent)

    Fix: treat the role's agents alike (starts, draws, who wins a conflict), or declare what sets
    them apart: symmetric = false, or conflicts = "priority"
    """
    roles: dict[str, list[str]] = {}
    for agent in evidence.agents:
        role = contract.role_of(agent)
        if role is not None and contract.roles[role].symmetric:
            roles.setdefault(role, []).append(agent)
    episodes = [episode for episode in evidence["rollout"] if episode.header.get("end") == "ended"]
    if len(episodes) < FEWEST:
        episodes = list(evidence["rollout"])
    p_values = p_by_role(episodes, roles)
    for role, p in zip(p_values, holm(list(p_values.values())), strict=True):
        where = Where("all rollouts", field=role)
        is_ok = p > LEVEL
        expected = f"agents of {role!r} have equal results with random actions"
        seen = f"they don't in {len(episodes)} episodes (p = {p:.4f})"
        proof = reproducer_of(agents_fare_alike, agents=roles[role], episodes=EPISODES, level=LEVEL)
        yield Case(where, is_ok, expected, seen, proof, confidence=1 - p if p <= LEVEL else None)
