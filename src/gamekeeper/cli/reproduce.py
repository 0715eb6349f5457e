"""`gamekeeper reproduce claim.zip`: plays a claim's runs again and ticks each figure."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import SILENCE_S
from gamekeeper.cli._screen import CommandResult, Screen

if TYPE_CHECKING:
    from gamekeeper.evaluation.claim_check import CheckedClaim

ORDER: Final = 151
MOST_SHOWN: Final = 20
"""Differences that are shown; the document has all of them."""
MOST_ROWS: Final = 60
"""Figures that are shown; of more, those that aren't ticked."""
MOST_NAMED: Final = 8
"""Packages that are named where they aren't installed."""
MARKS: Final = {True: "✓", False: "✗", None: "?"}
CODES: Final = {True: 0, False: 1, None: 2}


def command(
    screen: Screen,
    claim: Path,
    out: Path | None = None,
    env: str | None = None,
    allow_import: bool = False,
    signers: Path | None = None,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Checks a claim: says what differs here, plays its runs again, and ticks each figure.

    Installs nothing. Code of the claim runs by the rules of replay only: an installed environment
    does, the claim's own source with --allow-import.

    Exit code 0: every figure is ticked. 1: a figure or a file is another. 2: no answer; the
    reason is printed.

    Example: gamekeeper reproduce claim.zip --allow-import

    Args:
        claim (CLAIM): File that gamekeeper pack wrote.
        out (--out FOLDER): New folder to unpack it into (default: a temporary one).
        env (--env ENV): Environment to open (default: the one that was recorded).
        signers (--signers FILE): Allowed signers, a name and a public SSH key on each line;
            CLAIM.sig has to be by one of them (default: signatures aren't looked at).
    """
    from gamekeeper.evaluation.claim_check import reproduce

    place: Any = tempfile.TemporaryDirectory() if out is None else nullcontext(str(out))
    with place as folder:
        found = reproduce(
            claim, folder, env=env, allow_import=allow_import, signers=signers, timeout_s=timeout
        )
    _show(screen, found)
    return CommandResult(found.to_json(), CODES[found.ok])


def _show(screen: Screen, found: CheckedClaim) -> None:
    from gamekeeper.evaluation.claim_check import ABSENT
    from gamekeeper.reporting.results_text import diverged_text
    from gamekeeper.reporting.text_columns import column_lines, wrapped

    screen.show(f"digest {found.digest}")
    if found.signer is not None:
        screen.show(f"signed by {found.signer}")
    for each in found.damage:
        screen.verdict(f"damaged: {each}", "bad")
    others = [each for each in found.differs if each.here != ABSENT]
    for other in others[:MOST_SHOWN]:
        screen.show(f"differs here: {other.name}, claimed {other.claimed}, here {other.here}")
    if len(others) > MOST_SHOWN:
        screen.show(f"differs here: {len(others) - MOST_SHOWN} more")
    if absent := [each.name for each in found.differs if each.here == ABSENT]:
        more = f" and {len(absent) - MOST_NAMED} more" if len(absent) > MOST_NAMED else ""
        screen.show(f"not installed here: {', '.join(absent[:MOST_NAMED])}{more}")
    for run, played in found.replays.items():
        if played.divergence is not None:
            where = diverged_text(played.divergence, width=screen.width)
            screen.verdict(f"{run} {where}", "bad")
    for run, reason in found.reasons.items():
        screen.error(f"{run} wasn't played again: {reason}")
    shown = list(found.figures)
    if len(shown) > MOST_ROWS:
        shown = [each for each in shown if each.ticked is not True][:MOST_ROWS]
    rows = [
        [MARKS[each.ticked], each.run, each.name, _short(each.claimed), _short(each.recorded)]
        for each in shown
    ]
    head = ["", "run", "figure", "claimed", "in the evidence"]
    if rows:
        screen.show("\n".join(column_lines([head, *rows], width=screen.width)))
    if len(rows) < len(found.figures):
        screen.note(f"{len(found.figures) - len(rows)} more figures are in the document of --json")
    for line in _unconfirmed(found):
        screen.show("\n".join(wrapped(line, screen.width)))
    ticked = sum(each.ticked is True for each in found.figures)
    manner = {True: "good", False: "bad", None: "unsure"}[found.ok]
    screen.verdict(f"{ticked} of {len(found.figures)} figures ticked", manner)


def _unconfirmed(found: CheckedClaim) -> Iterator[str]:
    """Says of each run with figures that are as claimed, and yet not ticked, that it diverged."""
    for name in dict.fromkeys(each.run for each in found.figures):
        figures = [each for each in found.figures if each.run == name and each.ticked is False]
        same = sum(each.claimed == each.recorded for each in figures)
        if same:
            yield (
                f"{same} figures of {name} are in the evidence as claimed, but not ticked: a "
                "figure is ticked only where its run replays, and it diverged"
            )


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = str(value)
    return text if len(text) <= 16 else f"{text[:12]}..."
