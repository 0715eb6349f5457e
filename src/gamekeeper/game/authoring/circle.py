"""The roster of an AEC environment as a circle of turns."""

from __future__ import annotations

from bisect import bisect_left
from typing import Any

from gamekeeper.game.authoring.verbs import AgentId


class Circle:
    """Who comes after whom, looked up in O(1); joining takes O(1) too, leaving O(log n).

    `after` and `before` hold each agent's neighbours, `place` a number for each that grows along
    the roster, from its first to its last.
    """

    __slots__ = ("_places", "after", "before", "place")

    def __init__(self, agents: list[Any]) -> None:
        """A circle of distinct agents in the order of the list."""
        self.place = {agent: place for place, agent in enumerate(agents)}
        self._places = list(range(len(agents)))  # of all in the circle, ascending
        self.after = dict(zip(agents, agents[1:] + agents[:1], strict=True))
        self.before = dict(zip(agents, agents[-1:] + agents[:-1], strict=True))

    def append(self, agent: AgentId, last: AgentId) -> None:
        """Puts an agent between the last of the roster and the first."""
        self.place[agent] = self._places[-1] + 1
        self._places.append(self.place[agent])
        first = self.after[last]
        self.after[last] = self.before[first] = agent
        self.after[agent], self.before[agent] = first, last

    def remove(self, agent: AgentId) -> int:
        """Takes an agent out of the circle and says which position of the roster it had."""
        after, before = self.after.pop(agent), self.before.pop(agent)
        if after != agent:
            self.after[before], self.before[after] = after, before
        position = bisect_left(self._places, self.place.pop(agent))
        del self._places[position]
        return position
