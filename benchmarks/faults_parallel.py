"""An orchard with one fault at a time, for comparing testers of Parallel environments.

`make()` is sound; `make(fault="state_draws")` has that one fault, `make(habit="joins_late")` a
habit that is unusual and legal. The docstring of each class says what is wrong and what it breaks.
Nothing here knows of any tester: they are told only by which of these they call broken.
"""

# ruff: noqa: N801 - a class is called as its fault is typed

from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

SIDE: Final = 3
LIMIT: Final = 40
BASKET: Final = 2
MOVES: Final = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))


class Orchard(ParallelEnv):  # type: ignore[misc]  # PettingZoo ships no types
    """Three pickers walk an orchard of 3 by 3; an apple pays 1, a full basket ends its picker."""

    def __init__(self) -> None:
        self.metadata: dict[str, Any] = {"name": "orchard_v0", "render_modes": []}
        self.render_mode = None
        self.possible_agents = ["picker_0", "picker_1", "picker_2"]
        self.agents: list[str] = []
        self._observation = {a: Box(0.0, 1.0, (5,), np.float32) for a in self.possible_agents}
        self._action = {a: Discrete(5) for a in self.possible_agents}
        self.state_space = Box(0.0, 1.0, (11,), np.float32)
        self.rng: Any = None
        self.tick = 0
        self.world = np.zeros(11, np.float32)

    def observation_space(self, agent: str) -> Any:
        """Own place, the apple's, and how full the basket is."""
        return self._observation[agent]

    def action_space(self, agent: str) -> Any:
        """Stay, or one of four ways."""
        return self._action[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        """Draws places for pickers and the apple."""
        self.seeded(seed)
        self.tick = 0
        self.agents = list(self.possible_agents)
        self.xy = {a: self.place() for a in self.possible_agents}
        self.carried = dict.fromkeys(self.possible_agents, 0)
        self.apple = self.place()
        self.world[:] = self.packed()
        return {a: self.see(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Moves all pickers; of several at the apple the first in the roster has it."""
        here = list(self.agents)
        for agent in here:
            move = MOVES[int(actions[agent])]
            self.xy[agent] = tuple(
                min(max(x + d, 0), SIDE - 1) for x, d in zip(self.xy[agent], move, strict=True)
            )
        self.tick += 1
        rewards = dict.fromkeys(here, 0.0)
        for agent in self.at_the_apple(here, actions)[:1]:
            rewards[agent] = 1.0
            self.carried[agent] += 1
            self.apple = self.place()
        terminated = {a: self.carried[a] >= BASKET for a in here}
        truncated = dict.fromkeys(here, self.tick >= LIMIT)
        self.world[:] = self.packed()
        seen = {a: self.see(a) for a in here}
        self.agents = [a for a in here if not (terminated[a] or truncated[a])]
        return seen, rewards, terminated, truncated, {a: {} for a in here}

    def seeded(self, seed: int | None) -> None:
        """Begins a stream where a seed is given, or none was begun."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)

    def place(self) -> Any:
        """A cell, drawn."""
        return tuple(int(x) for x in self.rng.integers(SIDE, size=2))

    def at_the_apple(self, here: list[str], actions: dict[str, Any]) -> list[str]:
        """Pickers who stand where it lies, the one who has it first."""
        return [a for a in here if self.xy[a] == self.apple]

    def see(self, agent: str) -> Any:
        """The observation, [5]."""
        cells = (*self.xy[agent], *self.apple)
        whole = [*(x / (SIDE - 1) for x in cells), self.carried[agent] / BASKET]
        return np.array(whole, np.float32)

    def packed(self) -> Any:
        """Everything, [11]."""
        cells = [x for a in self.possible_agents for x in self.xy[a]] + list(self.apple)
        loads = [self.carried[a] / BASKET for a in self.possible_agents]
        return np.array([*(x / (SIDE - 1) for x in cells), *loads], np.float32)

    def state(self) -> Any:
        """Everything, an array of its own."""
        return self.world.copy()

    def render(self) -> None:
        """Nothing to see."""

    def close(self) -> None:
        """Nothing to close."""


class outside_the_box(Orchard):
    """Places aren't scaled: observations leave their space."""

    def see(self, agent: str) -> Any:
        """Cells as they are counted."""
        return super().see(agent) * np.float32(SIDE - 1)


class float64_shown(Orchard):
    """float64 where the space says float32."""

    def see(self, agent: str) -> Any:
        """In the wrong dtype."""
        return super().see(agent).astype(np.float64)


class nan_reward(Orchard):
    """A picker whose basket is full is paid NaN."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Pays nothing divided by nothing."""
        seen, rewards, terminated, truncated, infos = super().step(actions)
        rewards = {a: float("nan") if terminated[a] else r for a, r in rewards.items()}
        return seen, rewards, terminated, truncated, infos


class silent_leave(Orchard):
    """A full picker leaves `agents` with neither flag up."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Forgets to say why."""
        seen, rewards, terminated, truncated, infos = super().step(actions)
        return seen, rewards, dict.fromkeys(terminated, False), truncated, infos


class ended_stay(Orchard):
    """Who ended stays in `agents`."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Takes nobody out before the last has ended."""
        before = list(self.agents)
        given = super().step(actions)
        self.agents = before if self.agents else []
        return given


class last_reward_missing(Orchard):
    """Who ends has no reward in its last step."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Pays the living only."""
        seen, rewards, terminated, truncated, infos = super().step(actions)
        return seen, {a: rewards[a] for a in self.agents}, terminated, truncated, infos


class global_generator(Orchard):
    """Later apples come from NumPy's global generator, which no reset seeds."""

    def place(self) -> Any:
        """Draws from the wrong one, once the game has begun."""
        return tuple(np.random.randint(SIDE, size=2).tolist()) if self.tick else super().place()


class first_seed_only(Orchard):
    """Only the first seed counts."""

    def seeded(self, seed: int | None) -> None:
        """Begins once."""
        if self.rng is None:
            self.rng = np.random.default_rng(seed)


class seed_zero(Orchard):
    """Seed 0 is taken for none."""

    def seeded(self, seed: int | None) -> None:
        """Asks whether it is true, where it should ask whether it is there."""
        super().seeded(seed or None)


class kept_over_reset(Orchard):
    """A seeded reset doesn't put the apple back: the episode hangs on the one before it."""

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        """Leaves the apple where it lay."""
        lay = getattr(self, "apple", None)
        super().reset(seed=seed, options=options)
        self.apple = lay or self.apple
        self.world[:] = self.packed()
        return {a: self.see(a) for a in self.agents}, {a: {} for a in self.agents}


class one_buffer(Orchard):
    """Each picker's observation is one array for all time: those kept by a buffer change."""

    def see(self, agent: str) -> Any:
        """Writes into it."""
        shown = self.__dict__.setdefault("shown", {})
        array = shown.setdefault(agent, np.zeros(5, np.float32))
        array[:] = super().see(agent)
        return array


class state_is_the_game(Orchard):
    """`state()` hands out the game's own array: states that were kept change."""

    def state(self) -> Any:
        """No copy."""
        return self.world


class state_draws(Orchard):
    """`state()` draws from the game's generator: who asks changes the future."""

    def state(self) -> Any:
        """Draws."""
        self.rng.random()
        return super().state()


class actions_taken_out(Orchard):
    """`step` empties the caller's dictionary of actions."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Pops them."""
        return super().step({a: actions.pop(a) for a in list(self.agents)})


class order_of_the_dictionary(Orchard):
    """Of several at the apple, whoever stands first in the caller's dictionary has it."""

    def at_the_apple(self, here: list[str], actions: dict[str, Any]) -> list[str]:
        """In the caller's order."""
        return [a for a in actions if a in here and self.xy[a] == self.apple]


class limit_terminates(Orchard):
    """The limit of 40 ticks is told as a termination: learners don't bootstrap."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Raises the other flag."""
        seen, rewards, terminated, truncated, infos = super().step(actions)
        both = {a: terminated[a] or truncated[a] for a in terminated}
        return seen, rewards, both, dict.fromkeys(both, False), infos


class copy_shares_the_dice(Orchard):
    """A deepcopy draws from the same generator: a search in the copy changes the game."""

    def __deepcopy__(self, memo: Any) -> Any:
        """Copies all else."""
        import copy

        copied = type(self)()
        memo[id(self)] = copied
        kept = {name: value for name, value in vars(self).items() if name != "rng"}
        vars(copied).update(copy.deepcopy(kept, memo))
        copied.rng = self.rng
        return copied


class joins_late(Orchard):
    """A habit: the third picker joins at the third tick."""

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        """Begins with two."""
        super().reset(seed=seed, options=options)
        self.agents = self.possible_agents[:2]
        return {a: self.see(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Lets it in."""
        seen, rewards, terminated, truncated, infos = super().step(actions)
        late = self.possible_agents[2]
        if self.tick == 3:
            self.agents = [*self.agents, late]
            seen[late], rewards[late], infos[late] = self.see(late), 0.0, {}
            terminated[late] = truncated[late] = False
        return seen, rewards, terminated, truncated, infos


class draws_nothing(Orchard):
    """A habit: no chance at all, so no seed has an effect."""

    def place(self) -> Any:
        """Counts on."""
        self.count = getattr(self, "count", 0) + 7 if self.tick else 7
        return divmod(self.count % (SIDE * SIDE), SIDE)


class both_flags(Orchard):
    """A habit: who fills its basket in the last tick has both flags up, and infos vary."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Tells more where there is more to tell."""
        seen, rewards, terminated, truncated, infos = super().step(actions)
        infos = {a: {"apples": self.carried[a]} if self.carried[a] else {} for a in infos}
        return seen, {a: np.float32(r) for a, r in rewards.items()}, terminated, truncated, infos


HABITS: Final = ("joins_late", "draws_nothing", "both_flags")
KNOWN: Final = {kind.__name__: kind for kind in Orchard.__subclasses__()}
FAULTS: Final = tuple(name for name in KNOWN if name not in HABITS)


def make(fault: str = "", habit: str = "") -> Orchard:
    """The orchard, with one fault or one habit."""
    name = fault or habit
    return KNOWN[name]() if name else Orchard()
