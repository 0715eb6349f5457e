"""Spaces, and values that aren't in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import faulty
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


@faulty("GK201")
class LateSpaces(Rovers):
    """Spaces are made by the first reset.

    Before a reset nobody has a space.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.later, self._seen, self._done = (self._seen, self._done), {}, {}

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Only now there are spaces."""
        self._seen, self._done = self.later
        return super().reset(seed, options)


@faulty("GK202")
class NewSpaces(Rovers):
    """Every call makes a new action space.

    Seeding an action space has no effect.
    """

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """A new one."""
        return spaces.Discrete(5)


@faulty("GK203")
class GrowingSpace(Rovers):
    """The action space grows with every reset.

    Each episode there is one more action, which does nothing.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.episodes = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """One more action."""
        self.episodes += 1
        self._done = {a: spaces.Discrete(5 + self.episodes) for a in self.possible_agents}
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """What is new does nothing."""
        super().drive(agent, action if action < 5 else 0)


@faulty("GK204")
class NoBounds(Rovers):
    """The lower bounds of the observation space are NaN: a range that isn't known yet.

    Nothing is in such a space, whatever is observed.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        for space in self._seen.values():
            space.low = np.full_like(space.low, np.nan)


@faulty("GK205")
class OldDictionary(Rovers):
    """The dictionary of action spaces was forgotten when an action was added.

    Who reads the dictionary never drives to one side.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.action_spaces = {a: spaces.Discrete(4) for a in self.possible_agents}


@faulty("GK211")
class Lists(Rovers):
    """A rover whose battery is empty observes a list.

    Only the last observation is one.
    """

    def observation(self, agent: str) -> Any:
        """A list at the end."""
        seen = super().observation(agent)
        return seen if self.battery[agent] > 0 else seen.tolist()


@faulty("GK212")
class Doubles(Rovers):
    """Observations are of float64, and the space says float32.

    Twice as long as declared.
    """

    def observation(self, agent: str) -> Any:
        """Without the last conversion."""
        return super().observation(agent).astype(np.float64)


@faulty("GK213")
class Shrinking(Rovers):
    """Observations shrink when a rover has left.

    Those who are left see only each other.
    """

    def observation(self, agent: str) -> Any:
        """The cells of live rovers."""
        seen = super().observation(agent)
        gone = [i for i, a in enumerate(self.possible_agents) if a not in self.agents]
        return np.delete(seen, [2 * i + k for i in gone for k in (0, 1)])


@faulty("GK214")
class BelowZero(Rovers):
    """An empty battery is charged below zero, outside the space.

    Seen only at the end of a rover.
    """

    def drive(self, agent: str, action: int) -> None:
        """Driving into a sample costs three."""
        super().drive(agent, action)
        if np.array_equal(self.cells[agent], self.samples[agent]):
            self.battery[agent] -= 3

    def observation(self, agent: str) -> Any:
        """The battery as it is."""
        seen = super().observation(agent)
        seen[-1] = self.battery[agent] / 30
        return seen


@faulty("GK214")
class DebtIsSeen(Traders):
    """All observe purses less the rent, below zero for who can't pay it.

    In the own turn and in any other.
    """

    def observe(self, agent: str) -> Any:
        """Purses of next round."""
        seen = super().observe(agent)
        seen[: self.count] -= np.float32(2 / 40)
        return seen


@faulty("GK215")
class Lonely(Rovers):
    """The last rover observes NaN: the mean over no others.

    Where the others are, on average.
    """

    def observation(self, agent: str) -> Any:
        """The first two numbers are the mean of the others."""
        seen = super().observation(agent)
        others = [self.cells[a] / 5 for a in self.agents if a != agent]
        with np.errstate(all="ignore"):
            seen[:2] = np.array(others).reshape(-1, 2).sum(axis=0) / np.float64(len(others))
        return seen


@faulty("GK216")
class OwnTurn(Traders):
    """A trader observes nothing while it is another one's turn.

    Closed eyes between the own turns.
    """

    def observe(self, agent: str) -> Any:
        """None for all but one."""
        return super().observe(agent) if agent == self.agent_selection else None


@faulty("GK221")
class Broke(Traders):
    """A bid above what a trader has is refused, and no mask says so.

    Only the rich may choose from the whole action space.
    """

    def step(self, action: Any) -> None:
        """Refuses bids that cannot be paid."""
        agent = self.agent_selection
        if action is not None and int(action) > self.money[agent]:
            raise ValueError(f"{agent} has only {self.money[agent]}")
        super().step(action)


@faulty("GK221", budget=20_000)
class Knot(Rovers):
    """A step raises once all rovers meet in the first cell: too seldom for the rollouts.

    The way out is looked up among the rovers that stand elsewhere, and there is none.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Looks for a rover in another cell."""
        out = super().step(actions)
        cells = [tuple(cell) for cell in self.cells.values()]
        if cells.count((0, 0)) == len(cells):
            raise ValueError("no rover stands elsewhere")
        return out


@faulty("GK214", budget=20_000)
class Crowded(Rovers):
    """An observation leaves its space once all rovers meet in one cell of the middle row.

    What the others give is added to the battery, which may be full. It shows once in 45 episodes.
    """

    row = 2

    def observation(self, agent: str) -> Any:
        """Adds what the others give who stand here."""
        seen = super().observation(agent)
        cells = [tuple(cell) for cell in self.cells.values()]
        if cells.count(cells[0]) == len(cells) and cells[0][0] == self.row:
            seen[-1] += 1.0
        return seen


@faulty("GK222")
class Stuck(Rovers):
    """After an action that it refused the environment cannot be reset any more.

    A guard against being called twice is not taken back when a step raises.
    """

    is_stepping = False

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Refuses in the middle of a step."""
        if self.is_stepping:
            raise RuntimeError("reset in the middle of a step")
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Notes that a step is being made."""
        self.is_stepping = True
        if not all(self._done[a].contains(actions[a]) for a in self.agents):
            raise ValueError("illegal action")
        out = super().step(actions)
        self.is_stepping = False
        return out
