"""What tests of several tasks ask of knobs: the rows of an episode that is played by numbers."""

from typing import Any

import numpy as np

Rows = list[tuple[Any, ...]]


def rows(env: Any, seed: int, policy: str = "reference", most: int = 300) -> Rows:
    """An episode, turn by turn: agent, what it was given, what it did; infos without the mask."""
    rng, found = np.random.default_rng(seed), []
    choose = env.policies[policy]
    if not hasattr(env, "agent_iter"):
        return _ticks(env, seed, choose, rng, most)
    env.reset(seed=seed)
    for agent in env.agent_iter(most):
        seen, paid, terminated, truncated, info = env.last()
        action = None if terminated or truncated else choose(seen, agent, info, rng)
        state = tuple(env.state().tolist())
        found.append((agent, seen.tolist(), paid, terminated, truncated, action, state))
        env.step(action)
    return found


def _ticks(env: Any, seed: int, choose: Any, rng: np.random.Generator, most: int) -> Rows:
    seen, infos = env.reset(seed=seed)
    found: Rows = [({a: o.tolist() for a, o in seen.items()}, tuple(env.state().tolist()))]
    while env.agents and len(found) <= most:
        actions = {a: choose(seen[a], a, infos[a], rng) for a in env.agents}
        seen, rewards, terminations, truncations, infos = env.step(actions)
        given = {a: o.tolist() for a, o in seen.items()}
        state = tuple(env.state().tolist())
        found.append((actions, given, rewards, terminations, truncations, state))
    return found
