"""Action masks, and infos."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import clean, faulty
from tests.faults.rovers import Rovers
from tests.faults.tokens import CELLS, Tokens

MASKS = {
    "roles": {
        "player": {"agents": "player_*", "mask": "observation.action_mask", "illegal": "error"}
    }
}
INFOS = {"infos": {"battery": {"dtype": "int64", "shape": []}}}


@faulty("GK230")
class ShortMask(Tokens):
    """The mask leaves out the last action.

    The last cell was forgotten.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        for space in self._seen.values():
            space.spaces["action_mask"] = spaces.Box(0, 1, (CELLS - 1,), np.int8)

    def observe(self, agent: str) -> dict[str, Any]:
        """Without the last cell."""
        seen = super().observe(agent)
        return {**seen, "action_mask": seen["action_mask"][:-1]}


@faulty("GK230")
class LongMask(Tokens):
    """The mask has one number more than there are actions, and than its space says.

    A place for passing, which isn't an action.
    """

    def observe(self, agent: str) -> dict[str, Any]:
        """With a place at the end."""
        seen = super().observe(agent)
        return {**seen, "action_mask": np.append(seen["action_mask"], np.int8(0))}


@faulty("GK231")
class BoolMask(Tokens):
    """Masks are bool, which no sample takes.

    Comparisons that were never converted.
    """

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask as bool."""
        seen = super().observe(agent)
        return {**seen, "action_mask": seen["action_mask"].astype(bool)}


@faulty("GK233")
class NothingAllowed(Tokens):
    """A player who is left with two cells is allowed none of them.

    Two cells are thought to be of no use, and whatever is done then is taken for the first.
    """

    def observe(self, agent: str) -> dict[str, Any]:
        """Nothing is allowed where two cells are left."""
        seen = super().observe(agent)
        if self.legal().sum() <= 2:
            seen["action_mask"] = np.zeros(CELLS, np.int8)
        return seen

    def step(self, action: Any) -> None:
        """Takes any action where the mask allowed none."""
        if action is not None and 0 < self.legal().sum() <= 2:
            action = int(np.argmax(self.legal()))
        super().step(action)


@faulty("GK234")
class TwoMasks(Tokens):
    """The mask in the info allows everything, the one in the observation does not.

    Half of the readers take the wrong one.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Infos with a mask of their own."""
        super().reset(seed, options)
        for agent in self.agents:
            self.infos[agent] = {"action_mask": np.ones(CELLS, np.int8)}


@faulty("GK235")
class StaleMask(Tokens):
    """The mask is from before the other player moved.

    Made when the last own turn was over.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Both begin with the first mask."""
        super().reset(seed, options)
        self.kept = dict.fromkeys(self.agents, self.legal())

    def step(self, action: Any) -> None:
        """Keeps the mask for the own next turn."""
        agent = self.agent_selection
        super().step(action)
        self.kept[agent] = self.legal()

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask that was kept."""
        seen = super().observe(agent)
        return {**seen, "action_mask": seen["action_mask"] | self.kept[agent]}


@faulty("GK238", budget=3_000)
class StaleMaskTaken(Tokens):
    """The mask is from before the other player moved, and a forbidden cell is a pass.

    Neither raises, so nothing says that it is wrong.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Both begin with the first mask."""
        super().reset(seed, options)
        self.kept = dict.fromkeys(self.agents, self.legal())

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask that was kept."""
        return {**super().observe(agent), "action_mask": self.kept[agent].copy()}

    def step(self, action: Any) -> None:
        """Passes where the cell is taken, and keeps the mask for the own next turn."""
        agent = self.agent_selection
        if not self.terminations[agent] and not self.legal()[action]:
            self._cumulative_rewards[agent] = 0.0
            self._clear_rewards()
            self.agent_selection = next(a for a in self.possible_agents if a != agent)
        else:
            super().step(action)
        self.kept[agent] = self.legal()


@faulty(
    "GK236", contract={"roles": {"player": {"agents": "player_*", "mask": "infos.action_mask"}}}
)
class MaskElsewhere(Tokens):
    """The contract declares the mask in the infos, and it stands in the observation.

    Declared at the wrong place; any free cell is then taken for any other.
    """

    def step(self, action: Any) -> None:
        """Takes the next free cell, as policies see no mask."""
        legal = self.legal()
        if action is not None and legal.any():
            action = next(int(c % len(legal)) for c in range(action, 99) if legal[c % len(legal)])
        super().step(action)


@faulty("GK237", contract=MASKS)
class QuietlyTaken(Tokens):
    """A forbidden move is declared an error, and is quietly taken.

    Whoever plays a taken cell gets the first free one.
    """

    def step(self, action: Any) -> None:
        """Fixes what is forbidden."""
        legal = self.legal()
        if action is not None and 0 <= action < len(legal) and not legal[action]:
            action = int(np.argmax(legal))
        super().step(action)


@faulty("GK240")
class NoInfo(Rovers):
    """The info of a rover that just ended is None.

    Nothing is said at the end.
    """

    def info(self, agent: str) -> Any:
        """None without a battery."""
        return super().info(agent) if self.battery[agent] > 0 else None


@faulty("GK242")
class FunctionInInfo(Rovers):
    """Infos hold a function.

    No process can send such an info to another.
    """

    def info(self, agent: str) -> dict[str, Any]:
        """A way to ask later."""
        return {**super().info(agent), "ask": lambda: self.battery[agent]}


@faulty("GK243", contract=INFOS)
class OtherInfo(Rovers):
    """The battery in the infos is declared as a whole number, and is a float.

    Told as a part of a full battery.
    """

    def info(self, agent: str) -> dict[str, Any]:
        """Between 0 and 1."""
        return {"battery": self.battery[agent] / 30}


@clean(contract=INFOS)
class DeclaredInfos(Rovers):
    """A clean environment with its infos declared: no check is broken on it."""


@clean(contract=MASKS)
class DeclaredTokens(Tokens):
    """A clean environment with its masks declared: no check is broken on it."""


@clean()
class ToldTwice(Tokens):
    """A clean environment that says things in two places, and the same: no check is broken on it.

    Masks stand in infos too, spaces in dictionaries.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.observation_spaces, self.action_spaces = self._seen, self._done

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Begins with infos."""
        super().reset(seed, options)
        self.tell()

    def step(self, action: Any) -> None:
        """Goes on with infos."""
        super().step(action)
        self.tell()

    def tell(self) -> None:
        """The mask of each, as it is observed."""
        for agent in self.agents:
            self.infos[agent] = {"action_mask": self.observe(agent)["action_mask"]}
