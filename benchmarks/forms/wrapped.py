"""Games whose API is PettingZoo's conversion of the other one."""

from __future__ import annotations

from typing import Any, ClassVar

from gymnasium.spaces import Discrete
from pettingzoo.utils.conversions import aec_to_parallel, parallel_to_aec

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Seesaw(Ticks):
    """Four children lean left, stay or lean right at once; three steps off balance end the game.

    All are paid 1 for each tick at which the board is level after the moves.
    """

    def __init__(self) -> None:
        super().__init__(names("child", 4), box(1, -9, 9), Discrete(3), 17)

    def _start(self, rng: Any) -> None:
        self.tilt = int(rng.integers(-1, 2))

    def _tick(self, actions: Any) -> None:
        lean = sum(int(action) - 1 for action in actions.values())
        self.tilt += (lean > 0) - (lean < 0)
        for agent in self.agents:
            self._pay(agent, self.tilt == 0)
        if abs(self.tilt) >= 4:
            self._end(*self.agents)

    def _look(self, agent: str) -> Any:
        return vector(self.tilt)


def seesaw_in_turns() -> Any:
    """The seesaw as AEC: the wrapper gathers the moves of a tick and plays them at its end."""
    return parallel_to_aec(Seesaw())


SEESAW = Form(
    name="seesaw_in_turns",
    api="aec",
    stages=(("child",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"level": Part("child", "all", "shared")},
    endings={"tipped": Ending("termination", "all"), "time": TIME},
    symmetric={"child": True},
    horizon=17,
    influence=links("child child reward 0", "child child observation 1", "child child ending 0"),
    order_sensitive=None,
    advice="parallel",
)


class Well(Turns):
    """Three villagers draw 0 to 2 buckets in the order of their names; the well fills at night.

    Each is paid what it gets; the water level is measured at night and seen the next day.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "well_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self) -> None:
        super().__init__(names("villager", 3), box(1, 0, 12), Discrete(3), 19)

    def _start(self, rng: Any) -> None:
        self.water = self.measured = int(rng.integers(1, 5))

    def _act(self, agent: str, action: Any) -> None:
        got = min(int(action), self.water)
        self.water -= got
        self._pay(agent, got)

    def _close(self) -> None:
        self.water = self.measured = min(6, self.water + int(self.rng.integers(1, 4)))

    def _look(self, agent: str) -> Any:
        return vector(self.measured)


def well_at_once() -> Any:
    """The well as Parallel: PettingZoo's wrapper plays one turn after the other, by the roster."""
    return aec_to_parallel(Well())


WELL = Form(
    name="well_at_once",
    api="parallel",
    stages=(("villager",),),
    order="none",
    observe="after tick",
    conflicts="priority",
    priority="roster",
    rewards={"water": Part("villager", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"villager": False},
    horizon=19,
    influence=links("villager villager reward 0", "villager villager observation 1"),
    order_sensitive="none",
    advice="aec",
    because=("reward",),
    doubtful=("order", "advice", "order_sensitive"),
)

FORMS = ((seesaw_in_turns, SEESAW), (well_at_once, WELL))
