"""Moves that open and close the moves of others (held back)."""

from __future__ import annotations

from typing import Any

from gymnasium.spaces import Box, Dict, Discrete

from benchmarks.forms.bases import Ticks, Turns, box, names, vector
from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Airlock(Turns):
    """An operator opens door 1 or 2 of an airlock, or none (0); that door's diver then may dive.

    Each round the operator is first. A diver whose door is open may dive (1) for a pearl of drawn
    size, which pays the diver; the operator is paid 0.25 of it. Nobody sees the door.
    """

    def __init__(self) -> None:
        agents = ["operator_0", *names("diver", 2)]
        acts = {"operator": Discrete(3), "diver": Discrete(2)}
        super().__init__(agents, box(1, 0, 9), acts, 23)

    def _start(self, rng: Any) -> None:
        self.door, self.pearl = 0, int(rng.integers(1, 9))

    def _act(self, agent: str, action: Any) -> None:
        if agent == "operator_0":
            self.door = int(action)
        elif action and self.door == 1 + int(agent[-1]):
            self._pay(agent, self.pearl)
            self._pay("operator_0", self.pearl / 4)

    def _close(self) -> None:
        self.door, self.pearl = 0, int(self.rng.integers(1, 9))

    def _mask(self, agent: str) -> Any:
        return [1] * 3 if agent == "operator_0" else [1, self.door == 1 + int(agent[-1])]

    def _look(self, agent: str) -> Any:
        return vector(self.pearl)


AIRLOCK = Form(
    name="airlock",
    api="aec",
    stages=(("operator",), ("diver",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={
        "pearl": Part("diver", "earner", "individual"),
        "share": Part("diver", "operator", "individual"),
    },
    endings={"time": TIME},
    symmetric={"operator": None, "diver": True},
    horizon=23,
    influence=links("operator diver mask 0", "operator diver reward 0", "diver operator reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("legality",),
    doubtful=("symmetric",),
)


class Tools(Ticks):
    """Three smiths want tool 1, 2 or none (0) for the next tick; a tool is masked while in use.

    A tool that just one smith asks for is its own for the next tick: it is then paid 2, and all
    tools in use can't be asked for in that tick. Requests for the same tool come to nothing.
    """

    def __init__(self) -> None:
        super().__init__(names("smith", 3), box(1, 0, 9), Discrete(3), 27)

    def _start(self, rng: Any) -> None:
        self.user, self.fire = {}, int(rng.integers(0, 9))

    def _tick(self, actions: Any) -> None:
        wanted = [int(actions[a]) for a in self.agents]
        for agent in self.user.values():
            self._pay(agent, 2.0)
        free = {1, 2} - set(self.user)
        self.user = {
            tool: self.agents[wanted.index(tool)] for tool in free if wanted.count(tool) == 1
        }
        self.fire = int(self.rng.integers(0, 9))

    def _mask(self, agent: str) -> Any:
        return [1, 1 not in self.user, 2 not in self.user]

    def _look(self, agent: str) -> Any:
        return vector(self.fire)


TOOLS = Form(
    name="tools",
    api="parallel",
    stages=(("smith",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    legality=True,
    rewards={"tool": Part("smith", "earner", "individual", 1)},
    endings={"time": TIME},
    symmetric={"smith": True},
    horizon=27,
    influence=links("smith smith mask 1", "smith smith reward 1"),
    order_sensitive="none",
    advice="parallel",
)


class Tiles(Turns):
    """Four tilers lay one of seven tiles of drawn worth, in an order that is drawn each round.

    A laid tile is gone until the round is over; the mask stands in the observation. The first tiler
    of a round gets 1 more.
    """

    def __init__(self) -> None:
        observes = Dict({"observation": box(7, 0, 9), "action_mask": Box(0, 1, (7,), "int8")})
        super().__init__(names("tiler", 4), observes, Discrete(7), 11)

    def _start(self, rng: Any) -> None:
        self.worth, self.free = rng.integers(1, 9, 7), [1] * 7

    def _order(self) -> list[str]:
        live = self._live()
        return [live[i] for i in self.rng.permutation(len(live))]

    def _act(self, agent: str, action: Any) -> None:
        if self.free[int(action)]:
            self._pay(agent, self.worth[int(action)] + (sum(self.free) == 7))
            self.free[int(action)] = 0

    def _close(self) -> None:
        self.worth, self.free = self.rng.integers(1, 9, 7), [1] * 7

    def _look(self, agent: str) -> Any:
        mask = vector(*self.free).astype("int8")
        return {"observation": vector(*self.worth), "action_mask": mask}


TILES = Form(
    name="tiles",
    api="aec",
    stages=(("tiler",),),
    order="random",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"worth": Part("tiler", "earner", "individual")},
    endings={"time": TIME},
    symmetric={"tiler": True},
    horizon=11,
    influence=links("tiler tiler mask 0", "tiler tiler reward 0"),
    order_sensitive=None,
    advice="aec",
    because=("legality",),
)


class Columns(Turns):
    """Two players drop stones into three columns of height 3; two of one's own on another win.

    Full columns are masked; a full board is a draw. The board is seen from the player's own side.
    """

    def __init__(self) -> None:
        super().__init__(names("player", 2), box(9, -1, 1), Discrete(3), None)

    def _start(self, rng: Any) -> None:
        self.columns: list[list[str]] = [[], [], []]

    def _act(self, agent: str, action: Any) -> None:
        column = self.columns[int(action)]
        if len(column) < 3:
            column.append(agent)
        if column[-2:] == [agent, agent]:
            other = "player_1" if agent == "player_0" else "player_0"
            self._pay(agent, 1.0)
            self._pay(other, -1.0)
            self._end(agent, other)
        elif all(len(each) == 3 for each in self.columns):
            self._end(*self.possible_agents)

    def _mask(self, agent: str) -> Any:
        free = [len(column) < 3 for column in self.columns]
        return free if any(free) else [1, 1, 1]

    def _look(self, agent: str) -> Any:
        cells = [0.0] * 9
        for i, column in enumerate(self.columns):
            for j, owner in enumerate(column):
                cells[3 * i + j] = 1.0 if owner == agent else -1.0
        return vector(*cells)


COLUMNS = Form(
    name="columns",
    api="aec",
    stages=(("player",),),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    legality=True,
    rewards={"win": Part("player", "all", "zero-sum")},
    endings={"won": Ending("termination", "all"), "full": Ending("termination", "all")},
    symmetric={"player": False},
    horizon=None,
    influence=links(
        "player player observation 0",
        "player player mask 0",
        "player player reward 0",
        "player player ending 0",
    ),
    order_sensitive=None,
    advice="aec",
    because=("state", "legality"),
)

FORMS = ((Airlock, AIRLOCK), (Tools, TOOLS), (Tiles, TILES), (Columns, COLUMNS))
