"""A task of ours beside PettingZoo's game of the same rules, turn by turn."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pettingzoo.utils.env_logger import EnvLogger

ILLEGAL = 0.06
"""Probability that an action is drawn from all, legal or not."""


def plain(last: tuple[Any, ...]) -> tuple[Any, ...]:
    """What `last` tells as lists; ours tells the mask in infos too."""
    seen, paid, terminated, truncated, info = last
    told = {name: value for name, value in info.items() if name != "action_mask"}
    return _lists(seen), float(paid), bool(terminated), bool(truncated), told


def books(env: Any) -> tuple[Any, ...]:
    """All that an AEC environment's books say now, and whose turn it is."""
    bare = env.unwrapped
    return (
        list(bare.agents),
        bare.agent_selection,
        bare.rewards,
        bare._cumulative_rewards,
        bare.terminations,
        bare.truncations,
    )


def _lists(seen: dict[str, Any]) -> Any:
    return {key: (part.dtype.str, part.tolist()) for key, part in seen.items()}


@pytest.fixture
def quiet() -> Iterator[None]:
    """PettingZoo doesn't say in the log that a move was illegal."""
    EnvLogger.suppress_output()
    yield
    EnvLogger.unsuppress_output()


def walk(ours: Any, theirs: Any, *, steps: int, seed: int) -> dict[str, int]:
    """Plays both with the same actions and asserts that they tell the same; counts endings.

    Before each action all that `last` and the books say is compared, and while the game goes on
    what the other player may see.
    """
    rng = np.random.default_rng(seed)
    ends: dict[str, int] = {}
    for step in range(steps):
        if step == 0 or not theirs.agents:
            ours.reset(seed=seed)
            theirs.reset(seed=seed)
        assert plain(ours.last()) == plain(theirs.last())
        assert books(ours) == books(theirs)
        agent = theirs.agent_selection
        if theirs.terminations[agent]:
            ends[ours.endings[agent]] = ends.get(ours.endings[agent], 0) + 1
            ours.step(None)
            theirs.step(None)
            continue
        for each in theirs.agents:
            assert _lists(ours.observe(each)) == _lists(theirs.observe(each))
        flags = theirs.observe(agent)["action_mask"]
        legal = np.arange(len(flags)) if rng.random() < ILLEGAL else np.flatnonzero(flags)
        action = int(rng.choice(legal))
        ours.step(action)
        theirs.step(action)
    return ends
