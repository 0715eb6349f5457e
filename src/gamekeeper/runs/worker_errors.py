"""Errors that come from worker processes as plain data."""

from collections.abc import Mapping

from gamekeeper import errors
from gamekeeper.errors import EnvError, GamekeeperError
from gamekeeper.rollouts.workers import TaskOutcome


class WorkerFault(Exception):  # noqa: N818  # not the user's error: a fault of ours in the worker
    """A task of ours raised an unexpected error; the text is its traceback."""


def error_in(outcome: TaskOutcome) -> GamekeeperError | None:
    """The error of a worker; None if it has none.

    Raises:
        WorkerFault: the task itself is broken.
        KeyboardInterrupt: it was interrupted.
    """
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if outcome.status == "done" and isinstance(outcome.value, dict):
        fields = outcome.value.get("error")
        return None if fields is None else error_of(fields)
    if outcome.status == "died":
        return EnvError(
            "the environment ended its process",
            actual=outcome.error or "",
            fix="the evidence may lack its last 0.1 s; the stack, where Python could still tell "
            "it, is in `gamekeeper show RUN --json`",
        )
    if outcome.status == "hung":
        return EnvError(
            "the environment hangs",
            actual=outcome.error or "",
            fix="allow it more time with --timeout, or fix what it waits for",
        )
    if outcome.status == "raised" and (outcome.error or "").startswith("KeyboardInterrupt"):
        return EnvError(
            "the environment raised KeyboardInterrupt, though it wasn't interrupted",
            actual=outcome.traceback or "",
            fix="let the environment raise another exception, or none",
        )
    if outcome.is_theirs:
        return EnvError(
            f"the environment raised {outcome.error} where it was looked at",
            actual=f"\n{outcome.traceback}",
            fix="fix what the last lines of the traceback name",
        )
    raise WorkerFault(outcome.traceback or outcome.error or outcome.status)


def error_of(fields: Mapping[str, str]) -> GamekeeperError:
    """The error whose fields came from a worker process."""
    kind: type[GamekeeperError] = getattr(errors, fields["kind"], GamekeeperError)
    parts = {name: fields[name] for name in ("where", "expected", "actual", "fix")}
    return kind(fields["what"], **parts)
