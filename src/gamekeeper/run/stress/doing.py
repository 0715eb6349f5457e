"""Stressors of what agents do: hooks that carry out something else than was chosen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.game.door import AgentId
from gamekeeper.run.stress.offer import Offer, offer_of
from gamekeeper.run.stress.stressor import Stress, Stressor

Hand = Callable[[Any], Any]
"""From what was chosen to what is done; called once at each of an agent's turns."""


class Doing(Stress):
    """Hooks that give each agent a hand when it first acts.

    What a hand does in place of what was chosen, and isn't legal now, gives way to the stand-in of
    `Offer`: the declared noop, else the first legal action.
    """

    wants_given = True

    def __init__(self, change: Stressor, rng: Generator) -> None:
        super().__init__(change, rng)
        self._hands: dict[AgentId, tuple[Offer, Hand] | None] = {}

    def given(self, turn: int, agent: AgentId, observation: Any, info: Any) -> None:
        """Notes the mask."""
        found = self._of(agent)
        if found is not None:
            found[0].take(observation, info)

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """What the agents' hands make of it; dead agents do nothing anyway."""
        return {
            agent: None if action is None else self._done(agent, action)
            for agent, action in actions.items()
        }

    def _done(self, agent: AgentId, action: Any) -> Any:
        found = self._of(agent)
        if found is None:
            return action
        offer, hand = found
        done = hand(action)
        return done if done is action or offer.allows(done) else offer.stand_in(action)

    def _of(self, agent: AgentId) -> tuple[Offer, Hand] | None:
        if agent not in self._hands:
            offer = offer_of(self.contract, self.env, agent) if self.is_meant(agent) else None
            hand = None if offer is None else (offer, self.hand(offer, self.stream(agent)))
            self._hands[agent] = hand
        return self._hands[agent]

    def hand(self, offer: Offer, rng: Generator) -> Hand:
        """The hand of an agent, for one play; it never writes into what was chosen."""
        raise NotImplementedError


def does_nothing(contract: Contract, env: Any, agent: AgentId) -> str | None:
    """Why what an agent does can't be disturbed."""
    found = offer_of(contract, env, agent)
    return "the environment doesn't say what it may do" if found is None else None
