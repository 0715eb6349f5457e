"""An auction with one fault at a time, for comparing testers of AEC environments.

`make()` is sound; `make(fault="never_cleared")` has that one fault, `make(habit="random_order")` a
habit that is unusual and legal. The docstring of each class says what is wrong and what it breaks.
Nothing here knows of any tester: they are told only by which of these they call broken.
"""

# ruff: noqa: N801 - a class is called as its fault is typed

from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from pettingzoo import AECEnv

SEATS: Final = ("bidder_0", "bidder_1", "bidder_2")
MONEY: Final = 4
LIMIT: Final = 30


class Auction(AECEnv):  # type: ignore[misc]  # PettingZoo ships no types
    """Three bidders in turn pass, bid 1 or bid 2 for a prize of drawn worth; the broke are out."""

    def __init__(self) -> None:
        super().__init__()
        self.metadata: dict[str, Any] = {"name": "auction_v0", "render_modes": []}
        self.render_mode = None
        self.possible_agents = list(SEATS)
        self.agents: list[str] = []
        view = Box(0.0, 1.0, (5,), np.float32)
        self._observation = {
            a: Dict({"observation": view, "action_mask": Box(0, 1, (3,), np.int8)})
            for a in self.possible_agents
        }
        self._action = {a: Discrete(3) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> Any:
        """Everybody's money, the prize, the clock; and what may be bid."""
        return self._observation[agent]

    def action_space(self, agent: str) -> Any:
        """What is bid."""
        return self._action[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Gives everybody the same money and draws a prize."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {a: {} for a in self.agents}
        self.money = dict.fromkeys(SEATS, MONEY)
        self.board = np.zeros(5, np.float32)
        self.turns = 0
        self.prize = int(self.rng.integers(1, 4))
        self.draw_board()
        self.agent_selection = self.first()

    def step(self, action: Any) -> None:
        """One bid; it buys the prize, and the next one is drawn."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self.dead_step(action)
            return
        bid = int(action)
        if bid > self.money[agent]:
            raise ValueError(f"{agent} has {self.money[agent]} and bids {bid}")
        self._cumulative_rewards[agent] = 0.0
        self.clear()
        self.turns += 1
        if bid:
            self.money[agent] -= bid
            self.rewards[agent] = float(self.prize - bid)
            self.prize = int(self.rng.integers(1, 4))
        self.end()
        self.draw_board()
        self.agent_selection = self.after(agent)
        self.gather()
        self._deads_step_first()

    def dead_step(self, action: Any) -> None:
        """The last turn of one who has ended."""
        self._was_dead_step(action)

    def clear(self) -> None:
        """Nobody is paid yet."""
        self._clear_rewards()

    def gather(self) -> None:
        """Adds what this turn paid to what each will be told."""
        self._accumulate_rewards()

    def end(self) -> None:
        """Who is broke has ended; after 30 turns everybody has."""
        for agent in self.agents:
            self.terminations[agent] = self.money[agent] <= 0
            self.truncations[agent] = self.turns >= LIMIT

    def first(self) -> str:
        """Who begins."""
        return self.agents[0]

    def after(self, agent: str) -> str:
        """Who is next."""
        return self.agents[(self.agents.index(agent) + 1) % len(self.agents)]

    def living(self) -> list[str]:
        """Who hasn't ended."""
        return [a for a in self.agents if not (self.terminations[a] or self.truncations[a])]

    def draw_board(self) -> None:
        """Writes down what everybody sees."""
        money = [self.money[a] / MONEY for a in SEATS]
        self.board[:] = [*money, self.prize / 3, self.turns / LIMIT]

    def mask(self, agent: str) -> Any:
        """What it can pay for, [3]."""
        is_on = agent in self.living()
        return np.array([is_on and bid <= self.money[agent] for bid in range(3)], np.int8)

    def observe(self, agent: str) -> Any:
        """The board, an array of its own."""
        return {"observation": self.board.copy(), "action_mask": self.mask(agent)}

    def render(self) -> None:
        """Nothing to see."""

    def close(self) -> None:
        """Nothing to close."""


class never_cleared(Auction):
    """What the acting agent was told is never cleared: `last()` gives the return so far."""

    def step(self, action: Any) -> None:
        """Puts it back."""
        agent = self.agent_selection
        owed = self._cumulative_rewards.get(agent, 0.0)
        was_dead = self.terminations[agent] or self.truncations[agent]
        super().step(action)
        if not was_dead:
            self._cumulative_rewards[agent] += owed


class never_gathered(Auction):
    """Rewards are set and never accumulated: `last()` always gives 0."""

    def gather(self) -> None:
        """Forgets to."""


class rewards_stand(Auction):
    """Rewards stand until they are overwritten, so each is paid again at every turn."""

    def clear(self) -> None:
        """Forgets to."""


class last_turn_skipped(Auction):
    """The broke are taken out at once: nobody can read their last reward and their end."""

    def end(self) -> None:
        """Takes them out, all but the last."""
        super().end()
        for agent in [a for a in self.agents if self.terminations[a]][: len(self.agents) - 1]:
            if agent != self.agent_selection:
                continue
            self.agent_selection = self.after(agent)
            self.agents.remove(agent)
            for books in (
                self.rewards,
                self._cumulative_rewards,
                self.terminations,
                self.truncations,
                self.infos,
            ):
                del books[agent]

    def after(self, agent: str) -> str:
        """Who is next, where the last one is gone."""
        return super().after(agent) if agent in self.agents else self.agent_selection


class dead_may_bid(Auction):
    """One who has ended may bid: nothing says that only None is left to it."""

    def dead_step(self, action: Any) -> None:
        """Takes anything."""
        self._was_dead_step(None)


class selects_removed(Auction):
    """After the last step of one who ended, `agent_selection` names it still."""

    def dead_step(self, action: Any) -> None:
        """Leaves the name there."""
        agent = self.agent_selection
        self._was_dead_step(action)
        self.agent_selection = agent


class mask_of_the_other(Auction):
    """The mask is that of the bidder before: it allows what is refused."""

    def observe(self, agent: str) -> Any:
        """Looks one seat too far left."""
        other = SEATS[SEATS.index(agent) - 1]
        return {"observation": self.board.copy(), "action_mask": self.mask(other)}


class mask_of_bool(Auction):
    """The mask is of bool, where the space says int8."""

    def mask(self, agent: str) -> Any:
        """In the wrong dtype."""
        return super().mask(agent).astype(np.bool_)


class board_is_shown(Auction):
    """Observations are the game's own array: those of earlier turns change."""

    def observe(self, agent: str) -> Any:
        """No copy."""
        return {"observation": self.board, "action_mask": self.mask(agent)}


class observe_draws(Auction):
    """`observe()` draws from the game's generator: who looks twice changes the future."""

    def observe(self, agent: str) -> Any:
        """Draws."""
        self.rng.random()
        return super().observe(agent)


class order_of_a_set(Auction):
    """Who begins hangs on Python's hash seed: every process plays another game."""

    def first(self) -> str:
        """Whoever a set gives."""
        return next(iter(set(self.agents)))


class roster_is_one_list(Auction):
    """`agents` is `possible_agents` itself: who ends is gone for good."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """No copy."""
        super().reset(seed=seed, options=options)
        self.agents = self.possible_agents


class infos_of_none(Auction):
    """The info of one who has ended is None."""

    def end(self) -> None:
        """Leaves nothing there."""
        super().end()
        for agent in self.agents:
            self.infos[agent] = None if self.terminations[agent] else {}


class constant_generator(Auction):
    """Each reset begins the same stream, whatever the seed."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Takes its own."""
        super().reset(seed=7, options=options)


class paid_after_end(Auction):
    """Dead steps of others pay who is still there once more."""

    def dead_step(self, action: Any) -> None:
        """Pays."""
        super().dead_step(action)
        for agent in self.agents:
            self._cumulative_rewards[agent] += 1.0


class rotates_and_says_parallel(Auction):
    """Says that it can be played in parallel, and rotates who begins: conversion can't step it."""

    def __init__(self) -> None:
        super().__init__()
        self.metadata["is_parallelizable"] = True

    def after(self, agent: str) -> str:
        """After a round, whoever is a seat further."""
        n = len(self.agents)
        step = 2 if self.turns % n == 0 and n > 2 else 1
        return self.agents[(self.agents.index(agent) + step) % n]


class money_kept_over_reset(Auction):
    """A reset in the middle of an episode leaves one bidder's money as it was."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Remembers."""
        money = getattr(self, "money", {})
        super().reset(seed=seed, options=options)
        self.money["bidder_0"] = max(money.get("bidder_0", MONEY), 1)
        self.draw_board()


class random_order(Auction):
    """A habit: who is next is drawn, so some are asked twice in a row."""

    def after(self, agent: str) -> str:
        """Anybody who is still in."""
        there = self.living() or self.agents
        return there[int(self.rng.integers(len(there)))]


class asks_again(Auction):
    """A habit: who bids has another turn."""

    def after(self, agent: str) -> str:
        """The same, where it was paid and has money left."""
        return agent if self.rewards[agent] and agent in self.living() else super().after(agent)


class ends_at_once(Auction):
    """A habit: where one is broke, all end, some with both flags up."""

    def end(self) -> None:
        """Ends all."""
        super().end()
        is_over = any(self.terminations.values())
        self.terminations = dict.fromkeys(self.agents, is_over)


HABITS: Final = ("random_order", "asks_again", "ends_at_once")
KNOWN: Final = {kind.__name__: kind for kind in Auction.__subclasses__()}
FAULTS: Final = tuple(name for name in KNOWN if name not in HABITS)


def make(fault: str = "", habit: str = "") -> Auction:
    """The auction, with one fault or one habit."""
    name = fault or habit
    return KNOWN[name]() if name else Auction()
