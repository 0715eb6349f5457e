"""Who plays its own policy and who the baseline, also where agents join late."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from gamekeeper.core.layout import agent_name
from gamekeeper.game.door import AgentId
from gamekeeper.run.play import Cast


class Sides:
    """A cast of two: members of a coalition play their own policies, other players the baseline.

    `others` are no players though they are there from the start: they play their policies.

    One who joins late is on the side of the one of its role who left last; where nobody of its role
    has left, on the side of most of them, that of the policies where they are equal.
    """

    def __init__(
        self,
        own: Cast,
        baseline: Cast,
        members: Collection[str],
        players: Collection[str],
        others: Collection[str],
        role_of: Callable[[AgentId], str | None],
        env: Any,
    ) -> None:
        self._own, self._baseline = own, baseline
        self._start = {player: player in members for player in players}
        self._start |= dict.fromkeys(others, True)
        self._role_of, self._env = role_of, env
        self._side: dict[str, bool] = {}
        self._last: dict[str, int] = {}
        self._decisions = 0

    def begin(self, run_seed: int, episode: int) -> None:
        """Seeds all policies for an episode; nobody has joined yet."""
        self._own.begin(run_seed, episode)
        self._baseline.begin(run_seed, episode)
        self._side, self._last, self._decisions = dict(self._start), {}, 0

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """What an agent does on its side."""
        name = agent_name(agent)
        side = self._side.get(name)
        if side is None:
            side = self._side[name] = self._joined(agent)
        self._decisions += 1
        self._last[name] = self._decisions
        return (self._own if side else self._baseline).act(agent, observation, info)

    def _joined(self, agent: AgentId) -> bool:
        role, live = self._role_of(agent), {agent_name(each) for each in self._env.agents}
        peers = [name for name in self._side if self._role_of(name) == role]
        gone = [name for name in peers if name not in live and name in self._last]
        if gone:
            return self._side[max(gone, key=self._last.__getitem__)]
        own = sum(self._side[name] for name in peers)
        return 2 * own >= len(peers)
