"""Box actions: a formation, a power grid, a platoon, and a wind that no seed determines."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


def force(size: int = 1, most: float = 1.0) -> Box:
    """A space of forces."""
    return Box(-most, most, (size,), np.float32)


def pushed(action: Any, most: float = 1.0) -> Any:
    """The force inside its bounds."""
    return np.clip(np.asarray(action, dtype=np.float64), -most, most)


class Lanterns(Ticks):
    """Three moths fly in a plane to three lanterns; all pay each lantern's distance to its nearest.

    Moths that are closer than 0.3 jostle: each of the two pays 1 for it.
    """

    def __init__(self) -> None:
        super().__init__(names("moth", 3), box(12), force(2, 0.3), 25)

    def _start(self, rng: Any) -> None:
        self.at = {agent: rng.uniform(-1, 1, 2) for agent in self.possible_agents}
        self.lanterns = rng.uniform(-1, 1, (3, 2))

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            self.at[agent] = np.clip(self.at[agent] + pushed(actions[agent], 0.3), -3, 3)
        places = np.stack([self.at[agent] for agent in self.agents])
        gaps = np.linalg.norm(self.lanterns[:, None] - places[None], axis=-1).min(axis=1)
        for agent, place in zip(self.agents, places, strict=True):
            close = (np.linalg.norm(places - place, axis=-1) < 0.3).sum() - 1
            self._pay(agent, -gaps.sum() - close)

    def _look(self, agent: str) -> Any:
        others = [self.at[other] for other in self.possible_agents if other != agent]
        return np.concatenate([self.at[agent], *others, *self.lanterns]).astype(np.float32)


LANTERNS = Form(
    name="lanterns",
    api="parallel",
    stages=(("moth",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "light": Part("moth", "all", "shared"),
        "jostle": Part("moth", "earner", "individual"),
    },
    endings={"time": TIME},
    symmetric={"moth": True},
    horizon=25,
    influence=links("moth moth reward 0", "moth moth observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Mains(Ticks):
    """Two plants feed a grid that three consumers load; all see the frequency, plants pay for fuel.

    Feed and load are between 0 and 1. A frequency over 1 from 0 costs all 1; further than 4,
    the grid goes dark: -10 for all, the end.
    """

    def __init__(self) -> None:
        agents = [*names("plant", 2), *names("consumer", 3)]
        super().__init__(agents, box(1), Box(0, 1, (1,), np.float32), 24)

    def _start(self, rng: Any) -> None:
        self.frequency = float(rng.normal() * 0.3)

    def _tick(self, actions: Any) -> None:
        amount = {a: float(np.clip(actions[a][0], 0, 1)) for a in self.agents}
        fed = sum(amount[a] for a in self.agents if a.startswith("plant"))
        used = sum(amount[a] for a in self.agents if a.startswith("consumer"))
        self.frequency += 1.5 * fed - used + self.rng.normal() * 0.05
        dark = abs(self.frequency) > 4
        for agent in self.agents:
            self._pay(agent, amount[agent] if agent.startswith("consumer") else -amount[agent] / 2)
            self._pay(agent, -10.0 if dark else -1.0 * (abs(self.frequency) > 1))
        if dark:
            self._end(*self.agents)

    def _look(self, agent: str) -> Any:
        return vector(self.frequency)


PAIRS = [(a, b) for a in ("plant", "consumer") for b in ("plant", "consumer")]
MAINS = Form(
    name="mains",
    api="parallel",
    stages=(("plant", "consumer"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "use": Part("consumer", "earner", "individual"),
        "fuel": Part("plant", "earner", "individual"),
        "frequency": Part("all", "all", "shared"),
    },
    endings={"dark": Ending("termination", "all"), "time": TIME},
    symmetric={"plant": True, "consumer": True},
    horizon=24,
    influence=links(
        *[f"{a} {b} {on}" for a, b in PAIRS for on in ("reward 0", "observation 1", "ending 0")]
    ),
    order_sensitive="none",
    advice="parallel",
)


class Platoon(Turns):
    """Four trucks in a row: from the first to the last each sets its speed, and the next sees it.

    Speeds are 0 to 2. A truck sees its gap and the speed of the truck ahead in this round, as it is
    set (the first one sees a drawn limit); it is paid minus the distance of its gap from 2.
    """

    def __init__(self) -> None:
        super().__init__(names("truck", 4), box(2, -99, 99), Box(0, 2, (1,), np.float32), 20)

    def _start(self, rng: Any) -> None:
        self.gap = dict(zip(self.agents, rng.uniform(1, 3, 4).tolist(), strict=True))
        self.ahead = float(rng.uniform(0, 2))

    def _act(self, agent: str, action: Any) -> None:
        speed = float(np.clip(action[0], 0, 2))
        self.gap[agent] += self.ahead - speed
        self._pay(agent, -abs(self.gap[agent] - 2))
        self.ahead = speed

    def _close(self) -> None:
        self.ahead = float(self.rng.uniform(0, 2))

    def _look(self, agent: str) -> Any:
        mine = agent == getattr(self, "agent_selection", agent)
        return vector(self.gap[agent], self.ahead if mine else 0.0)


PLATOON = Form(
    name="platoon",
    api="aec",
    stages=(("truck",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"gap": Part("truck", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"truck": False},
    horizon=20,
    influence=links("truck truck observation 0", "truck truck reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Gale(Ticks):
    """Two gliders steer by -1 to 1 in a wind that no seed determines; each is paid its own height.

    The wind comes from a generator that is seeded by the machine. Gliders don't touch each other.
    """

    def __init__(self) -> None:
        super().__init__(names("glider", 2), box(1), force(), 18)

    def _start(self, rng: Any) -> None:
        self.height, self.wind = dict.fromkeys(self.agents, 0.0), np.random.default_rng()

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            self.height[agent] += float(pushed(actions[agent])[0]) + self.wind.normal()
            self.height[agent] = min(99.0, max(-99.0, self.height[agent]))
            self._pay(agent, self.height[agent])

    def _look(self, agent: str) -> Any:
        return vector(self.height[agent])


GALE = Form(
    name="gale",
    api="parallel",
    stages=(("glider",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"height": Part("glider", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"glider": True},
    horizon=18,
    deterministic=False,
    influence=links(),
    order_sensitive="none",
    advice="either",
    doubtful=("order_sensitive", "advice", "conflicts"),
)

FORMS = ((Lanterns, LANTERNS), (Mains, MAINS), (Platoon, PLATOON), (Gale, GALE))
