"""Observations and rewards of another agent."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import clean, faulty
from tests.faults.tolls import Tolls
from tests.faults.traders import Traders


@faulty("GK219")
class LimitOfTheOneInTurn(Traders):
    """observe(agent) shows the limit of the trader in turn to everybody.

    Traders who each have a limit of their own, drawn at the reset and known to nobody else.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._seen = {
            a: spaces.Box(0.0, 1.0, (self.count + 4,), np.float32) for a in self.possible_agents
        }

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Draws a limit for each trader."""
        super().reset(seed, options)
        self.limits = {a: float(self.rng.uniform()) for a in self.possible_agents}

    def observe(self, agent: str) -> Any:
        """The limit of agent_selection stands last."""
        return np.append(super().observe(agent), self.limits[self.agent_selection]).astype(
            np.float32
        )


@clean()
class SeatsAreDrawn(Traders):
    """A clean environment: all see the seat of the trader in turn, which is public.

    Traders who are seated anew in each episode.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._seen = {
            a: spaces.Box(0.0, 1.0, (self.count + 4,), np.float32) for a in self.possible_agents
        }

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Draws the seats."""
        super().reset(seed, options)
        drawn = self.rng.permutation(self.count) / self.count
        self.seats = dict(zip(self.possible_agents, drawn.tolist(), strict=True))

    def observe(self, agent: str) -> Any:
        """The seat of the trader in turn stands last."""
        return np.append(super().observe(agent), self.seats[self.agent_selection]).astype(
            np.float32
        )


@clean()
class Loners(Tolls):
    """Rovers that know where they are, and no other one's place."""

    def observation(self, agent: str) -> Any:
        """The own cell stands first, the others are hidden."""
        hidden = super().observation(agent)
        own = hidden[2 * self.possible_agents.index(agent) :][:2].copy()
        hidden[: 2 * self.count] = 0.0
        hidden[:2] = own
        return hidden


@faulty("GK220", budget=1_500)
class SeenByTheNext(Loners):
    """Each rover is shown what the one before it observes, also at the reset.

    Rovers that know where they are, and no other one's place.
    """

    def observation(self, agent: str) -> Any:
        """A place in possible_agents that is off by one."""
        place = self.possible_agents.index(agent)
        return super().observation(self.possible_agents[place - 1])


@faulty("GK416", budget=1_500)
class PaidToTheNext(Loners):
    """Each rover is paid for where the one before it drove.

    Rovers that know where they are, and no other one's place.
    """

    def reward(self, agent: str) -> float:
        """A place in possible_agents that is off by one."""
        place = self.possible_agents.index(agent)
        return super().reward(self.possible_agents[place - 1])
