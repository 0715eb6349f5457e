"""Grids, planes and pictures (held back)."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Hiders(Ticks):
    """Two hiders and a seeker choose one of three rooms at once; doors close behind them each tick.

    The hiders in the seeker's room are found: minus 1 for each of the found, plus 1 for the seeker
    for each. A hider that was found three times is out (its own termination); both out end it all.
    """

    def __init__(self) -> None:
        super().__init__([*names("hider", 2), "seeker_0"], box(2, -1, 9), Discrete(3), 9)

    def _start(self, rng: Any) -> None:
        self.found, self.room = dict.fromkeys(names("hider", 2), 0), int(rng.integers(3))

    def _tick(self, actions: Any) -> None:
        self.room = int(actions["seeker_0"])
        for agent in self.agents[:-1]:
            if int(actions[agent]) == self.room:
                self._pay(agent, -1.0)
                self._pay("seeker_0", 1.0)
                self.found[agent] += 1
                if self.found[agent] == 3:
                    self._end(agent)
        if min(self.found.values()) >= 3:
            self._end("seeker_0")

    def _look(self, agent: str) -> Any:
        return vector(
            self.room, sum(self.found.values()) if agent == "seeker_0" else self.found[agent]
        )


HIDERS = Form(
    name="hiders",
    api="parallel",
    stages=(("hider", "seeker"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"found": Part("all", "all", "zero-sum")},
    endings={
        "out": Ending("termination", "agent"),
        "all out": Ending("termination", "all"),
        "time": TIME,
    },
    symmetric={"hider": True, "seeker": None},
    horizon=9,
    influence=links(
        "seeker hider observation 1",
        "seeker hider reward 0",
        "seeker hider ending 0",
        "hider seeker observation 1",
        "hider seeker reward 0",
        "hider seeker ending 0",
    ),
    order_sensitive="none",
    advice="parallel",
    doubtful=("endings", "rewards"),
)


class Rink(Ticks):
    """Two skaters push themselves on a line, one from the left end, one from the right, mirrored.

    Each sees its own way to the middle and the other's, so that the two ends are alike although
    they look different. The nearer to the middle gains 1 from the other.
    """

    def __init__(self) -> None:
        super().__init__(names("skater", 2), box(2, -30, 30), Box(-1, 1, (1,), np.float32), 22)

    def _start(self, rng: Any) -> None:
        start = float(rng.uniform(2, 5))
        self.way = dict.fromkeys(self.possible_agents, start)

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            self.way[agent] -= float(np.clip(actions[agent][0], -1, 1))
            self.way[agent] = min(20.0, max(-20.0, self.way[agent]))
        left, right = (abs(self.way[agent]) for agent in self.possible_agents)
        won = float(left < right) - float(right < left)
        self._pay("skater_0", won)
        self._pay("skater_1", -won)

    def _look(self, agent: str) -> Any:
        other = "skater_1" if agent == "skater_0" else "skater_0"
        return vector(self.way[agent], self.way[other])


RINK = Form(
    name="rink",
    api="parallel",
    stages=(("skater",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"nearer": Part("skater", "all", "zero-sum")},
    endings={"time": TIME},
    symmetric={"skater": True},
    horizon=22,
    influence=links("skater skater reward 0", "skater skater observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Kelp(Ticks):
    """Five divers cut kelp (1), seed it (2) or swim (0); what is left is seen as a picture.

    A cut pays its diver 1 while there is kelp for all that cut (else their even share); a seeding
    brings half a kelp after five ticks. When less than half a kelp is left, all go home.
    """

    def __init__(self) -> None:
        super().__init__(names("diver", 5), Box(0, 255, (6, 6, 3), np.uint8), Discrete(3), 18)

    def _start(self, rng: Any) -> None:
        self.kelp, self.seeds = float(rng.integers(14, 27)), [0] * 5

    def _tick(self, actions: Any) -> None:
        moves = [int(actions[agent]) for agent in self.agents]
        cuts = moves.count(1)
        share = min(1.0, self.kelp / cuts) if cuts else 0.0
        for agent, move in zip(self.agents, moves, strict=True):
            self._pay(agent, share if move == 1 else 0.0)
        self.seeds.append(moves.count(2))
        self.kelp = min(36.0, self.kelp - share * cuts + self.seeds.pop(0) / 2)
        if self.kelp < 0.5:
            self._end(*self.agents)

    def _look(self, agent: str) -> Any:
        picture = np.zeros((6, 6, 3), np.uint8)
        filled = np.clip(self.kelp - np.arange(36), 0, 1) * 250
        picture[..., 1] = filled.reshape(6, 6).astype(np.uint8)
        return picture


KELP = Form(
    name="kelp",
    api="parallel",
    stages=(("diver",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"cut": Part("diver", "earner", "individual")},
    endings={"bare": Ending("termination", "all"), "time": TIME},
    symmetric={"diver": True},
    horizon=18,
    influence=links("diver diver observation 1", "diver diver reward 0", "diver diver ending 0"),
    order_sensitive="none",
    advice="parallel",
)


class Snow(Ticks):
    """Two ploughs clear a street of three lanes; the snow falls by a generator that nobody seeds.

    Each clears the lane it chooses and is paid the snow there; two in one lane share it. The snow
    of all lanes is seen.
    """

    def __init__(self) -> None:
        super().__init__(names("plough", 2), box(3, 0, 200), Discrete(3), 15)

    def _start(self, rng: Any) -> None:
        self.sky = np.random.default_rng()
        self.snow = self.sky.uniform(0, 3, 3)

    def _tick(self, actions: Any) -> None:
        lanes = [int(actions[agent]) for agent in self.agents]
        for agent, lane in zip(self.agents, lanes, strict=True):
            self._pay(agent, self.snow[lane] / lanes.count(lane))
        for lane in set(lanes):
            self.snow[lane] = 0.0
        self.snow += self.sky.uniform(0, 3, 3)

    def _look(self, agent: str) -> Any:
        return self.snow.astype(np.float32)


SNOW = Form(
    name="snow",
    api="parallel",
    stages=(("plough",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"snow": Part("plough", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"plough": True},
    horizon=15,
    deterministic=False,
    influence=links("plough plough reward 0", "plough plough observation 1"),
    order_sensitive="none",
    advice="parallel",
    doubtful=("order_sensitive", "advice", "conflicts", "influence"),
)


class Stairs(Turns):
    """Three monks climb a stair; the highest moves first each round and blocks its step.

    Monks start on different drawn steps and climb 0, 1 or 2; a step that another stands on can't be
    entered. Each sees all heights. The first above step 24 is paid 5, and all end.
    """

    def __init__(self) -> None:
        super().__init__(names("monk", 3), box(3, 0, 30), Discrete(3), 24)

    def _start(self, rng: Any) -> None:
        places = rng.permutation(5)[:3].tolist()
        self.at = dict(zip(self.possible_agents, places, strict=True))

    def _order(self) -> list[str]:
        return sorted(self._live(), key=self.at.__getitem__, reverse=True)

    def _act(self, agent: str, action: Any) -> None:
        to = self.at[agent] + int(action)
        if to not in self.at.values():
            self._pay(agent, 0.1 * int(action))
            self.at[agent] = to
        if self.at[agent] > 24:
            self._pay(agent, 5.0)
            self._end(*self._live())

    def _look(self, agent: str) -> Any:
        others = sorted(self.at[name] for name in self.possible_agents if name != agent)
        return vector(self.at[agent], *others)


STAIRS = Form(
    name="stairs",
    api="aec",
    stages=(("monk",),),
    order="state",
    observe="after turn",
    conflicts="ordered",
    rewards={
        "climb": Part("monk", "earner", "individual"),
        "top": Part("monk", "earner", "individual"),
    },
    endings={"top": Ending("termination", "all"), "time": TIME},
    symmetric={"monk": True},
    horizon=24,
    influence=links("monk monk observation 0", "monk monk reward 0", "monk monk ending 0"),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)

FORMS = ((Hiders, HIDERS), (Rink, RINK), (Kelp, KELP), (Snow, SNOW), (Stairs, STAIRS))
