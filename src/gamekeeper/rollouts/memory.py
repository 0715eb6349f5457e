"""A sink that keeps evidence in memory."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.contract import Contract
from gamekeeper.episodes.block import most_rows
from gamekeeper.episodes.buffer import TURN, Buffer, take
from gamekeeper.episodes.encoder import EPISODES, Encoded, Encoder
from gamekeeper.episodes.episode import Episode
from gamekeeper.episodes.evidence import NO_STEPS, Evidence, manifest_of, spaces_of
from gamekeeper.episodes.layout import Layout, spaces_json
from gamekeeper.episodes.tables import MemoryTables, merged_episodes, table_of
from gamekeeper.interface.packing import Rings

MOST_TURNS: Final = 4096  # on the buffer before they become columns


@dataclass(slots=True)
class MemorySink:
    """Keeps what a game puts on the buffer as columns in memory; `evidence` closes the books.

    There is no second thread, so large observations are copied at once. `prints`: the level of the
    episodes' fingerprints, as in `Encoder`.
    """

    terms: tuple[str, ...] = ()
    volatile: Collection[str] = ()
    buffer: Buffer = field(default_factory=Buffer)
    layout: Layout = field(init=False)
    rings: Rings | None = None
    prints: str | None = None
    frames: dict[tuple[int, int], Any] = field(default_factory=dict)
    _encoder: Encoder = field(init=False)
    _batches: dict[str, list[pa.RecordBatch]] = field(default_factory=dict)
    _digests: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.layout = Layout(self.terms)
        self._encoder = Encoder(self.layout, _never, volatile=self.volatile, prints=self.prints)

    def keep_up(self) -> None:
        """Turns a long buffer into columns."""
        if len(self.buffer.turns) >= MOST_TURNS * TURN:
            self._drain()

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Keeps a copy of a frame."""
        self.frames[episode, turn] = frame.copy() if hasattr(frame, "copy") else frame

    def episode(self) -> Episode:
        """The one episode that was played, with no run around it; handed over, not copied."""
        self._drain()
        batches, self._batches = self._batches, {}
        header: dict[str, Any] = dict.fromkeys(EPISODES.names)
        for row in (row for batch in batches["episodes"] for row in batch.to_pylist()):
            header |= {name: value for name, value in row.items() if value is not None}
        tables = {name: table_of(parts) for name, parts in batches.items() if name != "episodes"}
        digests, self._digests = self._digests, []
        state = self.layout.state
        return Episode(
            episode=header["episode"],
            header=header,
            steps=tables.get("agent_steps", NO_STEPS.empty_table()),
            states=tables.get("states"),
            spaces=spaces_of(spaces_json(self.layout)),
            state_codec=None if state is None else state.codec,
            _cache={"digests": np.concatenate(digests)} if digests else {},
        )

    def evidence(
        self,
        environment: Mapping[str, Any],
        *,
        contract: Contract | None = None,
        run_seed: int | None = None,
    ) -> Evidence:
        """The evidence of all episodes so far; what was kept is handed over, not copied."""
        self._drain()
        batches, self._batches = self._batches, {}
        episodes = merged_episodes(batches.get("episodes", []))
        return Evidence(
            manifest=manifest_of(
                environment=environment,
                layout=self.layout,
                contract=contract,
                level="full",
                run_seed=run_seed,
                episodes=episodes,
            ),
            tables=MemoryTables(
                {name: table_of(parts) for name, parts in batches.items() if name != "episodes"}
                | {"episodes": episodes}
            ),
        )

    def taken(self) -> Mapping[str, pa.Table]:
        """The rows of all whole turns since the last call, by stream; they are handed over."""
        self._drain()
        streams = [name for name in self._batches if name != "episodes"]
        return {name: table_of(self._batches.pop(name)) for name in streams}

    def _drain(self) -> None:
        rows = most_rows([*self.layout.columns("obs"), *self.layout.columns("action")])
        while (buffered := take(self.buffer, most=MOST_TURNS, most_rows=rows)) is not None:
            self._keep(self._encoder.encode_turns(buffered))

    def _keep(self, encoded: Encoded) -> None:
        for stream, batch in encoded.in_order():
            self._batches.setdefault(stream, []).append(batch)
        if encoded.digests is not None:
            self._digests.append(encoded.digests)


def _never(place: int, out: Any) -> None:
    raise AssertionError("nothing is put aside in memory")
