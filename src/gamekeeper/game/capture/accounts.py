"""Reading the books of an AEC environment: where they are kept, whom they pay."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, Final

from pettingzoo.utils import wrappers

from gamekeeper.game.capture.oddity import MISSING, REALS, odd, reward_of
from gamekeeper.game.converting.slim_aec import SlimAEC

AgentId = Hashable
# wrappers of PettingZoo, and the face in their place, keep no books of their own: those are read
# where they are kept, since an attribute costs 0.65 us for each wrapper that it falls through
TRANSPARENT: Final = (
    wrappers.BaseWrapper,
    wrappers.OrderEnforcingWrapper,
    wrappers.AssertOutOfBoundsWrapper,
    wrappers.ClipOutOfBoundsWrapper,
    wrappers.TerminateIllegalWrapper,
    wrappers.CaptureStdoutWrapper,
    SlimAEC,
)


def books_of(env: Any) -> Any:
    """Where the books of `env` are kept: the first environment that isn't a transparent wrapper."""
    while type(env) in TRANSPARENT:
        env = env.env
    return env


def entry_of(book: Any, agent: AgentId) -> Any:
    """What a book says of an agent; MISSING where it says nothing."""
    try:
        return book[agent] if book.__class__ is dict else book.get(agent, MISSING)
    except (AttributeError, KeyError, TypeError):
        return MISSING


def reward_in(rewards: Mapping[AgentId, Any], agent: AgentId, entry: Any) -> tuple[Any, Any]:
    """What `rewards` pays an agent, and its odd part: `entry`, with what is no number added."""
    reward = rewards.get(agent)
    if reward.__class__ is float or reward_of(reward) is not None:
        return reward, entry
    if reward is None and agent not in rewards:
        return None, entry
    return None, (*(entry or ()), odd("reward", reward))


def pays_others(rewards: Mapping[AgentId, Any], reward: Any) -> bool:
    """Whether `rewards` may pay anybody but the agent whose own reward is `reward`.

    Counting one of the zeros that are in it finds the others by identity, at 1 ns each, where `any`
    asks every number for its truth.
    """
    values = list(rewards.values())
    zero = values[0] if values and values[0].__class__ in REALS and not values[0] else 0
    try:
        return len(values) - values.count(zero) != (1 if reward else 0)
    except ValueError:  # a reward that is an array has no truth
        return True


def paid_others(rewards: Mapping[AgentId, Any], agent: AgentId) -> list[AgentId]:
    """Those that `rewards` pays, but for `agent`; what is no number counts as pay, to be seen."""
    return [
        other
        for other, reward in rewards.items()
        if other != agent and (reward.__class__ not in REALS or reward)
    ]
