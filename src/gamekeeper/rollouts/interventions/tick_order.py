"""Orders of a joint action: the same actions, handed over in another order of their dictionary."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.contract import Contract
from gamekeeper.episodes.outcome import Label
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.intervention import Hooks, Intervention
from gamekeeper.rollouts.interventions.perturbation import Perturbation, PerturbationHooks


@dataclass(frozen=True, slots=True)
class ActionOrder(Intervention):
    """Passes the same actions in another order of the dictionary.

    Attributes:
        order: `reversed` (every pair of agents changes its places), `rotated` (the first goes to
            the end), `shuffled` (another order at every turn).
    """

    label: ClassVar[Label] = "timing"

    order: str = "reversed"

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode."""
        return _Reordered(self.order)


class _Reordered(Hooks):
    def __init__(self, order: str) -> None:
        self._order = order

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        return {agent: actions[agent] for agent in reordered(self._order, list(actions), turn)}


def reordered(order: str, agents: Sequence[AgentId], turn: int) -> list[AgentId]:
    """The agents in the order of that name.

    Raises:
        KeyError: there is no such order.
    """
    listed = list(agents)
    if order == "reversed":
        return listed[::-1]
    if order == "rotated":
        return listed[1:] + listed[:1]
    if order == "shuffled":
        return random.Random(turn).sample(listed, len(listed))
    raise KeyError(order)


@dataclass(frozen=True, slots=True)
class LaterPlace(Perturbation):
    """Moves agents to the end of a tick's actions, or to the start where they are last.

    Nobody does anything else: only what hangs on the order within a tick is changed. With everybody
    named, the order is turned round. The strength is the probability at each tick.
    """

    label: ClassVar[Label] = "timing"
    USUAL: ClassVar[float] = 1.0
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one episode."""
        return _Moved(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where agents act one at a time, nor to one that is alone."""
        if hasattr(env, "agent_iter"):
            return "one agent acts at a time, so there is no order within a tick"
        is_alone = len(getattr(env, "possible_agents", ())) == 1
        return "there is no other agent" if is_alone else None


class _Moved(PerturbationHooks):
    def __init__(self, change: Perturbation, rng: Generator) -> None:
        super().__init__(change, rng)
        self._rng = self.stream("order")

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        if self._rng.random() >= self.strength:
            return actions
        moved = [agent for agent in actions if self.is_meant(agent)]
        others = [agent for agent in actions if not self.is_meant(agent)]
        order = others + moved
        if order == list(actions):
            order = moved + others if others else moved[::-1]
        return {agent: actions[agent] for agent in order}
