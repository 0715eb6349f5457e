"""Grids: foraging, pursuit, a junction, a commons, and pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links

MOVES = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


class Mushrooms(Ticks):
    """Two gatherers walk a meadow of 3 by 3; a mushroom needs both within two steps, picking.

    Actions: stay, four steps, pick (5 to 7). Both are paid its weight; it grows elsewhere.
    Nothing is in anybody's way.
    """

    def __init__(self) -> None:
        super().__init__(names("gatherer", 2), box(7, 0, 9), Discrete(8), 45)

    def _start(self, rng: Any) -> None:
        self.at = {agent: rng.integers(0, 3, 2) for agent in self.possible_agents}
        self._grow()

    def _grow(self) -> None:
        self.spot, self.weight = self.rng.integers(0, 3, 2), int(self.rng.integers(1, 4))

    def _tick(self, actions: Any) -> None:
        near = {a: int(np.abs(self.at[a] - self.spot).sum()) <= 2 for a in self.agents}
        if all(near[agent] and int(actions[agent]) >= 5 for agent in self.agents):
            for agent in self.agents:
                self._pay(agent, self.weight)
            self._grow()
        for agent in self.agents:
            move = MOVES[int(actions[agent]) if int(actions[agent]) < 5 else 0]
            self.at[agent] = np.clip(self.at[agent] + move, 0, 2)

    def _look(self, agent: str) -> Any:
        other = "gatherer_1" if agent == "gatherer_0" else "gatherer_0"
        return vector(*self.at[agent], *self.at[other], *self.spot, self.weight)


MUSHROOMS = Form(
    name="mushrooms",
    api="parallel",
    stages=(("gatherer",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"mushroom": Part("gatherer", "all", "shared")},
    endings={"time": TIME},
    symmetric={"gatherer": True},
    horizon=45,
    influence=links("gatherer gatherer reward 0", "gatherer gatherer observation 1"),
    order_sensitive="none",
    advice="parallel",
)


class Hounds(Ticks):
    """Three hounds hunt a hare on a ring of 31 fields; all move by -1, 0 or 1 at once.

    Where a hound stands on the hare's field after the moves, the hare is caught: it loses 3, each
    hound gains 1, and the hunt is over. Each tick that it is free pays the hare 0.1.
    """

    def __init__(self) -> None:
        super().__init__([*names("hound", 3), "hare_0"], box(4, 0, 31), Discrete(3), 12)

    def _start(self, rng: Any) -> None:
        places = rng.permutation(31)
        self.at = {agent: int(places[i]) for i, agent in enumerate(self.possible_agents)}

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            self.at[agent] = (self.at[agent] + int(actions[agent]) - 1) % 31
        hounds = self.agents[:3]
        if any(self.at[hound] == self.at["hare_0"] for hound in hounds):
            self._pay("hare_0", -3.0)
            for hound in hounds:
                self._pay(hound, 1.0)
            self._end(*self.agents)
        else:
            self._pay("hare_0", 0.1)

    def _look(self, agent: str) -> Any:
        others = sorted(self.at[a] for a in names("hound", 3) if a != agent)
        if agent == "hare_0":
            return vector(self.at[agent], *others)
        return vector(self.at[agent], *others, self.at["hare_0"])


HOUNDS = Form(
    name="hounds",
    api="parallel",
    stages=(("hound", "hare"),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "catch": Part("hound", "all", "zero-sum"),
        "free": Part("hare", "earner", "individual"),
    },
    endings={"caught": Ending("termination", "all"), "time": TIME},
    symmetric={"hound": True, "hare": None},
    horizon=12,
    influence=links(
        *[
            f"{source} {to} {on}"
            for source, to in (("hound", "hound"), ("hound", "hare"), ("hare", "hound"))
            for on in ("observation 1", "reward 0", "ending 0")
        ]
    ),
    order_sensitive="none",
    advice="parallel",
)


class Junction(Ticks):
    """Four cars on four roads of length 4 to 7 meet at one junction; each gas or brake, at once.

    Cars on the junction in the same tick crash: -10 each, and they go on. A car that is through has
    ended for itself and is paid 2. Cars see their own distance and the number of waiting cars.
    """

    def __init__(self) -> None:
        super().__init__(names("car", 4), box(2, -1, 9), Discrete(2), 16)

    def _start(self, rng: Any) -> None:
        self.left = {a: int(x) for a, x in zip(self.agents, rng.integers(4, 8, 4), strict=True)}

    def _tick(self, actions: Any) -> None:
        for agent in self.agents:
            self.left[agent] -= int(actions[agent])
        inside = [a for a in self.agents if self.left[a] == 0]
        for agent in inside if len(inside) > 1 else ():
            self._pay(agent, -10.0)
        for agent in self.agents:
            if self.left[agent] < 0:
                self._pay(agent, 2.0)
                self._end(agent)

    def _look(self, agent: str) -> Any:
        near = sum(0 <= left <= 2 for left in self.left.values())
        return vector(max(self.left[agent], -1), near)


JUNCTION = Form(
    name="junction",
    api="parallel",
    stages=(("car",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={
        "crash": Part("car", "earner", "individual"),
        "through": Part("car", "earner", "individual"),
    },
    endings={"through": Ending("termination", "agent"), "time": TIME},
    symmetric={"car": True},
    horizon=16,
    influence=links("car car observation 1", "car car reward 0"),
    order_sensitive="none",
    advice="parallel",
)


class Pasture(Ticks):
    """Four herders send 0 to 3 sheep; the grass is eaten in equal shares and grows by an eighth.

    A commons: when the grass is gone (below 1), the season ends for all. The picture that all see
    is a band of 8 by 4 pixels, green as far as there is grass.
    """

    def __init__(self) -> None:
        super().__init__(names("herder", 4), Box(0, 255, (8, 4, 3), np.uint8), Discrete(4), 30)

    def _start(self, rng: Any) -> None:
        self.grass = float(rng.uniform(40, 64))

    def _tick(self, actions: Any) -> None:
        wanted = sum(int(actions[agent]) for agent in self.agents)
        share = min(1.0, self.grass / wanted) if wanted else 0.0
        for agent in self.agents:
            self._pay(agent, share * int(actions[agent]))
        self.grass = min(64.0, (self.grass - share * wanted) * 1.125)
        if self.grass < 1:
            self._end(*self.agents)

    def _look(self, agent: str) -> Any:
        picture = np.zeros((8, 4, 3), np.uint8)
        shades = np.clip(self.grass * 4 - 8 * np.arange(32), 0, 8) / 8 * 255
        picture[..., 1] = shades.reshape(8, 4).astype(np.uint8)
        return picture


PASTURE = Form(
    name="pasture",
    api="parallel",
    stages=(("herder",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"grass": Part("herder", "earner", "individual")},
    endings={"bare": Ending("termination", "all"), "time": TIME},
    symmetric={"herder": True},
    horizon=30,
    influence=links(
        "herder herder observation 1", "herder herder reward 0", "herder herder ending 0"
    ),
    order_sensitive="none",
    advice="parallel",
)


class Corridor(Turns):
    """Two movers and a guard on a corridor of 5 cells; no two may share a cell; turns are drawn.

    A step into a taken cell comes to nothing. A mover at the right end is paid 2 and starts again
    in the leftmost free cell. All see all cells at all times; the guard is paid 0.2 in the middle.
    """

    def __init__(self) -> None:
        agents = [*names("mover", 2), "guard_0"]
        super().__init__(agents, box(3, 0, 5), Discrete(3), 40)

    def _start(self, rng: Any) -> None:
        places = rng.permutation(4)[:3].tolist()
        self.at = dict(zip(self.possible_agents, places, strict=True))

    def _order(self) -> list[str]:
        live = self._live()
        return [live[i] for i in self.rng.permutation(len(live))]

    def _act(self, agent: str, action: Any) -> None:
        to = min(4, max(0, self.at[agent] + int(action) - 1))
        if to not in self.at.values():
            self.at[agent] = to
        if agent == "guard_0":
            self._pay(agent, 0.2 * (self.at[agent] == 2))
        elif self.at[agent] == 4:
            self._pay(agent, 2.0)
            self.at[agent] = min(set(range(5)) - set(self.at.values()))

    def _look(self, agent: str) -> Any:
        movers = names("mover", 2) if agent != "mover_1" else ["mover_1", "mover_0"]
        return vector(*(self.at[mover] for mover in movers), self.at["guard_0"])


CORRIDOR = Form(
    name="corridor",
    api="aec",
    stages=(("mover", "guard"),),
    order="random",
    observe="after turn",
    conflicts="ordered",
    rewards={
        "through": Part("mover", "earner", "individual"),
        "middle": Part("guard", "earner", "individual"),
    },
    endings={"time": TIME},
    symmetric={"mover": True, "guard": None},
    horizon=40,
    influence=links(
        *[
            f"{source} {to} {on}"
            for source, to in (("mover", "mover"), ("mover", "guard"), ("guard", "mover"))
            for on in ("observation 0",)
        ],
        "mover mover reward 1",
        "mover guard reward 0",
        "guard mover reward 1",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)

FORMS = (
    (Mushrooms, MUSHROOMS),
    (Hounds, HOUNDS),
    (Junction, JUNCTION),
    (Pasture, PASTURE),
    (Corridor, CORRIDOR),
)
