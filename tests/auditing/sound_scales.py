"""Sound environments of unusual scale: sizes and kinds of numbers, of rosters, of names."""

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.auditing.sound_games import Table, Valley

MANY = tuple(f"agent_{i}" for i in range(64))


class Smooth(Table):
    """What is paid is smoothed over turns: half of the reward before stands in the new one."""

    def pay(self, agent: Any, won: float, before: dict[Any, Any]) -> None:
        """Pays the mean of now and before."""
        for each in self.agents:
            self.rewards[each] = 0.5 * before[each] + (self.unit * won if each == agent else 0.0)


class Jackpot(Table):
    """A turn costs a cent, and now and then one of them pays thousands."""

    def pay(self, agent: Any, won: float, before: dict[Any, Any]) -> None:
        """A cent each; who stakes all on a good coin wins."""
        for each in self.agents:
            self.rewards[each] = -0.01
        if won > 1.0:
            self.rewards[agent] += 5_000.0


class Far(Valley):
    """Observes numbers of the size of a light year in metres, and beyond."""

    def view(self, agent: Any) -> Any:
        """Heights from another world."""
        return super().view(agent) * np.array([1e16, 1e300])


class Whole(Valley):
    """Observes whole numbers over all of their range."""

    def seen_space(self) -> spaces.Space[Any]:
        """Every int64."""
        limits = np.iinfo(np.int64)
        return spaces.Box(limits.min, limits.max, (2,), np.int64)

    def view(self, agent: Any) -> Any:
        """Heights in nanometres."""
        return (super().view(agent) * 1e9).astype(np.int64)


class Wide(Valley):
    """Climbs by a number in a box that is as wide as its dtype."""

    def done_space(self) -> spaces.Space[Any]:
        """Nearly all of float32."""
        return spaces.Box(-3e38, 3e38, (1,), np.float32)

    def climbed(self, action: Any) -> float:
        """Its logarithm."""
        return float(np.sign(action[0]) * np.log1p(abs(float(action[0]))))


class Unbounded(Valley):
    """Climbs by a number without any bound, of float64."""

    def done_space(self) -> spaces.Space[Any]:
        """All of float64."""
        return spaces.Box(-np.inf, np.inf, (1,), np.float64)

    def climbed(self, action: Any) -> float:
        """As far as it says."""
        return float(action[0])


class Crowded(Valley):
    """Chooses among more actions than there is memory for a list of them."""

    def done_space(self) -> spaces.Space[Any]:
        """A trillion."""
        return spaces.Discrete(1 << 40, start=-7)

    def climbed(self, action: Any) -> float:
        """The last digit counts."""
        return float(int(action) % 3 - 1)


class CrowdedTable(Table):
    """The same in turns."""

    def done_space(self) -> spaces.Space[Any]:
        """A trillion."""
        return spaces.Discrete(1 << 40)

    def staked(self, action: Any) -> float:
        """The last digit counts."""
        return float(int(action) % 3)


class Offset(Valley):
    """Adds up very large numbers that nearly cancel out, in the order of the actions."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """Everybody is paid what is left of all wagers, and sees the bank."""
        out = super().step(actions)
        bank = 0.0
        for agent in actions:
            place = self.possible_agents.index(agent)
            bank += (1e12 + 0.1 * place) * (-1.0) ** place
        seen = {a: np.array([1e12, bank]) for a in out[0]}
        return seen, dict.fromkeys(out[1], bank), *out[2:]


class Log(Valley):
    """Keeps the returns of every episode: a line of a log for each, with a number for everybody."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.log: list[dict[Any, float]] = []

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Notes how the last episode ended."""
        if self.rng is not None:
            self.log.append({a: 1.5 * height for a, height in self.heights.items()})
        return super().reset(seed, options)


class Scene:
    """One tick's scene, which knows its parts and they it, as scene graphs do."""

    def __init__(self) -> None:
        self.part = [self]
        self.cells = np.zeros(20_000)


class Cyclic(Valley):
    """Builds a scene at each tick that only the garbage collector takes away."""

    def step(self, actions: dict[Any, Any]) -> Any:
        """Nothing of the scene is kept."""
        Scene()
        return super().step(actions)


class Pictures(Valley):
    """Everybody observes a picture of a quarter of a megabyte."""

    def seen_space(self) -> spaces.Space[Any]:
        """Colours."""
        return spaces.Box(0, 255, (300, 300, 3), np.uint8)

    def view(self, agent: Any) -> Any:
        """One shade, by the height."""
        return np.full((300, 300, 3), int(100 + 10 * self.heights[agent]) % 256, np.uint8)


SCALES: dict[str, Any] = {
    "turns_paid_millions": lambda: Table(unit=1e6),
    "turns_paid_some_hundreds": lambda: Table(unit=700.0),
    "turns_paid_billionths": lambda: Table(unit=1e-9),
    "turns_paid_trillions_in_float32": lambda: Table(unit=1e12, kind=np.float32),
    "turns_paid_in_float16": lambda: Table(unit=0.1, kind=np.float16, turns=60),
    "turns_paid_in_int64": lambda: Table(unit=1e9, kind=np.int64),
    "turns_paid_smoothly": lambda: Smooth(unit=1e5),
    "turns_paid_a_jackpot": Jackpot,
    "turns_of_64": lambda: Table(MANY, turns=300),
    "turns_300": lambda: Table(unit=1e3, turns=300),
    "turns_of_numbers": lambda: Table((0, 1, 2)),
    "turns_of_tuples": lambda: Table((("red", 0), ("red", 1), ("blue", 0))),
    "turns_of_nobody": lambda: Table(("nobody_7", "nobody_8")),
    "turns_of_a_trillion_actions": CrowdedTable,
    "ticks_paid_millions": lambda: Valley(unit=1e6),
    "ticks_paid_billionths": lambda: Valley(unit=1e-9),
    "ticks_paid_in_float32": lambda: Valley(kind=np.float32),
    "ticks_paid_in_int32": lambda: Valley(unit=1e6, kind=np.int32),
    "ticks_paid_below_zero": lambda: Valley(kind=lambda height: -abs(height) - 1e3),
    "ticks_of_64": lambda: Valley(MANY),
    "ticks_300": lambda: Valley(ticks=300),
    "ticks_of_numbers": lambda: Valley((0, 1, 2)),
    "ticks_of_tuples": lambda: Valley((("red", 0), ("red", 1), ("blue", 0))),
    "ticks_of_nobody": lambda: Valley(("nobody_7", "nobody_8")),
    "ticks_seen_from_afar": Far,
    "ticks_in_whole_numbers": Whole,
    "ticks_in_a_wide_box": Wide,
    "ticks_without_bounds": Unbounded,
    "ticks_of_a_trillion_actions": Crowded,
    "ticks_that_nearly_cancel_out": lambda: Offset(("a", "b", "c", "d")),
    "ticks_with_a_log": lambda: Log(ids=MANY),
    "ticks_with_cycles": lambda: Cyclic(ticks=300),
    "ticks_of_pictures": Pictures,
}
