"""The scene of a contract: how a picture of a turn is drawn from what was recorded, as data."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Final, TypeAlias

from gamekeeper.contract.sections import Table
from gamekeeper.contract.validation import (
    Read,
    SourcePath,
    listed,
    named,
    section,
    text,
    truth,
    whole,
    word,
)

FORMS: Final = ("grid", "plane")
SOURCE: Final = re.compile(r"state|observation(\.[^.\s]+)*|infos(\.[^.\s]+)+")
EVERY: Final = "all"
"""In place of a role: all agents."""
AGENTS: Final = "agents"
"""In place of a number: that of the agents."""
Count: TypeAlias = "int | str"
"""A number, or the name of one of the scene's arguments, or `agents`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """Places of agents or things: a record of numbers for each of them.

    Args:
        source: of the records: `state`, `observation`, `observation.KEY` or `infos.KEY`.
        plane: of a state of three axes, the plane whose cells hold numbers of agents, from 1;
            then a place is a cell, and no record is read.
        start: place from which records are counted.
        first: number of records before the first that is meant.
        each: length of a record; of an agent's own observation or info there is one.
        x, y: places in the record; without `y`, a line.
        here: place of a number that is 0 while it isn't there.
        carries: place of a number, or plane, that isn't 0 while something is carried.
        scale: factor of both numbers.
        mirrored: x is counted from the right.
        count: number of things; of agents it is known.
        by: the agent in whose observation or info the records of things stand.
        beside: the same, and things are seen from its place.
    """

    source: str = "state"
    plane: int | None = None
    start: Count = 0
    first: Count = 0
    each: int = 2
    x: int = 0
    y: int | None = None
    here: int | None = None
    carries: int | None = None
    scale: float = 1.0
    mirrored: bool = False
    count: Count = 1
    by: str | None = None
    beside: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """A layer of a grid: words for the numbers that its cells hold, or a board of two agents.

    Args:
        source: `state`; of a board `observation`, or `observation.KEY`.
        plane: of a state of three axes.
        last: cells are the last of the state, or those before them: 1 is the last block.
        values: by word, the number; an agent's name is drawn as the agent is. Of a board, which
            has rows, columns and channels: the channel that isn't 0 where the observing agent has
            such a piece.
        other: of a board, by the same words, the channels of the other agent's pieces.
        turned: the second agent sees the rows from the other side.
        transposed: columns stand before rows.
    """

    values: Mapping[str, int]
    source: str = "state"
    plane: int | None = None
    last: int | None = None
    other: Mapping[str, int] = field(default_factory=Table)
    turned: bool = False
    transposed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Drawing of a turn; None: not declared.

    Args:
        kind: `grid` or `plane`.
        size: columns and rows of a grid; where it isn't given, those of its cells.
        down: rows are counted downwards, as in most grids.
        arguments: names of arguments of the environment that stand for numbers here, and what
            they are unless they were given.
        unless: arguments with which the scene doesn't hold; then it isn't drawn.
        agents: places of agents by role, or of `all`.
        things: places of other bodies by word.
        cells: layers by word.
        fixed: by word, cells that never change: columns and rows, or with their extents, as
            `[[4, 10], [1, 1, 2, 8]]`.
        note: what a reader has to know of the drawing; stands below it.
        links: pairs of agents that are joined.
        actions: names of actions by role, or of `all`.
    """

    kind: str | None = None
    size: tuple[Count, ...] | None = None
    down: bool | None = None
    arguments: Mapping[str, int] = field(default_factory=Table)
    unless: tuple[str, ...] = ()
    agents: Mapping[str, Body] = field(default_factory=Table)
    things: Mapping[str, Body] = field(default_factory=Table)
    cells: Mapping[str, Cells] = field(default_factory=Table)
    fixed: Mapping[str, tuple[tuple[int, ...], ...]] = field(default_factory=Table)
    note: str | None = None
    links: tuple[tuple[str, ...], ...] = ()
    actions: Mapping[str, tuple[str, ...]] = field(default_factory=Table)

    @property
    def is_declared(self) -> bool:
        """True if there is something to draw, or a name."""
        return bool(self.kind or self.actions)

    def actions_of(self, role: str) -> tuple[str, ...]:
        """The names of a role's actions; empty where none are declared."""
        return self.actions.get(role) or self.actions.get(EVERY, ())


def source(value: object, at: SourcePath) -> str:
    """Reads a source of numbers."""
    if isinstance(value, str) and SOURCE.fullmatch(value):
        return value
    raise at.error(
        f"'{at.text}' doesn't say where numbers stand",
        expected='"state", "observation", "observation.KEY" or "infos.KEY"',
        actual=value,
        fix='write "state", or "infos.position"',
    )


def count(value: object, at: SourcePath) -> Count:
    """Reads a number, or the name of an argument."""
    return text(value, at) if isinstance(value, str) else whole(0)(value, at)


def integer(value: object, at: SourcePath) -> int:
    """Reads any whole number."""
    if isinstance(value, Integral) and not isinstance(value, bool) and abs(int(value)) < 2**31:
        return int(value)
    raise at.error(
        f"'{at.text}' is not a whole number",
        expected="a whole number",
        actual=value,
        fix="write one",
    )


def factor(value: object, at: SourcePath) -> float:
    """Reads a finite factor other than 0."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if is_number and 0 < abs(float(value)) < 1e9:  # type: ignore[arg-type]
        return float(value)  # type: ignore[arg-type]
    raise at.error(
        f"'{at.text}' is not a factor",
        expected="a number other than 0",
        actual=value,
        fix="write 1.0",
    )


BODY: Final = section(
    Body,
    {
        "source": source,
        "plane": whole(0),
        "start": count,
        "first": count,
        "each": whole(1),
        "x": whole(0),
        "y": whole(0),
        "here": whole(0),
        "carries": whole(0),
        "scale": factor,
        "mirrored": truth,
        "count": count,
        "by": text,
        "beside": text,
    },
)
CELLS: Final = section(
    Cells,
    {
        "source": source,
        "plane": whole(0),
        "last": whole(1),
        "values": named(integer),
        "other": named(whole(0)),
        "turned": truth,
        "transposed": truth,
    },
    "values",
)
SCENE: Final[Read[Scene]] = section(
    Scene,
    {
        "kind": word(*FORMS),
        "size": listed(count, least=2),
        "down": truth,
        "arguments": named(whole(0)),
        "unless": listed(text),
        "agents": named(BODY),
        "things": named(BODY),
        "cells": named(CELLS),
        "fixed": named(listed(listed(whole(0), least=2))),
        "note": text,
        "links": listed(listed(text, least=2)),
        "actions": named(listed(text, least=1)),
    },
)
