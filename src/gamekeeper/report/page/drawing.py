"""What the player draws of an episode: pictures, places on a map, or cells in shades.

The first of these that there is: frames that were recorded; positions that infos, observations or
the state name; pictures that agents observed; the state and the observations in shades.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gamekeeper.core.arrow import cells_of
from gamekeeper.core.block import Raw
from gamekeeper.core.layout import Column
from gamekeeper.core.leaf_columns import value_columns
from gamekeeper.core.trace import MASK, Trace
from gamekeeper.report.page.plain import plain_of_text
from gamekeeper.report.page.png import data_url, is_picture, png

POSITIONS: Final = ("position", "pos", "xy", "location", "coordinates", "positions", "locations")
"""Fields of one or two numbers that say where an agent is."""
MOST_BYTES: Final = 160_000
"""Of shades, or of pictures' pixels divided by 32, that an episode draws; else turns are left out.
Shades of floats hardly compress, pictures do."""
PICTURE_RATIO: Final = 32
MOST_SIDE: Final = 64
"""Elements along one side of an array in shades; of larger ones every second is shown, and so on.
"""
MOST_PARTS: Final = 16
"""Agents whose observations are drawn; of more only the state, or the first ones."""
DIGEST: Final = "the run keeps only digests of observations"
NOTHING: Final = "nothing in the evidence can be drawn"

Numbers = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Leaf:
    """The values of one agent's one leaf over an episode, or of the state's.

    Attributes:
        name: the agent, or `state`.
        path: of the leaf.
        turns: [values] when it was given.
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
class Film:
    """What was rendered while an episode was recorded.

    Attributes:
        shown: by turn, the address that holds a picture, or letters.
        is_text: they are letters.
    """

    shown: Mapping[int, str]
    is_text: bool = False


def drawn(
    trace: Trace,
    agents: Sequence[str],
    *,
    frames: Film | None = None,
    infos: Sequence[Any] | None = None,
) -> tuple[dict[str, Any] | None, str]:
    """What is drawn of an episode, and in words where it comes from, or why it is nothing.

    Args:
        trace: the episode.
        agents: every agent of the run, in the order of its seats.
        frames: what was rendered meanwhile.
        infos: of every row as plain JSON, where they were read already.
    """
    if frames is not None and frames.shown:
        at = sorted(frames.shown)
        kind, held = ("text", "texts") if frames.is_text else ("frames", "images")
        return {"kind": kind, held: [frames.shown[k] for k in at], "at": at}, "recorded frames"
    leaves = [*_state_leaves(trace), *_observed(trace, agents)]
    tracks, source = _tracks(trace, leaves, agents, infos)
    if tracks:
        return {"kind": "map", "extent": _extent(tracks), "tracks": tracks}, source
    pictures = [each for each in leaves if is_picture(each.values[0]) and each.name != "state"]
    if pictures:
        return _montage(pictures)
    if leaves:
        return _cells(leaves)
    return None, DIGEST if trace.is_digest else NOTHING


# -- what there is


def _state_leaves(trace: Trace) -> Iterator[Leaf]:
    if trace.states is not None and trace.states.num_rows:
        every = np.ones(trace.states.num_rows, np.bool_)
        for column in _numeric(trace.states, "state"):
            raw = _raw(column, trace.states)
            yield from _leaf("state", column, raw, trace.states, every)


def _observed(trace: Trace, agents: Sequence[str]) -> Iterator[Leaf]:
    """Of every agent its observations, leaf by leaf; masks are shown elsewhere."""
    steps = trace.steps
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
) -> Iterator[Leaf]:
    rows = rows & raw.valid
    if rows.any() and raw.values.shape[1]:
        dtype = np.dtype("<i8" if column.leaf.kind == "int" else column.leaf.dtype)
        values = np.ascontiguousarray(raw.values[rows]).view(dtype)
        values = values.reshape(int(rows.sum()), *(column.leaf.shape or (1,)))
        yield Leaf(name, column.leaf.path, table["turn"].to_numpy()[rows], values)


def _raw(column: Column, table: pa.Table) -> Raw:
    raw = cells_of(column, table[column.name])
    assert isinstance(raw, Raw)  # for the type checker: texts have no cells
    return raw


# -- a map


def _tracks(
    trace: Trace, leaves: Iterable[Leaf], agents: Sequence[str], infos: Sequence[Any] | None
) -> tuple[dict[str, list[list[float]]], str]:
    """By agent [turn, x, y] where it moved, and where that stands."""
    tracks = _told(trace, infos if infos is not None else _infos(trace))
    if tracks:
        return tracks, "positions told in infos"
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


def _infos(trace: Trace) -> list[Any]:
    texts = trace.steps["info"].to_pylist()
    return [None if text is None else plain_of_text(text) for text in texts]


def _told(trace: Trace, infos: Sequence[Any]) -> dict[str, list[list[float]]]:
    """Positions in infos; where the first info has none, nobody looks further."""
    steps = trace.steps
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
    order = list(found)
    return {
        agent: _moves(turns, [each if len(each) == 2 else [each[0], order.index(agent)]
                              for each in places])
        for agent, (turns, places) in found.items()
    }  # fmt: skip


def _position(info: Any) -> list[float] | None:
    """Two numbers under a name that says where it is, or one: a place on a line."""
    if not isinstance(info, Mapping):
        return None
    for key, value in info.items():
        if key.lower() in POSITIONS:
            place = value if isinstance(value, list) else [value]
            if len(place) in (1, 2) and all(type(x) in (int, float) for x in place):
                return list(place)
    return None


def _moves(turns: Sequence[int], places: Sequence[Sequence[float]]) -> list[list[float]]:
    """The first place, and each that isn't the one before."""
    track: list[list[float]] = []
    for turn, (x, y) in zip(turns, places, strict=True):
        x, y = float(f"{x:.5g}"), float(f"{y:.5g}")
        if np.isfinite(x) and np.isfinite(y) and (not track or track[-1][1:] != [x, y]):
            track.append([turn, x, y])
    return track


def _extent(tracks: Mapping[str, Sequence[Sequence[float]]]) -> list[float]:
    points = [point for track in tracks.values() for point in track]
    xs, ys = [point[1] for point in points], [point[2] for point in points]
    return [min(xs, default=0), max(xs, default=1), min(ys, default=0), max(ys, default=1)]


# -- pictures


def _montage(leaves: Sequence[Leaf]) -> tuple[dict[str, Any], str]:
    """What agents saw, side by side, each at its latest."""
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
    seen = ", ".join(leaf.name for leaf in shown)
    return {"kind": "frames", "images": images, "at": turns}, f"what was observed by {seen}"


def _one_each(leaves: Sequence[Leaf]) -> list[Leaf]:
    """Of every agent the largest leaf."""
    best: dict[str, Leaf] = {}
    for leaf in leaves:
        if leaf.name not in best or leaf.values[0].size > best[leaf.name].values[0].size:
            best[leaf.name] = leaf
    return list(best.values())


def _small(values: Numbers) -> Numbers:
    """Arrays with no side but a picture's channels longer than `MOST_SIDE`, or twice that."""
    most = 2 * MOST_SIDE if is_picture(values[0]) else MOST_SIDE
    sides = values.ndim - 2 if is_picture(values[0]) else values.ndim - 1
    longest = most * most if sides == 1 else most
    steps = [max(1, -(-length // longest)) for length in values.shape[1 : 1 + sides]]
    return values[(slice(None), *(slice(None, None, step) for step in steps))]


def _side_by_side(views: Sequence[Numbers]) -> NDArray[np.uint8]:
    height = max(view.shape[0] for view in views)
    strips = []
    for view in views:
        rgb = np.broadcast_to(view[..., :3], (*view.shape[:2], 3))
        strip = np.full((height, view.shape[1] + 2, 3), 127, np.uint8)
        strip[: view.shape[0], : view.shape[1]] = rgb
        strips.append(strip)
    return np.concatenate(strips, axis=1)


# -- shades


def _cells(leaves: Sequence[Leaf]) -> tuple[dict[str, Any], str]:
    shown = _one_each([leaf for leaf in leaves if leaf.values.dtype.kind in "biuf"])
    if not shown:
        return {"kind": "cells", "parts": []}, NOTHING
    has_state = shown[0].name == "state"
    told = [f"state{_of(shown[0])}"] if has_state else []
    if has_state and len(shown) > MOST_PARTS:
        shown = shown[:1]
    elif len(shown) > has_state:
        told.append(f"observations{_of(shown[-1])}")
    shown = shown[:MOST_PARTS]
    values = [_small(leaf.values) for leaf in shown]
    step = max(1, -(-sum(each.size for each in values) // MOST_BYTES))
    parts = [
        _part(leaf, each[::step], leaf.turns[::step])
        for leaf, each in zip(shown, values, strict=True)
    ]
    note = f", every {step}th time" if step > 1 else ""
    return {"kind": "cells", "parts": parts}, " and ".join(told) + note


def _of(leaf: Leaf) -> str:
    return f" ({leaf.path})" if leaf.path else ""


def _part(leaf: Leaf, values: Numbers, turns: NDArray[np.int64]) -> dict[str, Any]:
    """Values as shades from 0 (the least that was seen) to 255 (the most)."""
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
