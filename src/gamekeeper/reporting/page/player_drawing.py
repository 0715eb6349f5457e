"""Drawing of an episode in the player: pictures, positions on a map, or cells in shades.

The first that exists of: recorded frames; the declared scene; positions in infos, observations or
the state; pictures that agents observed; state and observations in shades.
"""

from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.contract.scene import Scene
from gamekeeper.episodes.arrow import cells_of
from gamekeeper.episodes.block import Raw
from gamekeeper.episodes.episode import MASK, Episode
from gamekeeper.episodes.layout import Column, value_columns
from gamekeeper.reporting.page.packed_values import data_url, is_picture, plain_of_text, png
from gamekeeper.reporting.page.scene_drawing import SceneSources, Series, drawn_scene, extent_of

POSITIONS: Final = ("position", "pos", "xy", "location", "coordinates", "positions", "locations")
"""Fields of one or two numbers that are an agent's position."""
MOST_BYTES: Final = 160_000
"""Limit of an episode's shades, or of its pictures' pixels divided by 32; else turns are left out.
Shades of floats hardly compress, pictures do."""
PICTURE_RATIO: Final = 32
MOST_SIDE: Final = 64
"""Elements along one side of an array in shades; of larger ones every second is shown, and so on.
"""
MOST_PARTS: Final = 16
"""Most agents whose observations are drawn; with more only the state, or the first ones."""
DIGEST: Final = "the run holds no observations"
NOTHING: Final = "the run has no data that can be drawn"

Numbers = NDArray[Any]


@dataclass(frozen=True, slots=True)
class DrawnLeaf:
    """Values of one leaf of an agent's observations, or of the state, over an episode.

    Attributes:
        name: the agent, or `state`.
        turns: [values] turn of each value.
        values: [values, ...].
    """

    name: str
    path: str
    turns: NDArray[np.int64]
    values: Numbers

    @property
    def field(self) -> str:
        """The last part of its path."""
        return self.path.rpartition("/")[2].lower()


@dataclass(frozen=True, slots=True)
class DeclaredScene:
    """A scene, and what it needs to know of the run.

    Attributes:
        scene: of the contract, or of our file of other environments.
        agents: every agent in order, with its role.
    """

    scene: Scene
    agents: Sequence[tuple[str, str]]
    arguments: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Drawing:
    """Frames that were rendered while an episode was recorded.

    Attributes:
        shown: by turn, the data URL of a picture, or a text.
        is_text: True if they are texts.
    """

    shown: Mapping[int, str]
    is_text: bool = False


def drawn(
    episode: Episode,
    agents: Sequence[str],
    *,
    frames: Drawing | None = None,
    infos: Sequence[Any] | None = None,
    declared: DeclaredScene | None = None,
) -> tuple[dict[str, Any] | None, str]:
    """Makes the drawing of an episode, and names its source, or the reason why there is none.

    Args:
        agents: every agent of the run, in the order of `possible_agents`.
        infos: of every row as plain JSON, where they were read already.
        declared: the scene of the run.
    """
    if frames is not None and frames.shown:
        at = sorted(frames.shown)
        kind, held = ("text", "texts") if frames.is_text else ("frames", "images")
        return {"kind": kind, held: [frames.shown[k] for k in at], "at": at}, "recorded frames"
    leaves = [*_state_leaves(episode), *_observed(episode, agents)]
    infos = infos if infos is not None else _infos(episode)
    if declared is not None:
        sources = SceneSources(
            *_by_source(episode, leaves, infos),
            declared.agents,
            declared.arguments,
            over=_last_action(episode) + 1,
        )
        found = drawn_scene(declared.scene, sources)
        if found is not None:
            return found, "the declared scene"
    tracks, source = _tracks(episode, leaves, agents, infos)
    if tracks:
        return {"kind": "map", "extent": extent_of(list(tracks.values())), "tracks": tracks}, source
    pictures = [each for each in leaves if is_picture(each.values[0]) and each.name != "state"]
    if pictures:
        return _montage(pictures)
    if leaves:
        return _cells(leaves)
    return None, DIGEST if episode.is_digest else NOTHING


# -- leaves


def _state_leaves(episode: Episode) -> Iterator[DrawnLeaf]:
    if episode.states is not None and episode.states.num_rows:
        every = np.ones(episode.states.num_rows, np.bool_)
        for column in _numeric(episode.states, "state"):
            raw = _raw(column, episode.states)
            yield from _leaf("state", column, raw, episode.states, every)


def _observed(episode: Episode, agents: Sequence[str]) -> Iterator[DrawnLeaf]:
    """Observations of every agent, leaf by leaf; masks are shown elsewhere."""
    steps = episode.steps
    columns = [each for each in _numeric(steps, "obs") if each.leaf.path != MASK]
    if not columns or not steps.num_rows:
        return
    raws = [_raw(column, steps) for column in columns]
    names = np.asarray(steps["agent"].to_pylist(), object)
    for agent in agents:
        rows = names == agent
        if rows.any():
            for column, raw in zip(columns, raws, strict=True):
                yield from _leaf(agent, column, raw, steps, rows)


def _numeric(table: pa.Table, kind: str) -> list[Column]:
    columns = value_columns(table.schema, kind)
    return [column for column in columns if column.leaf.kind not in ("text", "json")]


def _leaf(
    name: str, column: Column, raw: Raw, table: pa.Table, rows: NDArray[np.bool_]
) -> Iterator[DrawnLeaf]:
    rows = rows & raw.valid
    if rows.any() and raw.values.shape[1]:
        dtype = np.dtype("<i8" if column.leaf.kind == "int" else column.leaf.dtype)
        values = np.ascontiguousarray(raw.values[rows]).view(dtype)
        values = values.reshape(int(rows.sum()), *(column.leaf.shape or (1,)))
        yield DrawnLeaf(name, column.leaf.path, table["turn"].to_numpy()[rows], values)


def _raw(column: Column, table: pa.Table) -> Raw:
    raw = cells_of(column, table[column.name])
    assert isinstance(raw, Raw)  # for the type checker: texts have no cells
    return raw


# -- a map


def _by_source(
    episode: Episode, leaves: Sequence[DrawnLeaf], infos: Sequence[Any]
) -> tuple[Series | None, dict[tuple[str, str], Series], dict[str, tuple[list[int], list[Any]]]]:
    """The state, observations by agent and path, and infos by agent."""
    states = [each for each in leaves if each.name == "state" and not each.path]
    seen = {(each.name, each.path): (each.turns, each.values) for each in leaves}
    by_agent: dict[str, tuple[list[int], list[Any]]] = {}
    names, turns = episode.steps["agent"].to_pylist(), episode.steps["turn"].to_pylist()
    for agent, turn, info in zip(names, turns, infos, strict=True):
        own = by_agent.setdefault(agent, ([], []))
        own[0].append(turn)
        own[1].append(info)
    return (states[0].turns, states[0].values) if states else None, seen, by_agent


def _last_action(episode: Episode) -> int:
    """The last turn in which an agent that had not ended acted; -1 without one."""
    steps = episode.steps
    ended = pc.or_(*(pc.fill_null(steps[name], False) for name in ("terminated", "truncated")))
    turns = steps["turn"].filter(pc.and_(pc.is_valid(steps["order"]), pc.invert(ended)))
    return int(turns[-1].as_py()) if len(turns) else -1


def _tracks(
    episode: Episode, leaves: Iterable[DrawnLeaf], agents: Sequence[str], infos: Sequence[Any]
) -> tuple[dict[str, list[list[float]]], str]:
    """By agent [turn, x, y] of each move, and the source of the positions."""
    tracks = _in_infos(episode, infos, agents)
    if tracks:
        return tracks, "positions in infos"
    for leaf in leaves:
        if leaf.field not in POSITIONS or leaf.values.dtype.kind not in "iuf":
            continue
        if leaf.name != "state" and leaf.values.shape[1:] == (2,):
            tracks[leaf.name] = _moves(leaf.turns.tolist(), leaf.values.tolist())
        elif leaf.name == "state" and leaf.values.shape[1:] == (len(agents), 2):
            for place, agent in enumerate(agents):
                tracks[agent] = _moves(leaf.turns.tolist(), leaf.values[:, place].tolist())
            return tracks, "positions in the state"
    return tracks, "positions in observations"


def _infos(episode: Episode) -> list[Any]:
    texts = episode.steps["info"].to_pylist()
    return [None if text is None else plain_of_text(text) for text in texts]


def _in_infos(
    episode: Episode, infos: Sequence[Any], agents: Sequence[str]
) -> dict[str, list[list[float]]]:
    """Positions in infos; where the first info has none, the others aren't read.

    A position of one number is drawn in a row of its agent's own, the same in every episode.
    """
    steps = episode.steps
    found: dict[str, tuple[list[int], list[Any]]] = {}
    rows = zip(steps["agent"].to_pylist(), steps["turn"].to_pylist(), infos, strict=True)
    for agent, turn, info in rows:
        if info is None:
            continue
        place = _position(info)
        if place is not None:
            turns, places = found.setdefault(agent, ([], []))
            turns.append(turn)
            places.append(place)
        elif not found:
            return {}
    order = list(dict.fromkeys([*agents, *found]))
    return {
        agent: _moves(
            turns, [each if len(each) == 2 else [each[0], order.index(agent)] for each in places]
        )
        for agent, (turns, places) in found.items()
    }


def _position(info: Any) -> list[float] | None:
    """One or two numbers under the name of a position."""
    if not isinstance(info, Mapping):
        return None
    for key, value in info.items():
        if key.lower() in POSITIONS:
            place = value if isinstance(value, list) else [value]
            if len(place) in (1, 2) and all(type(x) in (int, float) for x in place):
                return list(place)
    return None


def _moves(turns: Sequence[int], places: Sequence[Sequence[float]]) -> list[list[float]]:
    """The first place, and each that differs from the one before."""
    track: list[list[float]] = []
    for turn, (x, y) in zip(turns, places, strict=True):
        x, y = float(f"{x:.5g}"), float(f"{y:.5g}")
        if np.isfinite(x) and np.isfinite(y) and (not track or track[-1][1:] != [x, y]):
            track.append([turn, x, y])
    return track


# -- pictures


def _montage(leaves: Sequence[DrawnLeaf]) -> tuple[dict[str, Any], str]:
    """Pictures that agents observed, side by side, the latest of each."""
    shown = _one_each(leaves)[:MOST_PARTS]
    views = [_small(leaf.values) for leaf in shown]
    turns = sorted({turn for leaf in shown for turn in leaf.turns.tolist()})
    size = sum(view[0].size for view in views)
    turns = turns[:: max(1, -(-len(turns) * size // (MOST_BYTES * PICTURE_RATIO)))]
    images = []
    for turn in turns:
        latest = (
            view[max(int(np.searchsorted(leaf.turns, turn, "right")) - 1, 0)]
            for leaf, view in zip(shown, views, strict=True)
        )
        images.append(data_url(png(_side_by_side(list(latest)))))
    names = ", ".join(leaf.name for leaf in shown)
    return {"kind": "frames", "images": images, "at": turns}, f"observations of {names}"


def _one_each(leaves: Sequence[DrawnLeaf]) -> list[DrawnLeaf]:
    """The largest leaf of every agent."""
    best: dict[str, DrawnLeaf] = {}
    for leaf in leaves:
        if leaf.name not in best or leaf.values[0].size > best[leaf.name].values[0].size:
            best[leaf.name] = leaf
    return list(best.values())


def _small(values: Numbers) -> Numbers:
    """Thins arrays out until no side but a picture's channels is longer than `MOST_SIDE`, or twice.

    Pictures may be twice as long, arrays of one side as long as a square one has elements.
    """
    most = 2 * MOST_SIDE if is_picture(values[0]) else MOST_SIDE
    sides = values.ndim - 2 if is_picture(values[0]) else values.ndim - 1
    longest = most * most if sides == 1 else most
    steps = [max(1, -(-length // longest)) for length in values.shape[1 : 1 + sides]]
    return values[(slice(None), *(slice(None, None, step) for step in steps))]


def _side_by_side(views: Sequence[Numbers]) -> NDArray[np.uint8]:
    height = max(view.shape[0] for view in views)
    columns = []
    for view in views:
        column = np.full((height, view.shape[1] + 2, 3), 127, np.uint8)  # a grey edge to the right
        column[: view.shape[0], : view.shape[1]] = view[..., :3]  # grey pictures are broadcast
        columns.append(column)
    return np.concatenate(columns, axis=1)


# -- shades


def _cells(leaves: Sequence[DrawnLeaf]) -> tuple[dict[str, Any], str]:
    shown = _one_each([leaf for leaf in leaves if leaf.values.dtype.kind in "biuf"])
    if not shown:
        return {"kind": "cells", "parts": []}, NOTHING
    has_state = shown[0].name == "state"
    sources = [f"state{_of(shown[0])}"] if has_state else []
    if has_state and len(shown) > MOST_PARTS:
        shown = shown[:1]
    elif len(shown) > has_state:
        sources.append(f"observations{_of(shown[-1])}")
    shown = shown[:MOST_PARTS]
    values = [_small(leaf.values) for leaf in shown]
    step = max(1, -(-sum(each.size for each in values) // MOST_BYTES))
    parts = [
        _part(leaf, each[::step], leaf.turns[::step])
        for leaf, each in zip(shown, values, strict=True)
    ]
    note = f", every {step}th turn" if step > 1 else ""
    return {"kind": "cells", "parts": parts}, " and ".join(sources) + note


def _of(leaf: DrawnLeaf) -> str:
    return f" ({leaf.path})" if leaf.path else ""


def _part(leaf: DrawnLeaf, values: Numbers, turns: NDArray[np.int64]) -> dict[str, Any]:
    """Values as shades from 0 (the lowest of the episode) to 255 (the highest)."""
    numbers = values.astype(np.float64)
    finite = np.isfinite(numbers)
    low = float(numbers.min(initial=np.inf, where=finite))
    high = float(numbers.max(initial=-np.inf, where=finite))
    if not finite.any():
        low = high = 0.0
    scale = 255 / (high - low) if high > low and np.isfinite(high - low) else 0.0
    numbers = np.where(finite, numbers, low)
    shades = np.rint((numbers - low) * scale).astype(np.uint8)
    return {
        "name": leaf.name,
        "shape": list(values.shape[1:]),
        "low": float(f"{low:.6g}"),
        "high": float(f"{high:.6g}"),
        "turns": turns.tolist(),
        "values": b64encode(shades.tobytes()).decode("ascii"),
    }
