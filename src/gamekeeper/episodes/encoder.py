"""The encoder: buffered turns become record batches, and running digests of episodes."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import starmap
from operator import attrgetter
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.actions_level import KeptDigest, add_kept, kept_block, kept_rows
from gamekeeper.episodes.arrow import names_array, states_batch, steps_batch
from gamekeeper.episodes.block import Block, Columns, Opener, States, columns_of, states_of
from gamekeeper.episodes.buffer import TURN, BufferedTurns, EpisodeEnd, EpisodeStart
from gamekeeper.episodes.canonical import without
from gamekeeper.episodes.digest import (
    EpisodeDigest,
    Hasher,
    episode_header,
    row_digests,
    state_digests,
)
from gamekeeper.episodes.layout import Layout

LEVELS: Final = ("full", "digest", "actions")
KEPT: Final = "actions"
TIMINGS: Final = pa.schema(
    [
        ("episode", pa.int32()),
        ("turn", pa.int32()),
        ("wall_ns", pa.int64()),
        ("observed_ns", pa.int64()),
        ("acted_ns", pa.int64()),
    ]
)
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
        ("opening", pa.string()),
    ]
)


@dataclass(frozen=True, slots=True)
class Encoded:
    """Record batches of buffered turns, in the order in which they are written; None if empty.

    `digests`: of the rows of `steps`, [rows, 16].
    """

    starts: pa.RecordBatch | None
    steps: pa.RecordBatch | None
    states: pa.RecordBatch | None
    timings: pa.RecordBatch | None
    ends: pa.RecordBatch | None
    digests: Any | None = None

    def in_order(self) -> Iterator[tuple[str, pa.RecordBatch]]:
        """The streams and batches there are, so that no row is written before what it hangs on."""
        streams = ("episodes", self.starts), ("agent_steps", self.steps), ("states", self.states)
        for name, batch in (*streams, ("timings", self.timings), ("episodes", self.ends)):
            if batch is not None:
                yield name, batch


@dataclass(slots=True)
class Encoder:
    """Turns buffered turns into record batches, one after the other.

    `level` "digest" writes the digests of rows in place of their observations, "actions" only what
    `actions_level` keeps. `volatile` names the info fields that stay out of the info fingerprint.
    `hasher` is a faster way to hash rows. `prints`: the level of the episodes' fingerprints where
    it is another one; of whole rows both can be computed.
    """

    layout: Layout
    open_large: Opener
    level: str = "full"
    volatile: Collection[str] = ()
    hasher: Hasher | None = None
    prints: str | None = None
    _open: dict[int, Any] = field(default_factory=dict)

    def encode_turns(self, buffered: BufferedTurns) -> Encoded:
        """The batches of `buffered`."""
        if self.level != KEPT:
            columns = columns_of(buffered, self.layout, open_large=self.open_large)
            return replace(self.encode_columns(columns), timings=_timings(buffered))
        states = states_of(buffered, self.layout, self.open_large)
        rows = kept_rows(
            buffered, self.layout, states, open_large=self.open_large, hasher=self.hasher
        )
        return self.encode_columns(Columns(buffered.starts, rows, None, buffered.ends))

    def encode_columns(self, columns: Columns) -> Encoded:
        """The batches of what is in columns already; without timings."""
        for start in columns.starts:
            header = episode_header(seed=start.seed, options=start.options)
            self._open[start.episode] = self._digest(header)
        block, states, steps, digests = columns.rows, columns.states, None, None
        encoded_states = None
        if block is not None and (self.prints or self.level) == KEPT:
            kept = kept_block(block, states, hasher=self.hasher)
            add_kept(self._open, kept, by_episode)
            steps = steps_batch(kept if self.level == KEPT else block)
        elif block is not None:
            # Rows are hashed all at once, then handed to their episodes: a chunk may hold the end
            # of one and the start of others; an episode's digest goes on over chunks (`_open`).
            digests = row_digests(block, hasher=self.hasher)
            for number, rows in by_episode(block.episode):
                self._open[number].add_rows(digests[rows])
            if columns.steady_infos is None:
                add_infos(self._open, block, self.volatile)
            else:
                _add_lines(self._open, block, columns.steady_infos)
            steps = steps_batch(block, digests=digests if self.level == "digest" else None)
        if states is not None and self.level != KEPT:  # there the witnesses cover them
            if self.prints != KEPT:
                self._add_states(states)
            encoded_states = states_batch(states)
        ended = [self._open.pop(end.episode) for end in columns.ends]
        return Encoded(
            starts=_episodes(
                columns.starts,
                ("episode", "task", "seed", "since", "options", "policies", "opening"),
            ),
            steps=steps,
            states=encoded_states,
            timings=None,
            ends=_episodes(
                columns.ends,
                ("episode", "turns", "end", "error", "endings", "action_types", "opening"),
                fingerprint=[digest.fingerprint for digest in ended],
                info_fingerprint=[digest.info_fingerprint for digest in ended],
            ),
            digests=digests,
        )

    def begin(self, episodes: Collection[int]) -> None:
        """Takes episodes whose first rows are elsewhere; their fingerprints say nothing."""
        self._open |= {number: self._digest("") for number in episodes}

    def _digest(self, header: str) -> Any:
        return (KeptDigest if (self.prints or self.level) == KEPT else EpisodeDigest)(header)

    def _add_states(self, states: States) -> None:
        digests = state_digests(states, hasher=self.hasher)
        for number, turns in by_episode(states.episode):
            self._open[number].add_states(digests[turns])


def add_infos(episodes: dict[int, EpisodeDigest], block: Block, volatile: Collection[str]) -> None:
    """Adds the infos of `block` to the info digests of their episodes."""
    infos = block.info
    if infos is None:
        return
    if not isinstance(infos, pa.Array):
        if volatile:
            infos = [without(info, volatile) for info in infos]
        infos = pa.array(infos, pa.string())
    if infos.null_count < len(infos):
        _add_lines(episodes, block, infos)


def _add_lines(episodes: dict[int, EpisodeDigest], block: Block, infos: pa.Array) -> None:
    """Adds a line for each info that there is: turn, agent, text."""
    turn, agent = pc.cast(pa.array(block.turn), pa.string()), names_array(block.agent)
    # a row without an info gives a null, which takes no bytes: the lines of an episode adjoin
    lines = pc.binary_join_element_wise(turn, "\0", agent, "\0", infos, "\n", "")
    # Arrow's own buffers are read: the lines of rows i to j are the bytes offsets[i] to offsets[j],
    # so that an episode takes one slice, and no text becomes a Python object.
    offsets = np.frombuffer(lines.buffers()[1], np.int32)
    data = memoryview(lines.buffers()[2] or b"")
    for number, rows in by_episode(block.episode):
        episodes[number].add_infos(data[offsets[rows.start] : offsets[rows.stop]])


def by_episode(episode: Any) -> Iterator[tuple[int, slice]]:
    """Each episode in a sorted column, and its rows there."""
    firsts = np.flatnonzero(np.diff(episode, prepend=-1)).tolist()  # no episode is numbered -1
    numbers = episode[firsts].tolist()
    bounds = zip(firsts, [*firsts[1:], len(episode)], strict=True)
    return zip(numbers, starmap(slice, bounds), strict=True)


def _episodes(
    events: Sequence[EpisodeStart | EpisodeEnd], names: tuple[str, ...], **columns: list[Any]
) -> pa.RecordBatch | None:
    """Rows of episodes: attributes of `events` under `names`, and `columns`; the rest is null."""
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


def _timings(buffered: BufferedTurns) -> pa.RecordBatch | None:
    wall_ns = buffered.turns[3::TURN]
    stepped = [place for place, wall in enumerate(wall_ns) if wall is not None]
    if not stepped:
        return None
    columns = (buffered.turns[place::TURN] for place in (0, 1, 3, 4, 5))
    arrays = [
        pa.array([column[place] for place in stepped], field.type)
        for column, field in zip(columns, TIMINGS, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=TIMINGS)
