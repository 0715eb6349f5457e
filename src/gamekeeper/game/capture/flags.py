"""The flags of an AEC environment as they stood at the start of the last turn."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from itertools import compress, repeat
from operator import ne
from typing import Any

from gamekeeper.game.capture.oddity import flag_of

AgentId = Hashable


class Flags:
    """One kind of flag of all agents, as it stood at the start of the last turn."""

    __slots__ = ("_known", "_name", "_values")

    def __init__(self, name: str) -> None:
        self._name = name
        self.clear()

    def clear(self) -> None:
        """Nobody's flag is known: all are False."""
        self._known: dict[AgentId, Any] = {}
        self._values: list[Any] = []

    def differ_from(self, flags: Mapping[AgentId, Any]) -> bool:
        """Whether any flag has changed, by comparing values in the order of the books."""
        try:
            return list(flags.values()) != self._values
        except ValueError:  # a flag that is an array has no truth
            return True

    def take(self, flags: Mapping[AgentId, Any]) -> list[AgentId]:
        """Takes the flags as known and returns whose have changed."""
        before = map(self._known.get, flags, repeat(False))
        try:
            changed = list(compress(flags, map(ne, flags.values(), before)))
        except ValueError:
            known = self._known
            changed = [agent for agent in flags if flags[agent] is not known.get(agent, False)]
        self._known, self._values = dict(flags), list(flags.values())
        return changed

    def forget(self, agent: AgentId) -> bool:
        """Takes out an agent that has left; whether its flag was set."""
        if agent not in self._known:
            return False
        flag = self._known.pop(agent)
        self._values = list(self._known.values())
        return _is_set(flag)

    def put(self, agent: AgentId, flag: Any) -> None:
        """Takes one flag as known; `differ_from` then says that they differ."""
        self._known[agent], self._values = flag, []

    def drop(self, agent: AgentId) -> bool:
        """Takes out an agent that has left, likewise; whether its flag was set."""
        self._values = []
        return _is_set(self._known.pop(agent, False))

    def has(self, agent: AgentId) -> bool:
        """Whether the agent's flag is set."""
        return _is_set(self._known.get(agent, False))

    def of(self, agent: AgentId, entries: list[str]) -> Any:
        """The agent's flag for its row; one that is no bool goes to `entries`."""
        return flag_of(self._known.get(agent, False), self._name, entries)


def _is_set(flag: Any) -> bool:
    try:
        return bool(flag)
    except ValueError:  # an array of flags says nothing
        return False
