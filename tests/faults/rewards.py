"""Rewards: when they are paid, and to which agent."""

from __future__ import annotations

import math
from typing import Any

from tests.faults import clean, faulty
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders

PAID_BY_TERM = {
    "rewards": {
        "sample": {"kind": "individual", "payee": "earner"},
        "team": {"kind": "shared", "payee": "all"},
    }
}


@faulty("GK401")
class NanReward(Rovers):
    """A rover with little left in its battery is paid NaN.

    The reward is divided by nothing once.
    """

    def reward(self, agent: str) -> float:
        """NaN where the battery stands at 5."""
        reward = super().reward(agent)
        return math.nan if self.battery[agent] == 5 else reward


# Who has left the game still stands in the dictionaries.
@faulty("GK402", also=("GK106",))
class PaidAfterEnd(Rovers):
    """A rover that has ended is paid once more, one tick late.

    The consolation comes a tick after the end.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Owes nobody anything from before."""
        self.late: list[str] = []
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays those who ended in the step before."""
        late = self.late
        out = super().step(actions)
        self.late = [a for a in out[2] if out[2][a]]
        if self.agents:
            for agent in late:
                out[1][agent] = 0.5
        return out


@faulty("GK403")
class LastRewardLost(Traders):
    """Rewards of a round in which a trader goes bankrupt never reach `last()`.

    The step that ends somebody returns too early.
    """

    def _accumulate_rewards(self) -> None:
        """Forgets to, where somebody has ended."""
        if not any(self.terminations.values()):
            super()._accumulate_rewards()


@faulty("GK404")
class NeverCleared(Traders):
    """`_cumulative_rewards` isn't cleared: `last()` gives the return so far.

    What a trader was told is told again.
    """

    def step(self, action: Any) -> None:
        """Puts back what has been told."""
        agent = self.agent_selection
        told = self._cumulative_rewards[agent]
        super().step(action)
        if agent in self._cumulative_rewards:
            self._cumulative_rewards[agent] += told


@faulty("GK404")
class TwiceAtTimes(Traders):
    """Each bid has its fee, and the rewards of each third round are accumulated twice.

    A bonus round is booked again.
    """

    def step(self, action: Any) -> None:
        """Takes the fee, and books the third round again."""
        agent, rounds = self.agent_selection, self.round
        super().step(action)
        if action is None:
            return
        self.rewards[agent] -= 0.25
        self._cumulative_rewards[agent] -= 0.25
        if self.round % 3 == 2 and self.round > rounds:
            self._accumulate_rewards()


@faulty("GK405")
class RewardsStand(Traders):
    """`rewards` isn't cleared: what a round paid is paid again with every bid of the next.

    Only None steps clear the rewards.
    """

    def _clear_rewards(self) -> None:
        """Forgets to."""

    def _was_dead_step(self, action: Any) -> None:
        """Clears them."""
        super()._was_dead_step(action)
        super()._clear_rewards()


# What is owed outlives the reset, so the second episode isn't a fresh one's.
@faulty("GK406", also=("GK604",))
class StillOwed(Traders):
    """A reset leaves what was owed: the next episode begins with rewards of the last one.

    The books of the last episode are carried over.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Keeps what hadn't been told."""
        owed = dict(getattr(self, "_cumulative_rewards", {}))
        super().reset(seed, options)
        self._cumulative_rewards.update(owed)


@faulty("GK407")
class DeadStepPays(Traders):
    """The None step of a dead trader leaves the rewards of the step before as they were.

    Dead steps don't clear the rewards.
    """

    def _was_dead_step(self, action: Any) -> None:
        """Puts the rewards of the others back."""
        stood = dict(self.rewards)
        super()._was_dead_step(action)
        self.rewards.update({agent: stood[agent] for agent in self.agents})


@faulty("GK408", contract=PAID_BY_TERM)
class PaidBeside(Rovers):
    """A part of the reward stands under no term.

    Who shares in a find is paid a bonus that no term names.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Tells what it pays by term."""
        super().__init__(**kwargs)
        self.terms: dict[str, dict[str, float]] = {}

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays a bonus beside the terms."""
        out = super().step(actions)
        found = out[1]
        team = 0.5 * sum(found.values())
        self.terms = {a: {"sample": found[a], "team": team} for a in found}
        for agent in found:
            found[agent] += 1.5 * team
        return out


@faulty("GK409", contract=PAID_BY_TERM)
class NotShared(Rovers):
    """A term that is declared as shared is paid to those alone who found something.

    The team's share goes to the finder.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Tells what it pays by term."""
        super().__init__(**kwargs)
        self.terms: dict[str, dict[str, float]] = {}

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays the team's share to finders."""
        out = super().step(actions)
        found = out[1]
        team = 0.5 * sum(found.values())
        self.terms = {a: {"sample": found[a], "team": team if found[a] else 0.0} for a in found}
        for agent in found:
            found[agent] = sum(self.terms[agent].values())
        return out


@clean(contract=PAID_BY_TERM)
class PaidByTerm(Rovers):
    """A clean environment that declares its reward terms: no check is broken on it.

    A sample pays its finder, and half of it everybody.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Tells what it pays by term."""
        super().__init__(**kwargs)
        self.terms: dict[str, dict[str, float]] = {}

    def step(self, actions: dict[str, Any]) -> Any:
        """Everybody shares in what is found."""
        out = super().step(actions)
        found = out[1]
        team = 0.5 * sum(found.values())
        self.terms = {a: {"sample": found[a], "team": team} for a in found}
        for agent in found:
            found[agent] += team
        return out
