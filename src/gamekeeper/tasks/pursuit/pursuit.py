"""Pursuers hunt evaders on a field of cells; who is caught or starves dies and leaves.

    R1. The field has `rows` by `columns` cells. Each cell in an odd row and an odd column, counted
        from 0, is a rock with probability `rocks`, drawn anew for each episode; so no free cell is
        ever cut off from another.
    R2. Pursuers, then evaders are put into free cells, each of them drawn. A cell holds one.
    R3. Each tick all move at once: 0 nowhere, 1 to 4 a cell to the north, east, south, west. Nobody
        goes off the field, into a rock, or into a cell in which somebody stood as the tick began.
    R4. Into a cell that several want nobody goes.
    R5. An evader is caught where, after the moves, `catchers` pursuers or more are beside it (in
        the four cells next to it), or as many as it has sides that are neither rock nor edge. It is
        paid BEING_CAUGHT ("capture"), terminated ("caught"), and leaves the field.
    R6. Pursuers beside an evader that is caught share CATCH ("prey") equally. A pursuer may have a
        share in several: all catches of a tick are looked for at once, before anybody leaves.
    R7. A pursuer begins with `stamina` units of energy and spends one a tick; who has a share in a
        catch has `stamina` again. At 0 it is paid STARVING ("hunger"), terminated ("starved"), and
        leaves the field. With `stamina` 0 nobody starves.
    R8. An evader that isn't caught is paid TICK each tick ("survival").
    R9. Without any evader left the pursuers are terminated ("cleared"), without any pursuer the
        evaders ("free"). After `horizon` ticks all are truncated ("horizon").
    R10. Everybody sees the cells up to `pursuer_sight` or `evader_sight` rows and columns away, in
        three planes: what is closed (rock, or off the field), pursuers, evaders. Pursuers are seen
        by pursuers with their energy in percent, rounded up, by evaders as 1. Who has just died
        sees the field without itself.
    R11. Evaders are agents, or (argument `evaders_are`) follow a script: `flee` goes where the
        nearest pursuer in sight will be furthest, by chance where that is equal, and wanders where
        there is none; `wander` moves by chance; `still` stays.

An episode is solved where no evader is left. Nothing is looked up for pairs of agents: a tick costs
the same for each, for ten and for thousands (see `benchmarks/pursuit.py`).

Source: a task of our own. That caught agents leave, and the plane for each kind, are as in the
pursuit of Gupta, Egorov & Kochenderfer 2017 ("Cooperative multi-agent control using deep
reinforcement learning"), in which catches and collisions are others.
"""

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.errors import SpecError, check_choice
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import KernelTicks
from gamekeeper.tasks.arguments import check_part, check_whole
from gamekeeper.tasks.drawing import BLUE, CELL, INK, ORANGE, Canvas, Pictured, metadata_of, text_of
from gamekeeper.tasks.pursuit import pursuit_rules as rules

Window: TypeAlias = NDArray[np.int8]
Way: TypeAlias = tuple[int, int]
"""Rows and columns from the middle of a window."""

STAY: Final = 0
STEPS: Final = ((0, 0), (-1, 0), (0, 1), (1, 0), (0, -1))
"""Rows and columns by action: nowhere, north, east, south, west."""
CLOSED, PURSUERS, EVADERS = range(3)
STRAIGHT: Final = 0.9
"""Probability that a pursuer which sees no evader goes on in the direction of its round."""
IMPATIENCE: Final = 0.25
"""Probability that a pursuer alone with an evader lets it be, to find somebody."""
APART: Final = 0.6
"""Weight of a cell's distance from the partner, in cells of one's own way to it."""
LEG: Final = 10
"""Ticks in one direction."""


def reference(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Pursuers agree whom to hunt by what all of them see, and go rounds; evaders flee."""
    if agent.startswith("evader"):
        return _flee(observation, rng)
    target, partner = _agreed(observation)
    if target is not None and partner is not None:
        return _around(observation, target, partner, rng)
    if target is not None and rng.random() >= IMPATIENCE:
        return _towards(observation, target, rng)
    return _round(observation, agent, info, rng)


def greedy(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Pursuers run at the evader that is nearest, whoever else does; evaders wander."""
    seen = [] if agent.startswith("evader") else _places(observation, EVADERS)
    if not seen:
        return int(rng.integers(len(STEPS)))
    return _towards(observation, min(seen, key=_length), rng)


def lazy(observation: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Stays where it is."""
    return STAY


def _places(window: Window, plane: int) -> list[Way]:
    """Places of things in a plane, rows and columns from the middle."""
    sight = len(window) // 2
    return [(y - sight, x - sight) for y, x in np.argwhere(window[..., plane]).tolist()]


def _length(way: Way) -> int:
    return abs(way[0]) + abs(way[1])


def _between(one: Way, other: Way) -> int:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def _open(window: Window) -> list[int]:
    """The actions that lead nowhere else than into empty cells, or nowhere."""
    middle = len(window) // 2
    return [
        action
        for action, (down, right) in enumerate(STEPS)
        if action == STAY or not window[middle + down, middle + right].any()
    ]


def _agreed(window: Window) -> tuple[Way | None, Way | None]:
    """The evader that two pursuers can be at soonest, and who the other one is.

    Pursuers near each other see nearly the same, so that they choose the same evader.
    """
    others = [place for place in _places(window, PURSUERS) if place != (0, 0)]
    best, partner, soonest = None, None, None
    for evader in _places(window, EVADERS):
        near = sorted((_between(other, evader), k) for k, other in enumerate(others))
        if len(near) > 1 and near[1][0] < _length(evader):
            continue  # two others are nearer
        way = near[0][0] if near else len(window)
        when = max(_length(evader), way), _length(evader)
        if soonest is None or when < soonest:
            best, partner, soonest = evader, others[near[0][1]] if near else None, when
    return best, partner


def _around(window: Window, evader: Way, partner: Way, rng: Generator) -> int:
    """A step to the side of the evader that is near oneself and far from the partner."""
    sight, beside = len(window) // 2, []
    for down, right in STEPS[1:]:
        side = evader[0] + down, evader[1] + right
        is_seen = max(abs(side[0]), abs(side[1])) <= sight
        is_own = side == (0, 0)
        if is_own or (is_seen and not window[side[0] + sight, side[1] + sight].any()):
            beside.append((_length(side) - APART * _between(partner, side), side))
    if not beside:
        return _towards(window, evader, rng)
    goal = min(beside)[1]
    return STAY if goal == (0, 0) else _towards(window, goal, rng, arrives=True)


def _towards(window: Window, place: Way, rng: Generator, *, arrives: bool = False) -> int:
    """A step that shortens the way to a place, or to beside it; around what is in the way."""
    if _length(place) == 1 and not arrives:
        return STAY
    ways = {action: _between(STEPS[action], place) for action in _open(window)}
    shortest = min(ways.values())
    best = [action for action, way in ways.items() if way == shortest]
    if best == [STAY]:
        best = [action for action in ways if action != STAY] or best
    return int(best[int(rng.integers(len(best)))])


def _round(window: Window, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Goes straight for LEG ticks, then another way; turns by chance at what is closed.

    Its energy tells the ticks; each number takes other ways.
    """
    number, leg = int(agent.rpartition("_")[2]), int(info["energy"]) // LEG
    actions = [action for action in _open(window) if action != STAY]
    if not actions:
        return STAY
    wanted = 1 + (number * 2654435761 + leg * 2246822519 >> 13) % 4
    if wanted in actions and rng.random() < STRAIGHT:
        return wanted
    return int(actions[int(rng.integers(len(actions)))])


def _flee(window: Window, rng: Generator) -> int:
    """Goes where the nearest pursuer is furthest; wanders where none is seen."""
    pursuers, actions = _places(window, PURSUERS), _open(window)
    if not pursuers:
        return int(rng.integers(len(STEPS)))
    room = [min(_between(STEPS[action], each) for each in pursuers) for action in actions]
    best = [action for action, far in zip(actions, room, strict=True) if far == max(room)]
    return int(best[int(rng.integers(len(best)))])


SCRIPTS: Final = ("agents", "flee", "wander", "still")
"""Ways to move the evaders; the numbers are those of the rules."""
MOST_ENERGY: Final = 32_000
LONGEST: Final = 960
"""Pixels along a picture's longer side, about."""
METADATA: Final = metadata_of("pursuit_v0", fps=8)
TABLES: Final = np.dtype(
    [
        ("rows", "i8"),
        ("columns", "i8"),
        ("border", "i8"),
        ("width", "i8"),
        ("pursuers", "i8"),
        ("evaders", "i8"),
        ("pursuer_sight", "i8"),
        ("evader_sight", "i8"),
        ("catchers", "i8"),
        ("stamina", "i8"),
        ("script", "i8"),
        ("rocks", "f8"),
        ("ahead", "i8", (rules.MOVES,)),
    ]
)
"""The task's numbers; `ahead`: what a move adds to the number of a cell."""


def pursuit_kernel(
    *,
    pursuers: int = 8,
    evaders: int = 8,
    rows: int = 16,
    columns: int = 16,
    catchers: int = 2,
    stamina: int = 150,
    rocks: float = 0.3,
    pursuer_sight: int = 4,
    evader_sight: int = 3,
    evaders_are: str = "agents",
    horizon: int = 500,
) -> Kernel:
    """The rules as a kernel; arguments as of `Pursuit`.

    Raises:
        SpecError: a number is out of its range, or the field is too small for so many.
    """
    given = locals()
    _check_all(given)
    count = pursuers + evaders
    border = max(pursuer_sight, evader_sight)
    width = columns + 2 * border
    given |= {"border": border, "width": width, "script": SCRIPTS.index(evaders_are)}
    given["ahead"] = (0, -width, 1, width, -1)
    tables = np.zeros(1, TABLES)
    for name in TABLES.names or ():
        tables[name] = given[name]
    both = evaders_are == "agents"
    seen = dict.fromkeys(_names("pursuer", pursuers), _window(pursuer_sight, rules.FULL))
    if both:
        seen |= dict.fromkeys(_names("evader", evaders), _window(evader_sight, 1))
    return Kernel(
        name="pursuit_v0",
        agents=tuple(seen),
        observation_space=seen,
        action_space=Discrete(rules.MOVES),
        state=[
            ("grid", "i4", ((rows + 2 * border) * width,)),
            ("nearest", "i4", (rules.MOVES,)),
            ("cells", "i4", (count,)),
            ("aims", "i4", (count,)),
            ("gone", "i4", (count,)),
            ("there", "i1", (count,)),
            ("beside", "i1", (count,)),
            ("energy", "i4", (pursuers,)),
            ("pursuers", "i4"),
            ("evaders", "i4"),
        ],
        reset=rules.reset,
        step=rules.step_of_both if both else rules.step_of_pursuers,
        observe=rules.observe_both if both else rules.observe_pursuers,
        inform=rules.inform,
        info=[("position", "i8", (2,)), ("energy", "i8"), ("evaders", "i8")],
        overview=rules.overview,
        state_space=Box(-2, max(stamina, 1), (rows, columns), np.int16),
        tables=tables,
        terms=("prey", "hunger", "capture", "survival"),
        endings=("caught", "starved", "cleared", "free"),
        horizon=horizon,
        metadata=METADATA,
    )


def _check_all(given: Mapping[str, Any]) -> None:
    """Refuses numbers out of their ranges, and a field that is too small."""
    least = {"pursuers": 1, "evaders": 1, "rows": 2, "columns": 2, "catchers": 1, "stamina": 0}
    most = {"catchers": 4, "stamina": MOST_ENERGY}
    for name in (*least, "pursuer_sight", "evader_sight", "horizon"):
        check_whole(name, given[name], least.get(name, 1), most.get(name))
    check_part("rocks", given["rocks"])
    no_mover = "there is no such mover of the evaders"
    check_choice(given["evaders_are"], SCRIPTS, no_mover, where="evaders_are")
    rows, columns = given["rows"], given["columns"]
    free = rows * columns - (rows // 2) * (columns // 2)
    count = given["pursuers"] + given["evaders"]
    if 2 * count > free:
        raise SpecError(
            "the field is too small for so many",
            where="rows, columns",
            expected=f"{2 * count} cells that can't be rocks, two for each of them",
            actual=str(free),
            fix="make the field larger, or play with fewer",
        )


def _names(role: str, count: int) -> tuple[str, ...]:
    return tuple(f"{role}_{i}" for i in range(count))


def _window(sight: int, most: int) -> Box:
    """Planes of what is closed, of pursuers and of evaders, [side, side, 3] int8 (R10)."""
    side = 2 * sight + 1
    high = np.ones((side, side, 3), np.int8)
    high[..., 1] = most
    return Box(np.zeros_like(high), high, dtype=np.int8)


class Pursuit(Pictured, KernelTicks):
    """Pursuers and evaders, [side, side, 3] int8 windows each; see R1 to R11.

    Infos tell `position` (row, column), `energy` (0 of evaders) and `evaders`, how many are left.

    Args:
        pursuers, evaders: how many there are, to thousands.
        rows, columns: of the field; it has two cells or more for each agent.
        catchers: how many pursuers it takes to catch an evader, 1 to 4.
        stamina: ticks that a pursuer lives on a catch; 0: for ever.
        rocks: probability that a cell which may be a rock is one.
        pursuer_sight, evader_sight: rows and columns that one sees to each side.
        evaders_are: `agents`, or the script that they follow: `flee`, `wander`, `still`.
        horizon: ticks after which all are truncated.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python, for breakpoints in them.
    Raises:
        SpecError: a number is out of its range, or the field is too small for so many.
    """

    metadata = METADATA
    contract = "pursuit.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(
        self, *, render_mode: str | None = None, debug: bool = False, **numbers: Any
    ) -> None:
        super().__init__(pursuit_kernel(**numbers), render_mode=render_mode, debug=debug)

    def letters(self) -> str:
        """Field in letters: `#` rock, `P` pursuer, `e` evader."""
        field = self.state()
        letters = np.array(list("#e.P"))[np.minimum(field, 1) + 2]
        return text_of(letters.tolist(), f"{int((field == -1).sum())} evaders left")

    def pixels(self) -> NDArray[np.uint8]:
        """Field in cells of at most 24 pixels."""
        field = self.state()
        rows, columns = field.shape
        canvas = Canvas(columns, rows, cell=min(CELL, max(LONGEST // max(rows, columns), 2)))
        for row, column in np.argwhere(field).tolist():
            if field[row, column] == -2:
                canvas.fill(column, row, INK)
            else:
                canvas.disc(column, row, BLUE if field[row, column] > 0 else ORANGE)
        return canvas.pixels
