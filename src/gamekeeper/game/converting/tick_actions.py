"""The actions of a tick, looked at before the first of them is played."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gymnasium.spaces import Space
from pettingzoo import AECEnv

from gamekeeper.errors import ActionError
from gamekeeper.game.authoring.legality import judge, learn_ranges, refused
from gamekeeper.game.authoring.verbs import AgentId
from gamekeeper.game.books import Books


class TickActions:
    """Whether a dictionary of actions can be played by an AEC environment in one tick."""

    def __init__(self, env: AECEnv[Any, Any, Any], books: Any) -> None:
        """Takes the environment, and where its books are kept."""
        self._env, self._books = env, books
        self._keeps_books = isinstance(books, Books)
        self._trusts = getattr(books, "_trusts_ranges", True)
        self._spaces: dict[Any, Space[Any]] = {}
        self._ranges: dict[Any, range] = {}

    def learn(self, agents: Iterable[Any]) -> None:
        """Reads the action spaces of agents that come into the roster."""
        space_of = self._env.action_space
        learn_ranges(agents, space_of, self._spaces, self._ranges, trusted=self._trusts)

    def check(self, actions: Any, agents: list[Any]) -> None:
        """Each of these agents has an action, in its space, and nobody else has one.

        Raises:
            ActionError: it isn't so.
        """
        if not isinstance(actions, Mapping) or len(actions) != len(agents):
            raise mismatch(actions, agents)
        ranges = self._ranges
        for agent in agents:
            try:
                action = actions[agent]
            except KeyError:
                raise mismatch(actions, agents) from None
            if type(action) is not int or action not in ranges[agent]:
                self._check_one(agent, action)

    def check_turn(self, actions: Any, agents: list[Any], actor: AgentId) -> None:
        """The agent in turn has an action in its space, and nobody has one who isn't live.

        Raises:
            ActionError: it isn't so.
        """
        if not isinstance(actions, Mapping) or not set(actions) <= set(agents):
            raise mismatch(actions, agents)
        if actor not in actions:
            raise mismatch(actions, [actor])
        self._check_one(actor, actions[actor])

    def _check_one(self, agent: AgentId, action: Any) -> None:
        """One of our own environments judges by itself, its masks and penalties included."""
        if self._keeps_books:
            if not getattr(self._books, "_pardons", False):
                self._books._judge(agent, action)
            return
        space = self._spaces[agent]
        if not judge(space, action)[0]:
            raise refused(agent, action, space)


def mismatch(actions: Any, agents: list[Any]) -> ActionError:
    """Which agents have no action, and which shouldn't have one."""
    if not isinstance(actions, Mapping):
        seen = f"{actions!r} ({type(actions).__name__})"
    else:
        missing = [repr(agent) for agent in agents if agent not in actions]
        extra = [repr(agent) for agent in actions if agent not in agents]
        faults = (("no action of", missing), ("an action of", extra))
        seen = "; ".join(f"{fault} {', '.join(names)}" for fault, names in faults if names)
    return ActionError(
        "the actions of a tick aren't those of the live agents",
        where="step",
        expected=f"one of each of {agents!r}"[:300],
        seen=seen[:600],
        mend="build the dictionary over env.agents",
    )
