"""An episode played again: its recorded turns handed out, what became of them taken off behind."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, TypeAlias

from gamekeeper.core.evidence import NO_STEPS, Evidence, manifest_of
from gamekeeper.core.strip import Front, Strip
from gamekeeper.core.tables import MemoryTables
from gamekeeper.core.trace import Trace, Turn
from gamekeeper.game.aec import AECGame
from gamekeeper.game.parallel import ParallelGame
from gamekeeper.run.memory import MemorySink

STREAMS: Final = ("steps", "states")
Look: TypeAlias = Callable[[Trace, Trace], bool]
"""Looks at the same turns, recorded and played again; says whether to go on."""


class Course:
    """A recorded episode on its way through a game, of which only some turns are in memory.

    Args:
        recorded: the episode.
        game: plays it.
        sink: takes what `game` puts on the tape.
        look: sees every stretch once it was played.
    """

    def __init__(
        self,
        recorded: Strip,
        game: ParallelGame | AECGame,
        sink: MemorySink,
        look: Look | None = None,
    ) -> None:
        self._game, self._sink, self._look = game, sink, look
        self._number = recorded.episode
        self._rows: dict[str, Front] = {}
        self._header: Mapping[str, Any] = {}
        self._spoken: Evidence | None = None
        self._stretches = recorded.stretches()
        self._behind: deque[tuple[Trace, int | None]] = deque()
        self._now = next(self._stretches)
        self._goes_on = True
        self.head = self._now[0]
        """The first turns, with what the whole episode says of itself."""

    def turns(self) -> Iterator[Turn]:
        """The recorded turns in their order; those before the one asked for have been played."""
        while True:
            trace, before = self._now
            yield from trace.turns
            if before is None:  # what closes the episode is still to be played
                return
            self._advance()
            self._compare(self._game.turn)
            if not self._goes_on:
                return

    def finish(self, again: Evidence) -> None:
        """Compares what is left.

        Args:
            again: what the sink still held when the episode was over, and its header.
        """
        self._header, self._spoken = next(again.headers), again
        for stream in STREAMS:
            for part in again.tables.parts(stream, self._number) or ():
                self._rows.setdefault(stream, Front()).add(part)
        while self._goes_on and self._now[1] is not None:
            self._advance()
            self._compare(None)
        self._behind.append(self._now)
        self._compare(None)

    def _advance(self) -> None:
        """The stretch that was played waits to be compared, the next one comes."""
        self._behind.append(self._now)
        self._now = next(self._stretches)

    def _compare(self, played: int | None) -> None:
        """Looks at the stretches behind that have been played whole.

        Args:
            played: turns of the game that are whole; None: it is over.
        """
        while self._goes_on and self._behind:
            trace, before = self._behind[0]
            if played is not None and (before is None or before > played):
                return
            self._behind.popleft()
            again = self._played(before)
            self._goes_on = self._look is None or self._look(trace, again)

    def _played(self, before: int | None) -> Trace:
        """The turns below `before` as they were played; None: all that are left."""
        for stream, rows in self._sink.taken().items():
            self._rows.setdefault(stream, Front()).add(rows)
        said = self._said()
        return Strip(
            episode=self._number,
            header=self._header,
            spaces=said.spaces,
            state_codec=said.state_codec,
            steps=self._rows.get("steps", Front()),
            states=self._rows.get("states"),
            empty=NO_STEPS,
        ).take(before)

    def _said(self) -> Evidence:
        """What says how rows are to be read: the spaces of all who were seated by now."""
        layout, said = self._sink.layout, self._spoken
        seats = len(layout.order), layout.state is not None
        if said is None or seats != (
            len(said.manifest["agents"]),
            said.manifest["state_space"] is not None,
        ):
            manifest = manifest_of(
                environment={}, layout=layout, contract=None, level="full", run_seed=None
            )
            said = self._spoken = Evidence(manifest, MemoryTables({}))
        return said
