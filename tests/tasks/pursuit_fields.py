"""Games of pursuit that stand as they are drawn."""

from typing import Any

from gamekeeper.tasks.pursuit import pursuit_rules as rules
from gamekeeper.tasks.pursuit.pursuit import Pursuit

STAY = 0


def field(*lines: str, order: Any = None, **arguments: Any) -> Pursuit:
    """A game that stands as it is drawn: `P` pursuer, `e` evader, `#` rock, in reading order.

    Args:
        lines: the field; it is drawn on one that is large enough to begin on.
        order: the numbers of the pursuers, then of the evaders, in reading order.
        arguments: as of `Pursuit`.
    """
    rows, columns = max(len(lines), 8), max(len(lines[0]), 8)
    marks = {
        letter: [(r, c) for r, line in enumerate(lines) for c, x in enumerate(line) if x == letter]
        for letter in "Pe#"
    }
    arguments = {"pursuers": len(marks["P"]), "evaders": len(marks["e"]), **arguments}
    env = Pursuit(
        rows=rows, columns=columns, rocks=0.0, debug=True, render_mode="ansi", **arguments
    )
    env.reset(seed=0)
    tables, record = env.tables[0], env.memory.records[0]
    grid = record["grid"].reshape(-1, tables["width"])
    border = int(tables["border"])
    grid[:] = rules.ROCK
    grid[border : border + len(lines), border : border + len(lines[0])] = rules.EMPTY
    for row, column in marks["#"]:
        grid[row + border, column + border] = rules.ROCK
    places = [*marks["P"], *marks["e"]]
    for number, (row, column) in zip(order or range(len(places)), places, strict=True):
        grid[row + border, column + border] = number + 1
        record["cells"][number] = (row + border) * tables["width"] + column + border
    return env


def text(env: Pursuit, like: tuple[str, ...]) -> list[str]:
    """The field as it stands, as large as it was drawn."""
    return [line[: len(like[0])] for line in env.render().splitlines()[: len(like)]]


def after(lines: tuple[str, ...], moves: dict[str, int], **arguments: Any) -> list[str]:
    """The field after a tick in which who isn't named stays."""
    env = field(*lines, **arguments)
    env.step({agent: moves.get(agent, STAY) for agent in env.agents})
    return text(env, lines)
