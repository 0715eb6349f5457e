"""What agents did once, done again whatever they are shown; only a few choose freely."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.layout import agent_name
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks
from gamekeeper.run.stress.offer import Offer, offer_of


@dataclass(frozen=True, slots=True)
class Reenacted(Change):
    """Everybody but those who are free does at each turn what stands on paper for that turn.

    Who has nothing on paper there chooses freely too. What is illegal now gives way to the declared
    noop, else to the first legal action.

    Attributes:
        free: agents who choose.
        paper: turn by turn, by agent.
    """

    free: tuple[str, ...] = ()
    paper: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _OnPaper(self)


class _OnPaper(Hooks):
    wants_given = True

    def __init__(self, change: Reenacted) -> None:
        self._free, self._paper = frozenset(change.free), change.paper
        self._contract, self._env = Contract(), None
        self._offers: dict[AgentId, Offer | None] = {}

    def declared(self, contract: Contract) -> None:
        self._contract = contract

    def before_reset(self, env: Any) -> None:
        self._env = env

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        """Notes the mask."""
        if agent_name(agent) in self._free:
            return
        if agent not in self._offers:
            self._offers[agent] = offer_of(self._contract, self._env, agent)
        offer = self._offers[agent]
        if offer is not None:
            offer.take(observation, info)

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """The paper's actions where there are some."""
        if turn >= len(self._paper):
            return actions
        paper = self._paper[turn]
        return {
            agent: action if action is None else self._done(paper, agent, action)
            for agent, action in actions.items()
        }

    def _done(self, paper: Mapping[str, Any], agent: AgentId, chosen: Any) -> Any:
        name = agent_name(agent)
        written = None if name in self._free else paper.get(name)
        if written is None:
            return chosen
        offer = self._offers.get(agent)
        if offer is None or offer.allows(written):
            return copy.deepcopy(written)
        return offer.stand_in(written)
