"""Agents of a role that are shown the same: a policy that they share does the same for each.

Parameter sharing is the default of most trainers, and such a policy can't make two agents go to two
places. It is measured on a few steps before training, not read from spaces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import Any, Final

import numpy as np

from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.randomness.seeds import episode_seed
from gamekeeper.vector.vector_form import MASK

EPISODES: Final = 2
STEPS: Final = 12
"""Steps of each episode that are looked at: two agents that differ have mostly differed by then."""


def alike(
    env: Any, policies: JointPolicy, api: str, role_of: Callable[[Any], str]
) -> dict[str, tuple[list[Any], int]]:
    """Agents of each role that were shown the same observation whenever two of them were live.

    Args:
        env: an open environment; it is reset.
        policies: of all its agents, for the steps.
        api: "aec" or "parallel".
        role_of: role of an agent.
    Returns:
        By role: the agents, and how often two of them were compared.
    """
    same: dict[tuple[Any, Any], int] = {}
    differ: set[tuple[Any, Any]] = set()
    for shown in _looks(env, policies, api == "aec"):
        for pair in combinations(shown, 2):
            if role_of(pair[0]) != role_of(pair[1]) or pair in differ:
                continue
            if shown[pair[0]] == shown[pair[1]]:
                same[pair] = same.get(pair, 0) + 1
            else:
                differ.add(pair)
    found: dict[str, tuple[list[Any], int]] = {}
    for pair, count in same.items():
        if pair not in differ and count > 1:
            agents, looks = found.get(role_of(pair[0]), ([], 0))
            found[role_of(pair[0])] = list(dict.fromkeys([*agents, *pair])), looks + count
    return found


def _looks(env: Any, policies: JointPolicy, is_aec: bool) -> Iterator[dict[Any, bytes]]:
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
