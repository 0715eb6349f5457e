"""`gamekeeper replay RUN`: plays recorded actions from recorded seeds, in a new process."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gamekeeper.cli._audit import show_failed_rows
from gamekeeper.cli._options import SILENCE_S
from gamekeeper.cli._screen import CommandResult, Screen

if TYPE_CHECKING:
    from gamekeeper.runs.comparison import Replay

ORDER: Final = 40
UNFINALIZED: Final = "missing, as the run was never finalized"
TYPED: Final = ("named", "allow_import")
"""Rules of consent that the user has just typed as an option."""
SAME_VERSIONS: Final = "The versions are those of the recording."


def command(
    screen: Screen,
    run: Path,
    tolerance: float | None = None,
    policies: bool = False,
    env: str | None = None,
    allow_import: bool = False,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Replays a run, and shows the first divergence if there is one.

    Resets the environment with the recorded seeds and plays the recorded actions, in a new
    process.

    Exit code 0: every value is the same. 1: it diverged. 2: no answer; the reason is printed.

    Example: gamekeeper replay runs/warehouse-1

    Args:
        policies (--policies): Let the recorded policies choose again.
    """
    from gamekeeper.runs.comparison import replay
    from gamekeeper.runs.load_run import load

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
    consent = replayed.consent
    if consent is not None and (consent.rule not in TYPED or consent.pythonpath):
        screen.note(str(consent))
    document = {**replayed.to_json(), "verdicts": show_failed_rows(screen, load(run))}
    return CommandResult(document, replay_code(replayed))


def show_replayed(
    screen: Screen, replayed: Replay, *, indent: str = "", digits: int | None = None
) -> None:
    """Shows if a run replays; where it diverged, both values and the likely reason.

    Args:
        digits: number of digits of the fingerprint that are shown; None: all.
    """
    from gamekeeper.reporting.results_text import cause_text, diverged_text, versions_text

    width = screen.width - len(indent)
    shown = replayed.fingerprint[:digits] + "..." * (digits is not None)
    if not replayed.fingerprint:
        shown = UNFINALIZED
    if replayed.verified:
        screen.verdict(f"verified: fingerprint {shown}", "good", indent=indent)
        if replayed.versions:
            differ = versions_text(replayed.versions, width=width)
            screen.show(textwrap.indent(f"{differ}\n(every turn is equal nevertheless)", indent))
    elif replayed.divergence is not None:
        text = diverged_text(replayed.divergence, width=width)
        screen.verdict(text, "bad", indent=indent)
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
