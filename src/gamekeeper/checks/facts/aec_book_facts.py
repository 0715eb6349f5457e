"""Facts of the probe `books`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class LastRewards:
    """Rewards of `last()` by turn, where they are numbers."""

    turns: dict[int, Any]


@dataclass(frozen=True, slots=True)
class MarkedReward:
    """A reward that was raised by a mark before a live agent's step.

    Attributes:
        reward: before.
        mark: added.
        stood: whether it was added to what was there after the step too.
    """

    agent: Any
    reward: float
    mark: float
    stood: bool


@dataclass(frozen=True, slots=True)
class OwedAfterReset:
    """Debts after a reset in the midst of an episode.

    Attributes:
        last: the reward of `last()`.
        rewards: what isn't 0 in `rewards`.
        cumulative: what isn't 0 in `_cumulative_rewards`.
    """

    last: float
    rewards: dict[Any, float]
    cumulative: dict[Any, float]
