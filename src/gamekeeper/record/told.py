"""What a worker's outcome says went wrong, as an error for whoever asked for the recording."""

from __future__ import annotations

from gamekeeper.errors import EnvError, GamekeeperError
from gamekeeper.run.watch import Outcome


class WorkerFault(Exception):  # noqa: N818  # not the user's error: a fault of ours in the worker
    """A task of ours raised what it should have dealt with; its text is the traceback."""


def error_in(outcome: Outcome) -> GamekeeperError | None:
    """What went wrong in a worker that wasn't interrupted; None where nothing did.

    Raises:
        WorkerFault: the task itself is broken.
    """
    if outcome.status == "done" and isinstance(outcome.value, dict):
        fields = outcome.value.get("error")
        if fields is None:
            return None
        from gamekeeper.record.tasks import error_of

        return error_of(fields)
    if outcome.status == "died":
        return EnvError(
            "the environment ended its process",
            seen=outcome.error or "",
            mend="the evidence may lack its last 0.1 s; the stack, where Python could still tell "
            "it, is in `gamekeeper show RUN --json`",
        )
    if outcome.status == "hung":
        return EnvError(
            "the environment hangs",
            seen=outcome.error or "",
            mend="allow it more time with --timeout, or mend what it waits for",
        )
    if outcome.status == "raised" and (outcome.error or "").startswith("KeyboardInterrupt"):
        return EnvError(
            "the environment raised KeyboardInterrupt, and nobody had interrupted it",
            seen=outcome.traceback or "",
        )
    raise WorkerFault(outcome.traceback or outcome.error or outcome.status)
