"""Counting games of another form than the API's, which an audit reads to see more of them."""

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.auditing.roster_games import Counting, Turning


class Older(Counting):
    """Reset returns observations alone, step four values, as in old Gym."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Returns no infos."""
        return super().reset(seed, options)[0]

    def step(self, actions: dict[Any, Any]) -> Any:
        """Returns one flag for each agent."""
        observations, rewards, ended, late, infos = super().step(actions)
        return observations, rewards, {a: ended[a] or late[a] for a in ended}, infos


class OlderTogether(Older):
    """The same with one more flag, for all."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """Ends by that flag alone."""
        observations, rewards, ended, infos = super().step(actions)
        return observations, rewards, {"__all__": all(ended.values())}, infos


class WithoutInfos(Older):
    """A step of three values."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """Returns no infos."""
        return super().step(actions)[:3]


class OlderTimed(Older):
    """All are cut by a limit that has a name."""

    def __init__(self) -> None:
        super().__init__(ends=(90, 90, 90), limit=8)
        self.max_steps = 8


class OlderByLot(Older):
    """Draws from NumPy's generator, which the seed has no part in."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws what is observed."""
        return dict.fromkeys(super().reset(seed, options), int(np.random.randint(100)))


class KeptSpaces(Counting):
    """Spaces are attributes that `reset` reads, in place of methods."""

    observation_space = spaces.Discrete(100)  # type: ignore[assignment]  # the fault
    action_space = spaces.Discrete(2)  # type: ignore[assignment]  # the fault

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Asks a space for its size."""
        assert self.action_space.n == 2  # type: ignore[attr-defined]  # a space, by the fault
        return super().reset(seed, options)


class KeptByLot(KeptSpaces):
    """Observations of such a game lie outside their space."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Counts from a hundred."""
        observations, infos = super().reset(seed, options)
        return dict.fromkeys(observations, 100), infos


class NamedSpaces(Turning):
    """A game in turns whose dictionaries of spaces no method reads."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.observation_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(100))
        self.action_spaces = dict.fromkeys(self.possible_agents, spaces.Discrete(2))

    def observation_space(self, agent: Any) -> Any:
        """Can't be asked."""
        raise TypeError(f"no space for {agent}")

    action_space = observation_space


class NothingTold(Older):
    """A step that returns nothing at all."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """Counts."""
        super().step(actions)
