"""A scene as data of the player: places of agents and things by turn, and layers of cells.

Where a declared source wasn't recorded, or has another shape, there is no scene.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract.scene import AGENTS, EVERY, SCENE, Body, Cells, Count, Scene
from gamekeeper.contract.validation import NOWHERE, SourcePath
from gamekeeper.episodes.evidence import Evidence

Numbers = NDArray[Any]
Track = list[list[float | None]]
Series = tuple[NDArray[np.int64], Numbers]
"""[values] turns, and [values, ...] numbers."""

MOST_CHANGES: Final = 30_000
"""Changed cells of an episode; with more a layer isn't drawn."""
DECIMALS: Final = 4


class _SourceError(Exception):
    """A source isn't there, or has another shape than declared."""


def scene_of(evidence: Evidence) -> Scene:
    """The scene of a run: the contract's own, else that of our file of other environments."""
    environment = evidence.manifest.get("environment") or {}
    declared = evidence.contract.scene
    if not declared.is_declared:
        declared = _named(str(environment.get("name"))) or declared
    given = environment.get("kwargs") or {}
    if any(given.get(name) is not None for name in declared.unless):
        return Scene(actions=declared.actions)
    return declared


def _named(name: str) -> Scene | None:
    """The scene of our file for an environment's name, whose numbers are arguments."""
    for pattern, scene in _foreign().items():
        found = re.fullmatch(pattern, name)
        if found is not None:
            numbers = {key: int(value) for key, value in found.groupdict().items()}
            return replace(scene, arguments={**scene.arguments, **numbers})
    return None


@cache
def _foreign() -> dict[str, Scene]:
    """Scenes of environments that have no contract of their own, by a pattern of their names."""
    text = files(__package__).joinpath("assets", "scenes.toml").read_text(encoding="utf-8")
    return {name: SCENE(data, SourcePath(NOWHERE)) for name, data in tomllib.loads(text).items()}


@dataclass(frozen=True, slots=True)
class SceneSources:
    """Numbers of one episode that a scene is drawn from.

    Attributes:
        state: of the episode; None: not recorded.
        observations: by agent and path.
        infos: by agent, the turns and infos as plain JSON.
        agents: every agent of the run in order, with its role.
        over: the turn after the last action.
    """

    state: Series | None
    observations: Mapping[tuple[str, str], Series]
    infos: Mapping[str, tuple[list[int], list[Any]]]
    agents: Sequence[tuple[str, str]]
    arguments: Mapping[str, Any]
    over: int

    def series(self, source: str, agent: str) -> Series:
        """The numbers of a source.

        Raises:
            _SourceError: there are none.
        """
        kind, _, path = source.partition(".")
        found: Series | None
        if kind == "state":
            found = self.state
        elif kind == "observation":
            found = self.observations.get((agent, path.replace(".", "/")))
        else:
            found = self._info(agent, path.split("."))
        if found is None or not len(found[0]):
            raise _SourceError(source)
        return found

    def _info(self, agent: str, path: Sequence[str]) -> Series | None:
        turns, values = [], []
        for turn, info in zip(*self.infos.get(agent, ((), ())), strict=True):
            for key in path:
                info = info.get(key) if isinstance(info, Mapping) else None
            if info is not None:
                turns.append(turn)
                values.append(info)
        try:
            return np.array(turns, np.int64), np.array(values, np.float64)
        except (TypeError, ValueError):  # texts, or arrays of several shapes
            return None


def drawn_scene(scene: Scene, sources: SceneSources) -> dict[str, Any] | None:
    """The scene of an episode as the player reads it; None where its sources don't fit."""
    if scene.kind is None:
        return None
    try:
        return _drawn(scene, sources)
    except (_SourceError, IndexError):
        return None


def _drawn(scene: Scene, sources: SceneSources) -> dict[str, Any]:
    tracks: dict[str, Track] = {}
    carries: dict[str, Track] = {}
    for role, body in scene.agents.items():
        members = [name for name, own in sources.agents if role in (EVERY, own, name)]
        for place, agent in enumerate(members):
            try:
                turns, places, carried = _places(scene, sources, body, agent, place)
            except _SourceError:
                if body.source == "state":
                    raise
                continue  # an agent that never came
            if np.isnan(places).all():
                continue
            tracks[agent] = _moves(turns, places)
            if carried is not None:
                carries[agent] = _moves(turns, carried[:, None])
    if scene.agents and not tracks:
        raise _SourceError("agents")
    things: list[dict[str, Any]] = [
        {"name": name, "track": track}
        for name, body in scene.things.items()
        for track in _things(scene, sources, body, tracks)
    ]
    layers = {name: _layer(scene, sources, layer) for name, layer in scene.cells.items()}
    size = _size(scene, sources, layers)
    if scene.fixed and size is not None:
        layers = {"fixed": _fixed(scene, size), **layers}
    points = [*tracks.values(), *(each["track"] for each in things)]
    return {
        "kind": "map",
        "extent": extent_of(points, size),
        "tracks": tracks,
        "scene": {
            "grid": scene.kind == "grid",
            "down": scene.down if scene.down is not None else scene.kind == "grid",
            "size": size,
            "carries": carries,
            "things": things,
            "cells": [layer for layer in layers.values() if layer],
            "links": [list(pair) for pair in scene.links],
            "note": scene.note,
        },
    }


def _number(count: Count, scene: Scene, sources: SceneSources) -> int:
    """A number; of a name, the number of agents, or that of an argument."""
    if isinstance(count, int):
        return count
    if count == AGENTS:
        return len(sources.agents)
    value = sources.arguments.get(count, scene.arguments.get(count))
    if not isinstance(value, int):
        raise _SourceError(count)
    return value


def _start(scene: Scene, sources: SceneSources, body: Body) -> int:
    """The place of the first record that is meant."""
    first = _number(body.first, scene, sources)
    return _number(body.start, scene, sources) + first * body.each


def _places(
    scene: Scene, sources: SceneSources, body: Body, agent: str, place: int
) -> tuple[NDArray[np.int64], Numbers, Numbers | None]:
    """Turns, [values, 2] places, NaN where it isn't there, and True where it carries something."""
    turns, values = sources.series(body.source, agent)
    if body.plane is not None:
        return turns, *_cell_of(values, body, place + 1)
    flat = values.reshape(len(values), -1).astype(np.float64)
    record = _start(scene, sources, body) + (place * body.each if body.source == "state" else 0)
    found = np.zeros((len(flat), 2))
    for axis, at in enumerate((body.x, body.y)):
        if at is not None:
            found[:, axis] = flat[:, record + at] * body.scale
    if body.mirrored and scene.size is not None:
        found[:, 0] = _number(scene.size[0], scene, sources) - 1 - found[:, 0]
    if body.here is not None:
        found[flat[:, record + body.here] == 0] = np.nan
    return turns, found, None if body.carries is None else flat[:, record + body.carries] != 0


def _cell_of(values: Numbers, body: Body, number: int) -> tuple[Numbers, Numbers | None]:
    """Column and row of the cell that holds a number."""
    if values.ndim != 4 or body.plane is None:
        raise _SourceError(body.source)
    planes = values.reshape(len(values), values.shape[1], -1)
    is_here = planes[:, body.plane] == number
    cell = is_here.argmax(axis=1)
    found = np.stack([cell % values.shape[3], cell // values.shape[3]], axis=1).astype(np.float64)
    found[~is_here.any(axis=1)] = np.nan
    if body.carries is None:
        return found, None
    return found, planes[np.arange(len(cell)), body.carries, cell] != 0


def _things(
    scene: Scene, sources: SceneSources, body: Body, tracks: Mapping[str, Track]
) -> list[Track]:
    found = []
    agent = body.beside or body.by or ""
    turns, values = sources.series(body.source, agent)
    flat = values.reshape(len(values), -1).astype(np.float64)
    start = _start(scene, sources, body)
    for place in range(_number(body.count, scene, sources)):
        record = start + place * body.each
        own = np.zeros((len(flat), 2))
        for axis, at in enumerate((body.x, body.y)):
            if at is not None:
                own[:, axis] = flat[:, record + at] * body.scale
        if body.here is not None:
            own[flat[:, record + body.here] == 0] = np.nan
        if body.beside is not None:
            role = next(r for r, each in scene.agents.items() if r in _names(sources, agent))
            own += _places(scene, sources, scene.agents[role], agent, 0)[1]
            own = own.round(3)  # a thing that stands doesn't tremble by the last digits of a sum
        found.append(_moves(turns, own))
    return found


def _names(sources: SceneSources, agent: str) -> tuple[str, ...]:
    """The names by which a scene may mean an agent."""
    role = next((own for name, own in sources.agents if name == agent), None)
    if role is None:
        raise _SourceError(agent)
    return (EVERY, agent, role)


def _layer(scene: Scene, sources: SceneSources, layer: Cells) -> dict[str, Any]:
    """Cells of a layer at the first turn, and those that change later."""
    if layer.other:
        return _board(sources, layer)
    turns, values = sources.series(layer.source, "")
    if layer.plane is not None:
        values = values[:, layer.plane]
    if layer.last is not None:
        size = scene.size or ()
        columns, rows = (_number(each, scene, sources) for each in size)
        flat, length = values.reshape(len(values), -1), columns * rows
        end = flat.shape[1] - (layer.last - 1) * length
        values = flat[:, end - length : end].reshape(len(values), rows, columns)
    if values.ndim != 3:
        raise _SourceError(layer.source)
    values = np.where(np.isin(values, list(layer.values.values())), values, 0)
    return _cells(turns, values, {number: word for word, number in layer.values.items()})


def _board(sources: SceneSources, layer: Cells) -> dict[str, Any]:
    """Pieces of two agents as whoever observes sees them, until one has seen the last action.

    A number stands for an agent's piece: those of the first agent come first, from 1.
    """
    names, words = [name for name, _ in sources.agents], list(layer.values)
    if len(names) != 2 or set(words) != set(layer.other):
        raise _SourceError(layer.source)
    seen: list[tuple[int, Numbers]] = []
    for place, name in enumerate(names):
        turns, values = sources.series(layer.source, name)
        if values.ndim != 4:
            raise _SourceError(layer.source)
        board = np.zeros(values.shape[:3], np.int64)
        for owner, channels in ((place, layer.values), (1 - place, layer.other)):
            for word, channel in channels.items():
                piece = 1 + owner * len(words) + words.index(word)
                board[values[..., channel] != 0] = piece
        board = board[:, ::-1] if layer.turned and place else board
        board = board.swapaxes(1, 2) if layer.transposed else board
        seen += [
            each for each in zip(turns.tolist(), board, strict=True) if each[0] <= sources.over
        ]
    seen.sort(key=lambda each: each[0])
    every = np.array([turn for turn, _ in seen], np.int64), np.stack([board for _, board in seen])
    pieces = [(name, word) for name in names for word in words]
    drawing = _cells(*every, {k + 1: name for k, (name, _) in enumerate(pieces)})
    if drawing and len(words) > 1:
        drawing["pieces"] = {str(k + 1): word for k, (_, word) in enumerate(pieces)}
    return drawing


def _fixed(scene: Scene, size: Sequence[int]) -> dict[str, Any]:
    """Cells that never change, as a layer."""
    cells = np.zeros((1, size[1], size[0]), np.int64)
    for number, places in enumerate(scene.fixed.values(), 1):
        for x, y, *extent in places:
            columns, rows = (*extent, 1, 1)[:2]
            cells[0, y : y + rows, x : x + columns] = number
    return {**_cells(np.zeros(1, np.int64), cells, dict(enumerate(scene.fixed, 1))), "fixed": True}


def _cells(turns: NDArray[np.int64], values: Numbers, words: Mapping[int, str]) -> dict[str, Any]:
    """A layer as the player reads it; empty where too many cells change."""
    flat = values.reshape(len(values), -1)
    later, cell = np.nonzero(flat[1:] != flat[:-1])
    if len(later) > MOST_CHANGES:
        return {}
    changes = [
        [int(turns[k + 1]), int(c), int(flat[k + 1, c])]
        for k, c in zip(later.tolist(), cell.tolist(), strict=True)
    ]
    return {
        "values": {str(number): word for number, word in words.items()},
        "columns": int(values.shape[2]),
        "rows": int(values.shape[1]),
        "base": [int(x) for x in flat[0]],
        "changes": changes,
    }


def _size(
    scene: Scene, sources: SceneSources, layers: Mapping[str, Mapping[str, Any]]
) -> list[int] | None:
    if scene.size is not None:
        return [_number(each, scene, sources) for each in scene.size[:2]]
    return next(([each["columns"], each["rows"]] for each in layers.values() if each), None)


def _moves(turns: NDArray[np.int64], values: Numbers) -> Track:
    """[turn, values ...] first, and where one differs from the one before; None: not there."""
    track: Track = []
    for turn, row in zip(turns.tolist(), np.asarray(values, np.float64).tolist(), strict=True):
        own = [round(x, DECIMALS) if np.isfinite(x) else None for x in row]
        if not track or track[-1][1:] != own:
            track.append([turn, *own])
    return track


def extent_of(
    tracks: Sequence[Sequence[Sequence[float | None]]], size: Sequence[int] | None = None
) -> list[float]:
    """Least and greatest x and y of a grid of that size, or of all points of tracks."""
    if size is not None:
        return [0, max(size[0] - 1, 0), 0, max(size[1] - 1, 0)]
    points = [(p[1], p[2]) for track in tracks for p in track]
    xs = [float(x) for x, _ in points if x is not None]
    ys = [float(y) for _, y in points if y is not None]
    return [min(xs, default=0), max(xs, default=1), min(ys, default=0), max(ys, default=1)]
