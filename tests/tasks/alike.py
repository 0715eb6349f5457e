"""Two environments played side by side: all that they tell is the same, bit for bit."""

from collections.abc import Callable
from typing import Any

import numpy as np

Choose = Callable[[Any, Any, Any], Any]
"""From the generator, an agent's observation and its info, an action."""


def legal_often(rng: Any, seen: Any, info: Any) -> int:
    """A random action: mostly one that the mask allows, else any."""
    mask = info["action_mask"]
    allowed = np.flatnonzero(mask)
    return int(rng.integers(len(mask)) if rng.random() < 0.02 else rng.choice(allowed))


def uniform(count: int) -> Choose:
    """A random action of so many."""
    return lambda rng, seen, info: int(rng.integers(count))


def bits(value: Any) -> Any:
    """A value that is equal to another one only where types, shapes and bits are the same."""
    kind = type(value)
    if kind is np.ndarray:
        return value.dtype.str, value.shape, value.tobytes()
    if kind is dict:
        return [(key, bits(item)) for key, item in value.items()]
    if kind is tuple or kind is list:
        return [bits(item) for item in value]
    return kind, repr(value)


def told(env: Any, given: Any) -> dict[str, Any]:
    """All that an environment tells now, beside what its last call gave."""
    plain = [env.agents, env.rewards, env.terminations, env.truncations, env.endings, env.turns]
    terms = {agent: env.terms[agent] for agent in sorted(env.terms)}
    found = {"plain": repr(plain), "terms": repr(terms), "rng": env.rng.state}
    found |= {"given": bits(given), "state": bits(env.state()), "infos": bits(env.infos)}
    if hasattr(env, "_cumulative_rewards"):
        found["sums"] = repr(env._cumulative_rewards)
        found["turn"] = env.agent_selection if env.agents else None
        found["views"] = bits([env.observe(agent) for agent in env.agents])
    return found


def ticks_alike(one: Any, two: Any, *, choose: Choose, seed: int, steps: int) -> dict[str, int]:
    """Plays two Parallel environments for so many ticks; by reason, how many agents ended."""
    rng, endings, left = np.random.default_rng(seed), dict[str, int](), steps
    given = [env.reset(seed=seed) for env in (one, two)]
    while left > 0:
        assert told(one, given[0]) == told(two, given[1])
        if one.agents:
            seen, infos = given[0][0], given[0][-1]
            actions = {agent: choose(rng, seen[agent], infos[agent]) for agent in one.agents}
            given = [env.step(actions) for env in (one, two)]
            left -= 1
        else:
            _count(endings, one)
            given = [env.reset() for env in (one, two)]
    return endings


def turns_alike(one: Any, two: Any, *, choose: Choose, seed: int, steps: int) -> dict[str, int]:
    """Plays two AEC environments for so many turns; by reason, how many agents ended."""
    rng, endings, left = np.random.default_rng(seed), dict[str, int](), steps
    given: list[Any] = [env.reset(seed=seed) for env in (one, two)]
    while left > 0:
        given = [env.last() if env.agents else None for env in (one, two)]
        assert told(one, given[0]) == told(two, given[1])
        if not one.agents:
            _count(endings, one)
            _ = [env.reset() for env in (one, two)]
            continue
        seen, _, terminated, truncated, info = given[0]
        action = None if terminated or truncated else choose(rng, seen, info)
        for env in (one, two):
            env.step(action)
        left -= action is not None
    return endings


def _count(endings: dict[str, int], env: Any) -> None:
    for reason in env.endings.values():
        endings[reason] = endings.get(reason, 0) + 1
