"""The order in which agents act, and what it decides."""

from __future__ import annotations

from typing import Any

from tests.faults import clean, faulty
from tests.faults.traders import FarTraders, Traders


@faulty("GK301")
class SelectsRemoved(Traders):
    """A bankrupt trader is removed, and stays selected.

    Dead steps select nobody.
    """

    def _was_dead_step(self, action: Any) -> None:
        """Removes the trader, and leaves the selection as it is."""
        gone = self.agent_selection
        super()._was_dead_step(action)
        if self.agents:
            self.agent_selection = gone


@faulty("GK302")
class RemovedByOthers(Traders):
    """A bankrupt trader is taken out of the game by the next step of another.

    It has no None step of its own.
    """

    def live(self) -> list[str]:
        """Traders that go on."""
        return [a for a in self.agents if not (self.terminations[a] or self.truncations[a])]

    def _deads_step_first(self) -> Any:
        """Leaves the bankrupt where they are, while others go on."""
        return self.agent_selection if self.live() else super()._deads_step_first()

    def step(self, action: Any) -> None:
        """Takes the bankrupt out, unasked."""
        for agent in set(self.agents) - set(self.live()) if self.live() else ():
            for book in (self.terminations, self.truncations, self.rewards, self.infos):
                del book[agent]
            del self._cumulative_rewards[agent]
            self.agents.remove(agent)
        super().step(action)


@faulty("GK303")
class AskedTwice(Traders):
    """A dead trader is asked twice before it is removed.

    The first None step of a trader changes nothing.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Nobody has been asked."""
        super().reset(seed, options)
        self.asked: set[str] = set()

    def _was_dead_step(self, action: Any) -> None:
        """Removes a trader at its second None step."""
        agent = self.agent_selection
        if agent in self.asked or action is not None:
            super()._was_dead_step(action)
            return
        self.asked.add(agent)
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()


@faulty("GK303")
class FarTwice(AskedTwice, FarTraders):
    """The same at the end of an episode that no rollout plays to its end."""


@faulty("GK304", budget=2_000)
class DeadForgotten(Traders):
    """A bankrupt trader isn't selected any more, and stays in `agents` until all are done.

    Only one trader can go bankrupt, and it has to wait.
    """

    def __init__(self, count: int = 3, rounds: int = 40, render_mode: str | None = None) -> None:
        super().__init__(count, rounds, render_mode)

    def settle(self) -> None:
        """Everybody but the first trader is lent money in time."""
        for agent in self.possible_agents[1:]:
            self.money[agent] = min(max(self.money[agent], 6), 12)
        super().settle()

    def _deads_step_first(self) -> Any:
        """Selects the dead once nobody else is left."""
        if any(not (self.terminations[a] or self.truncations[a]) for a in self.agents):
            return self.agent_selection
        return super()._deads_step_first()


@faulty("GK305")
class IteratesBackwards(Traders):
    """`agent_iter` goes through the agents in an order of its own.

    An iterator of its own.
    """

    def agent_iter(self, max_iter: int = 2**63) -> Any:
        """Names the agents from the last to the first."""
        while self.agents and max_iter > 0:
            for agent in reversed(list(self.agents)):
                max_iter -= 1
                if max_iter >= 0:
                    yield agent


@faulty("GK306", contract={"schedule": {"stages": [["trader"]], "order": "fixed"}})
class OtherOrder(Traders):
    """Traders are declared to bid in a fixed order, and rotate.

    As it is, under a contract that says otherwise.
    """


@clean(contract={"schedule": {"stages": [["trader"]], "order": "rotating"}})
class RotatingTraders(Traders):
    """A clean environment that declares its rotating order: no check is broken on it.

    The opening trader rotates, as declared.
    """
