"""The press: reels off a tape become record batches, and running digests of episodes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.core.arrow import cells_field, steps_batch
from gamekeeper.core.block import Block, Cells, Opener, Text, block_of, state_cells
from gamekeeper.core.canon import drop, from_json, to_json
from gamekeeper.core.digest import (
    EpisodeDigest,
    Field,
    Hasher,
    cells_digest_field,
    digest_fields,
    episode_header,
    row_digests,
)
from gamekeeper.core.layout import Column, Layout
from gamekeeper.core.tape import TURN, EpisodeEnd, EpisodeStart, Reel

LEVELS: Final = ("full", "digest")
EPISODES: Final = pa.schema(
    [
        ("episode", pa.int32()),
        ("task", pa.string()),
        ("seed", pa.int64()),
        ("since", pa.int32()),
        ("options", pa.string()),
        ("policies", pa.string()),
        ("turns", pa.int32()),
        ("end", pa.string()),
        ("error", pa.string()),
        ("endings", pa.string()),
        ("action_types", pa.string()),
        ("fingerprint", pa.string()),
        ("info_fingerprint", pa.string()),
    ]
)


@dataclass(frozen=True, slots=True)
class Pressed:
    """Record batches of one reel, in the order in which they are written; None where empty."""

    starts: pa.RecordBatch | None
    steps: pa.RecordBatch | None
    states: pa.RecordBatch | None
    timings: pa.RecordBatch | None
    ends: pa.RecordBatch | None

    def in_order(self) -> Iterator[tuple[str, pa.RecordBatch]]:
        """The streams and batches there are, so that no row is written before what it hangs on."""
        streams = ("episodes", self.starts), ("steps", self.steps), ("states", self.states)
        for name, batch in (*streams, ("timings", self.timings), ("episodes", self.ends)):
            if batch is not None:
                yield name, batch


@dataclass(slots=True)
class Press:
    """Turns reels into record batches, one after the other.

    `level` "digest" writes the digests of rows in place of their observations. `volatile` names the
    info fields that stay out of the info fingerprint.
    """

    layout: Layout
    open_large: Opener
    level: str = "full"
    volatile: Collection[str] = ()
    _open: dict[int, EpisodeDigest] = field(default_factory=dict)

    def press(self, reel: Reel) -> Pressed:
        """The batches of `reel`."""
        for start in reel.starts:
            header = episode_header(seed=start.seed, options=start.options)
            self._open[start.episode] = EpisodeDigest(header)
        steps = states = timings = None
        if reel.given:
            block = block_of(reel, self.layout, open_large=self.open_large)
            digests = row_digests(block)
            self._take_rows(block, digests)
            steps = steps_batch(block, digests=digests if self.level == "digest" else None)
        if reel.turns:
            timings = _timings(reel)
            states = self._states(reel)
        return Pressed(_starts(reel.starts), steps, states, timings, self._ends(reel.ends))

    def _take_rows(self, block: Block, digests: Any) -> None:
        bounds = [0, *(np.flatnonzero(np.diff(block.episode)) + 1).tolist(), len(block)]
        for first, last in pairwise(bounds):
            self._open[int(block.episode[first])].add_rows(digests[first:last])
        if block.info.count(None) == len(block.info):
            return
        add_infos(self._open, block, self.volatile)

    def _states(self, reel: Reel) -> pa.RecordBatch | None:
        every = [reel.turns[place::TURN] for place in (0, 1, 4, 5)]
        # turns without a state leave nothing, or a digest would depend on who shares their reel
        with_state = [marks for marks in zip(*every, strict=True) if marks[2:] != (None, None)]
        if not with_state:
            return None
        numbers, turns, payloads, odd = (list(column) for column in zip(*with_state, strict=True))
        episode, turn = np.array(numbers, np.int32), np.array(turns, np.int32)
        cells = state_cells(self.layout, payloads, self.open_large)
        digests = state_digests(turn, cells, odd)
        for number in sorted(set(episode.tolist())):
            self._open[number].add_states(digests[episode == number])
        fields = [cells_field(column, values) for column, values in cells]
        arrays = [
            pa.array(episode),
            pa.array(turn),
            *(array for _, array in fields),
            pa.array(odd, pa.string()),
        ]
        schema = [
            ("episode", pa.int32()),
            ("turn", pa.int32()),
            *(f for f, _ in fields),
            ("odd", pa.string()),
        ]
        return pa.RecordBatch.from_arrays(
            arrays, schema=pa.schema([pa.field(*f) if isinstance(f, tuple) else f for f in schema])
        )

    def _ends(self, ends: list[EpisodeEnd]) -> pa.RecordBatch | None:
        digests = [self._open.pop(end.episode) for end in ends]
        return _episodes(
            ends, ("episode", "turns", "end", "error", "endings", "action_types"),
            fingerprint=[digest.fingerprint for digest in digests],
            info_fingerprint=[digest.info_fingerprint for digest in digests],
        )  # fmt: skip


def add_infos(episodes: dict[int, EpisodeDigest], block: Block, volatile: Collection[str]) -> None:
    """Adds the infos of `block` to the info digests of their episodes."""
    bounds = [0, *(np.flatnonzero(np.diff(block.episode)) + 1).tolist(), len(block)]
    turns, infos = block.turn.tolist(), block.info
    agents: Any = block.agent  # names: who has columns adds lines of its own
    for first, last in pairwise(bounds):
        texts = infos[first:last]
        if volatile:
            texts = [_without(info, volatile) for info in texts]
        rows = zip(turns[first:last], agents[first:last], texts, strict=True)
        lines = [f"{turn}\0{agent}\0{info}\n" for turn, agent, info in rows if info is not None]
        episodes[int(block.episode[first])].add_infos(lines)


def state_digests(
    turn: Any, cells: list[tuple[Column, Cells]], odd: list[Any], *, hasher: Hasher | None = None
) -> Any:
    """The digest of the state at every turn, [turns, 16]."""
    fields = [Field("turn", "<i4", (), turn.view(np.uint8).reshape(len(turn), 4))]
    fields += [
        cells_digest_field(column.tag, column.leaf.dtype, column.leaf.shape, values)
        for column, values in cells
    ]
    fields.append(cells_digest_field("odd", "", (), Text(odd)))
    return digest_fields(fields, len(turn), hasher=hasher)


def _without(info: str | None, volatile: Collection[str]) -> str | None:
    value = None if info is None else from_json(info)
    return to_json(drop(value, volatile)) if isinstance(value, dict) else info


def _starts(starts: list[EpisodeStart]) -> pa.RecordBatch | None:
    return _episodes(starts, ("episode", "task", "seed", "since", "options", "policies"))


def _episodes(
    events: Sequence[EpisodeStart | EpisodeEnd], names: tuple[str, ...], **columns: list[Any]
) -> pa.RecordBatch | None:
    """What `events` say of their episodes under `names`, and `columns`; the rest is null."""
    if not events:
        return None
    columns |= {name: list(map(attrgetter(name), events)) for name in names}
    arrays = [
        pa.array(columns[field.name], field.type)
        if field.name in columns
        else pa.nulls(len(events), field.type)
        for field in EPISODES
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=EPISODES)


def _timings(reel: Reel) -> pa.RecordBatch | None:
    wall_ns = reel.turns[3::TURN]
    crossed = [place for place, wall in enumerate(wall_ns) if wall is not None]
    if not crossed:
        return None
    columns = reel.turns[0::TURN], reel.turns[1::TURN], wall_ns
    kinds = pa.int32(), pa.int32(), pa.int64()
    arrays = [
        pa.array([c[place] for place in crossed], kind)
        for c, kind in zip(columns, kinds, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, ["episode", "turn", "wall_ns"])
