"""GK511."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.measure.symmetry import FEWEST, p_by_role
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof
from gamekeeper.core.stats import holm
from gamekeeper.core.where import Where

LEVEL = 0.01
"""Chance of calling interchangeable agents different, over all roles together."""
EPISODES = 40
"""Of the program that shows it again."""


def _declared(contract: Contract, evidence: Gathered) -> str | None:
    if not any(role.symmetric for role in contract.roles.values()):
        return "no role is declared symmetric"
    schedule = contract.schedule
    if schedule.conflicts in ("priority", "ordered") or schedule.order == "fixed":
        return "the contract declares that some agents come first"
    return None


@check(
    "GK511",
    needs=("rollout",),
    severity=MEDIUM,
    mend="treat the role's agents alike (starts, draws, who wins a conflict), or declare what "
    'sets them apart: symmetric = false, or conflicts = "priority"',
    confidence=0.99,
    applies=_declared,
)
def symmetric_agents_fare_alike(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Agents of a role that is declared symmetric are interchangeable: names don't decide.

    Who shares one policy among a role's agents, or swaps them in evaluation, relies on it. A hidden
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
    """
    roles: dict[str, list[str]] = {}
    for agent in evidence.agents:
        role = contract.role_of(agent)
        if role is not None and contract.roles[role].symmetric:
            roles.setdefault(role, []).append(agent)
    traces = [trace for trace in evidence["rollout"] if trace.header.get("end") == "ended"]
    if len(traces) < FEWEST:
        traces = list(evidence["rollout"])
    p_values = p_by_role(traces, roles)
    for role, p in zip(p_values, holm(list(p_values.values())), strict=True):
        yield Occasion(
            Where("all rollouts", field=role), p > LEVEL,
            f"agents of {role!r} fare alike under random play",
            f"they don't in {len(traces)} episodes (p = {p:.4f})",
            proof=_proof(evidence.api, roles[role]), confidence=1 - p if p <= LEVEL else None,
        )  # fmt: skip


_PARALLEL = """\
def fares(seed):
    env = make()
    observations, infos = env.reset(seed=seed)
    found = {a: [0.0, 0.0] for a in AGENTS if a in env.agents}
    for place, agent in enumerate(env.agents):
        env.action_space(agent).seed(1000 * seed + place)
    for _ in range(200):
        if not env.agents:
            break
        actions = {a: choice(env, a, observations.get(a), infos.get(a)) for a in env.agents}
        observations, rewards, _, _, infos = env.step(actions)
        for agent in found.keys() & actions.keys():
            found[agent][0] += rewards.get(agent, 0.0)
            found[agent][1] += 1
    return [found.get(a, [np.nan, np.nan]) for a in AGENTS]
"""
_AEC = """\
def fares(seed):
    env = make()
    env.reset(seed=seed)
    found = {a: [0.0, 0.0] for a in AGENTS if a in env.agents}
    for place, agent in enumerate(env.agents):
        env.action_space(agent).seed(1000 * seed + place)
    for turn, agent in enumerate(env.agent_iter(1000)):
        observation, _, terminated, truncated, info = env.last()
        ended = terminated or truncated
        env.step(None if ended else choice(env, agent, observation, info))
        for each in found:
            found[each][0] += env.rewards.get(each, 0.0)
        if agent in found and not ended:
            found[agent][1] += 1
    return [found.get(a, [np.nan, np.nan]) for a in AGENTS]
"""
_REST = f"""
def mixed(rows, rng):
    rows, there = rows.copy(), ~np.isnan(rows[:, 0])  # who joins later isn't compared
    rows[there] = rng.permutation(rows[there])
    return rows

table = np.array([fares(seed) for seed in range({EPISODES})])
table -= np.nanmean(table, axis=1, keepdims=True)
table /= np.maximum(np.sqrt(np.nanmean(table**2, axis=(0, 1))), 1e-12)
rng, hits = np.random.default_rng(0), 1
seen = np.abs(np.nansum(table, axis=0)).max()
for _ in range(999):
    again = np.array([mixed(rows, rng) for rows in table])
    hits += np.abs(np.nansum(again, axis=0)).max() >= seen - 1e-12
assert hits / 1000 > {LEVEL}, np.nanmean(table, axis=0)
"""


def _proof(api: str, agents: Sequence[str]) -> Proof:
    return Proof(
        f"AGENTS = {list(agents)!r}\n\n"
        "def choice(env, agent, observation, info):\n"
        "    for place in (observation, info):\n"
        '        if isinstance(place, dict) and "action_mask" in place:\n'
        '            mask = np.asarray(place["action_mask"]).astype(np.int8)\n'
        "            return env.action_space(agent).sample(mask)\n"
        "    return env.action_space(agent).sample()\n\n"
        + (_PARALLEL if api == "parallel" else _AEC)
        + _REST.rstrip(),
        plays=False,
    )
