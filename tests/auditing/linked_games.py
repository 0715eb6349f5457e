"""Environments with one fault that several checks see, and one with two that look alike."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


class Overfull(Rovers):
    """A battery is charged beyond what is declared: agents see it, state() and frames show it."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Half full."""
        self.charge = dict.fromkeys(self.possible_agents, 0.5)
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """Charges on the way."""
        super().drive(agent, action)
        self.charge[agent] += 0.3 * (action == 1)

    def observation(self, agent: str) -> Any:
        """With the own charge."""
        seen = super().observation(agent)
        seen[-1] = self.charge[agent]
        return seen

    def state(self) -> Any:
        """With the charge of the first one."""
        value = super().state()
        value[0] = self.charge[self.possible_agents[0]]
        return value

    def render(self) -> Any:
        """Raises where a charge is no shade."""
        frame = super().render()
        if frame is not None:
            frame[0, 0] = int(200 * max(self.charge.values()))
        return frame


class OverfullAndLate(Overfull):
    """Beside it, state() has a clock beyond its bound, and no frame shows a late tick."""

    def state(self) -> Any:
        """With the time, which is declared to be less."""
        value = super().state()
        value[0] = self.time / 10
        return value

    def render(self) -> Any:
        """Raises after ten ticks."""
        frame = Rovers.render(self)
        if frame is not None:
            frame[0, 0] = 26 * self.time
        return frame


class Unpaid(Tokens):
    """The entry of the loser in `rewards` is gone before its last turn, whose step reads it."""

    def step(self, action: Any) -> None:
        """Deletes it."""
        other = next(each for each in self.possible_agents if each != self.agent_selection)
        was_over = any(self.terminations.values())
        super().step(action)
        if not was_over and any(self.terminations.values()):
            del self.rewards[other]


def unpaid() -> Any:
    """In a wrapper, through which the books are read."""
    return OrderEnforcingWrapper(Unpaid())


class ByAddress(Tokens):
    """The first player is chosen by where an object lies in memory."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Of two."""
        super().reset(seed, options)
        self.agent_selection = self.possible_agents[id(object()) // 16 % 2]


class ByMemo(Rovers):
    """Addresses are keys of a memo, and of a copy's."""

    def observation(self, agent: str) -> Any:
        """Looked up."""
        self.seen = {id(each): super(ByMemo, self).observation(each) for each in self.agents}
        return self.seen.get(id(agent), super().observation(agent))

    def __deepcopy__(self, memo: Any) -> Any:
        """Of itself, once."""
        other = type(self)(self.count, self.horizon, self.render_mode)
        memo[id(self)] = other
        vars(other).update(copy.deepcopy(vars(self), memo))
        return other


class DrawsOfSpaces(Rovers):
    """Wind is drawn from an action space, which a copy has anew."""

    def drive(self, agent: str, action: int) -> None:
        """The wind moves a rover."""
        super().drive(agent, int(self.action_space(agent).sample()))

    def __deepcopy__(self, memo: Any) -> Any:
        """All but the spaces, which are no state."""
        other = type(self)(self.count, self.horizon, self.render_mode)
        memo[id(self)] = other
        for name, value in vars(self).items():
            if name not in ("_seen", "_done"):
                setattr(other, name, copy.deepcopy(value, memo))
        return other


class Outlasting(Traders):
    """Rewards stand, also those of a bankrupt trader, who waits for the end of the game."""

    def _clear_rewards(self) -> None:
        """Forgets to."""

    def _deads_step_first(self) -> Any:
        """Lets them wait."""
        return self.agent_selection


class LiveAgain(Tokens):
    """Who is left once the other has gone is taken for live, and may do nothing."""

    def legal(self) -> Any:
        """Nothing for one alone."""
        return super().legal() * (len(self.agents) > 1)

    def step(self, action: Any) -> None:
        """Takes the flag back."""
        super().step(action)
        if len(self.agents) == 1:
            self.terminations[self.agents[0]] = False


class SetsNoRewards(Tokens):
    """A reset leaves `rewards` to the first step: missing at first, later those of the last."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Everything else is as it was at first."""
        known = vars(self).get("rewards")
        super().reset(seed, options)
        del self.rewards
        if known is not None:
            self.rewards = known

    def _clear_rewards(self) -> None:
        """New ones in each step."""
        self.rewards = dict.fromkeys(self.agents, 0.0)

    def observe(self, agent: str) -> dict[str, Any]:
        """Tells in which games it is known what was paid last."""
        seen = super().observe(agent)
        seen["observation"][self.blocked] = 2 * hasattr(self, "rewards")
        return seen


class SetsNoRewardsInTurn(SetsNoRewards):
    """Beside it, who begins the next game is who didn't begin the last one."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Whatever the seed."""
        super().reset(seed, options)
        self.games = getattr(self, "games", 0) + 1
        self.agent_selection = self.possible_agents[self.games % 2]


class FilledOnce(Rovers):
    """The constructor fills `agents`, and a reset takes who is left of them."""

    def __init__(self, count: int = 3, horizon: int = 20, render_mode: str | None = None) -> None:
        super().__init__(count, horizon, render_mode)
        self.agents = list(self.possible_agents)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Of nobody once all have ended."""
        left = list(self.agents)
        out = super().reset(seed, options)
        self.agents = left
        return tuple({agent: part[agent] for agent in left} for part in out)


class LiveAgainByChance(LiveAgain):
    """The same in a game that no seed settles."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Reads none."""
        super().reset(None, options)


class NeedsSeed(Rovers):
    """A reset counts on from its seed."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Raises where there is none."""
        return super().reset(seed + 1, options)  # type: ignore[operator]  # which is the fault


class NeverTruncates(Rovers):
    """Truncations are left empty, and rovers leave at the horizon."""

    def step(self, actions: dict[str, Any]) -> Any:
        """All else is told."""
        observations, rewards, terminations, _, infos = super().step(actions)
        return observations, rewards, terminations, {}, infos


class BidsOfTheDead(Traders):
    """A trader that has ended bids like any other: a number is taken, and None raises."""

    def _was_dead_step(self, action: Any) -> None:
        """Notes the bid of one that is out."""
        self.bids = int(action)
        super()._was_dead_step(None)


class OneRoster(Rovers):
    """The list of agents is that of the possible ones, and who has ended is taken out of both."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Raises where all have ended before."""
        out = super().reset(seed, options)
        self.agents = self.possible_agents
        self.first = self.agents[0]
        return out

    def step(self, actions: dict[str, Any]) -> Any:
        """Takes the ended out of the one list."""
        out = super().step(actions)
        self.possible_agents[:] = self.agents
        self.agents = self.possible_agents
        return out


class SetsNoRewardsAndDraws(SetsNoRewards):
    """Beside it, a game is drawn from numpy's global generator."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Reads no seed."""
        super().reset(int(np.random.randint(1_000)), options)  # which is the fault
