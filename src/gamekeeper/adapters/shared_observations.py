"""Agents of a role that are shown the same: a policy that they share does the same for each.

Parameter sharing is the default of most trainers, and such a policy can't make two agents go to two
places. It is measured on a few steps before training, not read from spaces.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import numpy as np

from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector.vector_form import MASK

EPISODES: Final = 2
STEPS: Final = 12
"""Compared steps of each episode: two agents that differ have mostly differed by then."""


def alike(
    env: Any, policies: JointPolicy, api: str, role_of: Callable[[Any], str]
) -> dict[str, tuple[list[Any], int]]:
    """Agents of each role that were shown the same observation whenever they were live together.

    Groups are split at each step by what their agents are shown, so that the work grows with the
    number of agents and no faster.

    Args:
        env: an open environment; it is reset.
        policies: of all its agents, for the steps.
        api: "aec" or "parallel".
        role_of: role of an agent.
    Returns:
        By role: the agents, and how often two of them were compared.
    """
    group_of: dict[Any, tuple[Any, ...]] = {}
    rosters = []
    for step, shown in enumerate(_shown_observations(env, policies, api == "aec")):
        parts: dict[tuple[Any, ...], dict[bytes, list[Any]]] = {}
        for agent, seen in shown.items():
            group = group_of.setdefault(agent, (role_of(agent),))
            parts.setdefault(group, {}).setdefault(seen, []).append(agent)
        for group, members in parts.items():
            for number, agents in enumerate(members.values() if len(members) > 1 else ()):
                group_of |= dict.fromkeys(agents, (*group, (step, number)))
        rosters.append(list(shown))
    comparisons: dict[tuple[Any, ...], list[int]] = {}
    for roster in rosters:
        for group, count in Counter(group_of[agent] for agent in roster).items():
            if count > 1:
                comparisons.setdefault(group, []).append(count * (count - 1) // 2)
    found: dict[str, tuple[list[Any], int]] = {}
    for group, pairs in comparisons.items():
        if len(pairs) > 1:  # one look tells little
            agents, compared = found.get(group[0], ([], 0))
            same = [agent for agent, mine in group_of.items() if mine == group]
            found[group[0]] = [*agents, *same], compared + sum(pairs)
    return found


def _shown_observations(
    env: Any, policies: JointPolicy, is_aec: bool
) -> Iterator[dict[Any, bytes]]:
    """Yields what each live agent is shown, step by step, as bytes, in the order of agents."""
    order = list(env.possible_agents)
    for episode in range(EPISODES):
        given = env.reset(seed=episode_seed(0, episode))
        policies.begin(0, episode)
        for _ in range(STEPS):
            if not env.agents:
                break
            seen = {a: env.observe(a) for a in env.agents} if is_aec else given[0]
            yield {a: _as_bytes(seen[a]) for a in order if a in seen and a in env.agents}
            if is_aec:
                observation, _, terminated, truncated, info = env.last()
                agent = env.agent_selection
                is_dead = terminated or truncated
                env.step(None if is_dead else policies.act(agent, observation, info))
            else:
                seen, infos = given[0], given[-1]
                given = env.step(
                    {a: policies.act(a, seen[a], infos.get(a, {})) for a in env.agents}
                )


def _as_bytes(value: Any) -> bytes:
    """An observation without its mask, which no network reads, as bytes."""
    if isinstance(value, Mapping):
        parts = [_as_bytes(value[key]) for key in sorted(value, key=str) if key != MASK]
    elif isinstance(value, tuple):
        parts = [_as_bytes(part) for part in value]
    else:
        return np.asarray(value).tobytes()
    return b"".join(len(part).to_bytes(8, "big") + part for part in parts)
