"""`gamekeeper replay RUN`: recorded actions from recorded seeds, in a fresh process."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Annotated, Final

import typer

from gamekeeper.cli._options import (
    SILENCE_S,
    ImportOption,
    ReopenOption,
    RunArgument,
    TimeoutOption,
    ToleranceOption,
)
from gamekeeper.cli._screen import Answer, Screen

if TYPE_CHECKING:
    from gamekeeper.record.replay import Replay

ORDER: Final = 40
UNSEALED: Final = "none, as the run was never sealed"
SAME_VERSIONS: Final = "The versions are those of the recording."

PoliciesOption = Annotated[
    bool, typer.Option("--policies", help="Let the recorded policies choose again.")
]


def command(
    screen: Screen,
    run: RunArgument,
    tolerance: ToleranceOption = None,
    policies: PoliciesOption = False,
    env: ReopenOption = None,
    allow_import: ImportOption = False,
    timeout: TimeoutOption = SILENCE_S,
) -> Answer:
    """Plays a run again: verified, or the first divergence.

    Recorded actions from recorded seeds, in a fresh process. Exit code 0: it is the same. 1: it
    diverged. 2: it can't be told, with the reason.
    """
    from gamekeeper.record.replay import replay

    with screen.progress("replaying") as take:
        replayed = replay(
            run,
            tolerance=tolerance,
            policies=policies,
            env=env,
            allow_import=allow_import,
            timeout_s=timeout,
            on_message=take,
        )
    show_replayed(screen, replayed)
    return Answer(replayed.to_json(), replay_code(replayed))


def show_replayed(
    screen: Screen, replayed: Replay, *, indent: str = "", digits: int | None = None
) -> None:
    """Shows whether a run replays; where it diverged, both values and why.

    Args:
        screen: takes it.
        replayed: what came out.
        indent: stands in front of every line.
        digits: of the fingerprint that are shown; None: all.
    """
    from gamekeeper.report.text import cause_text, divergence_text, versions_text

    width = screen.width - len(indent)
    shown = replayed.fingerprint[:digits] + "..." * (digits is not None)
    if not replayed.fingerprint:
        shown = UNSEALED
    if replayed.verified:
        screen.verdict(f"verified: fingerprint {shown}", "good", indent=indent)
    elif replayed.divergence is not None:
        text = divergence_text(replayed.divergence, width=width)
        screen.verdict(f"diverged at {text}", "bad", indent=indent)
        why = [
            cause_text(replayed.cause, width=width),
            versions_text(replayed.versions, width=width),
        ]
        screen.show(textwrap.indent("\n".join(filter(None, why)) or SAME_VERSIONS, indent))
    elif replayed.within_tolerance:
        screen.verdict(f"within tolerance: fingerprint {shown}", "good", indent=indent)
    else:
        screen.verdict("can't tell whether it replays", "unsure", indent=indent)
        screen.error(f"can't tell: {replayed.reason}")


def replay_code(replayed: Replay) -> int:
    """0: verified or within tolerance. 1: diverged. 2: can't tell."""
    if replayed.verified or (replayed.within_tolerance and replayed.divergence is None):
        return 0
    return 2 if replayed.divergence is None else 1
