"""The serial engine: all copies in this process, one after the other."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import ActionError, EnvError, GamekeeperError
from gamekeeper.interface.construction import foreign_traceback
from gamekeeper.interface.legality import forbidden
from gamekeeper.vector.sub_env_block import Autoreset, StepOutputs, SubEnvBlock
from gamekeeper.vector.tick_block import TickBlock
from gamekeeper.vector.turn_block import TurnBlock
from gamekeeper.vector.vector_form import Arrays, VectorForm, arrays_in, own_memory
from gamekeeper.vector.vector_rows import Batches, Recording


def block_of(envs: Sequence[Any], arrays: Any, form: VectorForm, **options: Any) -> SubEnvBlock:
    """The block for the form's API."""
    kind = TurnBlock if form.api == "aec" else TickBlock
    return kind(envs, arrays, form, **options)


def failure(
    form: VectorForm, arrays: Arrays, e: int, how: str, traceback: str, *, where: str, fix: str
) -> GamekeeperError:
    """Error of a sub-environment that failed; names an agent that did what its mask forbids.

    Args:
        arrays: of the step in which it failed; its masks are those from before the step.
        e: place of the sub-environment in them.
        how: the failure, in a sentence.
    """
    turn = int(arrays["turn"][e])
    for g, group in enumerate(form.groups):
        for i, agent in enumerate(group.agents) if group.flags else ():
            column = group.first + i
            if column != turn if form.api == "aec" else not arrays["live"][e, column]:
                continue
            at = (e,) if form.api == "aec" else (e, i)
            action = arrays[f"action.{g}.0"][at]
            mask, then = arrays[f"mask.{g}"][at], f"{how}\n{traceback}"
            error = forbidden(agent, action, group.action_space, mask, then=then)
            if error is not None:
                return ActionError(**error.parts() | {"where": f"{where}, {error.where}"})
    return EnvError(how, where=where, actual=f"\n{traceback}" if traceback else "", fix=fix)


class SerialEngine:
    """Steps all copies here."""

    def __init__(
        self, envs: Sequence[Any], form: VectorForm, *, autoreset: Autoreset, wants_infos: bool
    ) -> None:
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

    def reset(self, seed: int, options: Any) -> StepOutputs:
        """Begins a run."""
        try:
            return self._block.reset(seed, options)
        except Exception as error:
            raise self._named(error) from error

    def step(self) -> StepOutputs:
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

    def _named(self, error: Exception) -> GamekeeperError:
        e = int(self.arrays["cursor"][0])
        return failure(
            self._block.form,
            self.arrays,
            e,
            f"copy {e} raised {said_by(error)}",
            foreign_traceback(error),
            where=f"env {e}",
            fix=error.fix
            if isinstance(error, ActionError)
            else "correct the environment where the traceback points",
        )
