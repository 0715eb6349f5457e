"""What is seen at the start and at the end of a play, so that two plays can be compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from gamekeeper.audit.lab import Lab
from gamekeeper.core.canon import to_json

MOST_SEEN: Final = 3
"""Agents whose observations are compared in an AEC environment: they may be large."""


@dataclass(slots=True)
class Sight:
    """What is seen at the start and at the end of a play, as text; None where that can't be told.

    Attributes:
        agents: how many stood in `agents` at the start; None where nobody can, which is a fault of
            the roster's.
        dead: (AEC) turns at which somebody was to act whose flags were up.
    """

    lab: Lab
    first: str | None = None
    last: str | None = None
    agents: int | None = None
    dead: list[int] = field(default_factory=list)
    _out: Any = None

    def watch(self, turn: int, env: Any, out: Any) -> None:
        """Looks at the start, and keeps in mind what came last."""
        self._out = out
        if turn == 0:
            self.first = self._seen(env)
            possible, agents = self._roster(env, "possible_agents"), self._roster(env, "agents")
            self.agents = len(agents or ()) if possible is None or len(possible) else None
        if self.lab.api == "aec" and not self.dead and is_dead(self.lab, env):
            self.dead.append(turn)

    def settle(self, env: Any) -> None:
        """Looks at the end."""
        self.last = self._seen(env)

    def _seen(self, env: Any) -> str | None:
        if self.lab.api == "parallel":
            seen = self._out[0] if isinstance(self._out, tuple) and self._out else None
            if isinstance(seen, Mapping):  # who has just ended is seen once more, by no reset
                live = list(self._roster(env, "agents") or ())
                seen = {agent: item for agent, item in seen.items() if agent in live}
            return None if seen is None else to_json(seen)
        agents = list(self._roster(env, "agents") or ())[:MOST_SEEN]
        called = [self.lab.call("observe", env.observe, agent) for agent in agents]
        return None if any(each.failed for each in called) else to_json([e.value for e in called])

    def _roster(self, env: Any, name: str) -> Any:
        return self.lab.call(name, getattr, env, name).value


def is_dead(lab: Lab, env: Any) -> bool:
    """Whether the agent in turn has its flags up."""
    if not lab.call("agents", getattr, env, "agents").value:
        return False
    agent = lab.call("agent_selection", getattr, env, "agent_selection").value
    books = (lab.call(name, getattr, env, name).value for name in ("terminations", "truncations"))
    return any(isinstance(book, Mapping) and bool(book.get(agent)) for book in books)
