"""The serial engine: all copies in this process, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gamekeeper.errors import EnvError
from gamekeeper.game.opening.construct import foreign_traceback, said_by
from gamekeeper.vector.arrays import arrays_in, own_memory
from gamekeeper.vector.block import Autoreset, Block, Said
from gamekeeper.vector.form import Form
from gamekeeper.vector.rows import Batches, Recording
from gamekeeper.vector.ticks import TickBlock
from gamekeeper.vector.turns import TurnBlock


def block_of(doors: Sequence[Any], arrays: Any, form: Form, **options: Any) -> Block:
    """The block for the form's API."""
    kind = TurnBlock if form.api == "aec" else TickBlock
    return kind(doors, arrays, form, **options)


class SerialEngine:
    """Steps all copies here."""

    def __init__(
        self, doors: Sequence[Any], form: Form, *, autoreset: Autoreset, wants_infos: bool
    ) -> None:
        """Takes hold of the copies."""
        plan = form.plan(len(doors))
        self.arrays = arrays_in(own_memory(plan), plan)
        self.failed: Mapping[int, str] = {}
        self._block = block_of(
            doors, self.arrays, form,
            first=0, slots=len(doors), autoreset=autoreset, wants_infos=wants_infos,
        )  # fmt: skip

    def reset(self, seed: int, options: Any) -> Said:
        """Begins a run."""
        try:
            return self._block.reset(seed, options)
        except Exception as error:
            raise self._named(error) from error

    def step(self) -> Said:
        """One step of every copy."""
        try:
            return self._block.step()
        except Exception as error:
            raise self._named(error) from error

    def record(self, recording: Recording, out: Callable[[Batches], None]) -> None:
        """Every copy's rows go to `out` from its next episode on."""
        self._block.record(recording, out)

    def end_recording(self) -> None:
        """Ends the episodes in progress; the rest of the rows goes out."""
        self._block.end_recording()

    def close(self) -> None:
        """Closes every copy."""
        self._block.close()

    def _named(self, error: Exception) -> EnvError:
        e = int(self.arrays["cursor"][0])
        return EnvError(
            f"copy {e} raised {said_by(error)}",
            where=f"env {e}",
            seen=f"\n{foreign_traceback(error)}",
        )
