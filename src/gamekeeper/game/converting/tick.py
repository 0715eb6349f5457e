"""Who is told what as a tick of an AEC environment's turns ends."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from gamekeeper.errors import ContractError
from gamekeeper.game.authoring.verbs import AgentId
from gamekeeper.game.books import Books
from gamekeeper.game.capture.accounts import books_of
from gamekeeper.game.converting.tick_actions import TickActions
from gamekeeper.game.converting.tick_rewards import TickRewards, Totals

Told = tuple[Any, Any, Any, Any]  # observation, terminated, truncated, info
Step = tuple[
    dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, dict[str, Any]]
]


class Tick:
    """The end of a tick: None turns are played, and everybody is told what became of it."""

    env: Any
    agents: list[Any]

    def __init__(self, env: Any) -> None:
        """Takes an AEC environment that has all its wrappers."""
        super().__init__()
        self.env = env
        self._books: Any = books_of(env)
        self._keeps_books = isinstance(self._books, Books)
        # our own base class tells infos one by one, so they are asked for all at once
        asked = ("_masks", "_informs")
        self._asks_infos = any(getattr(self._books, name, False) is True for name in asked)
        self._actions = TickActions(env, self._books)
        self._rewards = TickRewards(self._books)
        self._gone: dict[Any, Told] = {}  # whose end is told in this tick
        self._lingering: set[Any] = set()  # whose end was told and who hasn't had its None turn

    def _told(self, totals: Totals | None) -> Step:
        """The five dictionaries of a tick whose turns have been played."""
        self._bury_the_dying()
        books, gone = self._books, self._gone
        agents = self.agents = self._live()
        self._actions.learn(agents)
        observations, infos = self._observations(agents), self._infos(agents)
        terms, truncs = books.terminations, books.truncations
        terminations = {agent: terms[agent] for agent in agents}
        truncations = {agent: truncs[agent] for agent in agents}
        for agent, (observation, terminated, truncated, info) in gone.items():
            observations[agent], infos[agent] = observation, info
            terminations[agent], truncations[agent] = terminated, truncated
        if totals is None:
            rewards = {
                agent: 0.0 if agent in gone else books.rewards.get(agent, 0.0)
                for agent in observations
            }
        else:
            for agent in totals.keys() - observations.keys():
                if np.any(totals[agent]):
                    raise _untold(agent, totals[agent])
            rewards = {agent: totals.get(agent, 0.0) for agent in observations}
        return observations, rewards, terminations, truncations, infos

    def _live(self) -> list[Any]:
        """Who can act next; who has ended and waits for its None turn is told now."""
        books = self._books
        terms, truncs = books.terminations, books.truncations
        agents = list(books.agents)
        if not any(terms.values()) and not any(truncs.values()):
            self._lingering.clear()
            return agents
        dying = [agent for agent in agents if terms[agent] or truncs[agent]]
        for agent in dying:
            if agent not in self._lingering:
                self._gone[agent] = self._last_words(agent)
        self._lingering = set(dying)
        return [agent for agent in agents if agent not in self._lingering]

    def _bury_the_dying(self) -> None:
        """None turns of those who ended, as far as the environment asks for them now."""
        books = self._books
        while books.agents:
            agent = books.agent_selection
            if not (books.terminations[agent] or books.truncations[agent]):
                return
            self._bury(agent)

    def _bury(self, agent: AgentId) -> None:
        """An agent's None turn; what it is given in it is what it is told last."""
        books = self._books
        if agent not in self._lingering and agent not in self._gone:
            self._gone[agent] = self._last_words(agent)
        self.env.step(None)
        if agent in books.agents and books.agent_selection == agent:
            raise ContractError(
                f"agent {agent!r} ended and doesn't leave",
                where="step(None)",
                expected="an agent that is out of the roster after its None turn",
                seen="one that is in turn again",
                mend="call self._was_dead_step(action) where the agent in turn has ended",
            )

    def _last_words(self, agent: AgentId) -> Told:
        """What an agent that ended is given."""
        books = self._books
        return (
            self._observations((agent,))[agent],
            books.terminations[agent],
            books.truncations[agent],
            self._infos((agent,))[agent],
        )

    def _observations(self, agents: Iterable[Any]) -> dict[Any, Any]:
        view = self._books._view if self._keeps_books else self._books.observe
        return {agent: view(agent) for agent in agents}

    def _infos(self, agents: Iterable[Any]) -> dict[Any, dict[str, Any]]:
        """New infos, as they are now."""
        books = self._books
        if self._asks_infos:
            return {agent: books._info_of(agent) for agent in agents}
        infos = books.infos
        try:
            return {agent: infos[agent].copy() for agent in agents}
        except (AttributeError, KeyError):  # no dictionary, which is told as it is; or none at all
            return {agent: _copied(infos.get(agent, {})) for agent in agents}


def _copied(info: Any) -> Any:
    return dict(info) if info.__class__ is dict else info


def _untold(agent: AgentId, reward: object) -> ContractError:
    return ContractError(
        f"agent {agent!r} was paid when it could no longer be told",
        where="rewards",
        expected="0 in the turns after the one in which it ended or left",
        seen=repr(reward)[:300],
        mend="pay what is owed in the turn that ends it",
    )
