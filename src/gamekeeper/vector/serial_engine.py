"""The serial engine: all copies in this process, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import EnvError
from gamekeeper.interface.construction import foreign_traceback
from gamekeeper.vector.sub_env_block import Autoreset, Said, SubEnvBlock
from gamekeeper.vector.tick_block import TickBlock
from gamekeeper.vector.turn_block import TurnBlock
from gamekeeper.vector.vector_form import VectorForm, arrays_in, own_memory
from gamekeeper.vector.vector_rows import Batches, Recording


def block_of(envs: Sequence[Any], arrays: Any, form: VectorForm, **options: Any) -> SubEnvBlock:
    """The block for the form's API."""
    kind = TurnBlock if form.api == "aec" else TickBlock
    return kind(envs, arrays, form, **options)


class SerialEngine:
    """Steps all copies here."""

    def __init__(
        self, envs: Sequence[Any], form: VectorForm, *, autoreset: Autoreset, wants_infos: bool
    ) -> None:
        """Takes hold of the copies."""
        plan = form.plan(len(envs))
        self.arrays = arrays_in(own_memory(plan), plan)
        self.failed: Mapping[int, str] = {}
        self._block = block_of(
            envs,
            self.arrays,
            form,
            first=0,
            slots=len(envs),
            autoreset=autoreset,
            wants_infos=wants_infos,
        )

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
            actual=f"\n{foreign_traceback(error)}",
            fix="correct the environment where the traceback points",
        )
