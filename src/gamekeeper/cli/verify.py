"""`gamekeeper verify RUN`: whether a bundle is what it says, byte by byte."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gamekeeper.cli._options import RunArgument
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import GamekeeperError

ORDER: Final = 60
DIGITS: Final = range(8, 65)
"""Of a fingerprint that is given: all 64, or as many of the first as nobody hits by chance."""

FingerprintOption = Annotated[
    str | None,
    typer.Option(
        "--fingerprint", metavar="X", help="What it should be, from elsewhere; 8 digits or more."
    ),
]


def command(screen: Screen, run: RunArgument, fingerprint: FingerprintOption = None) -> Answer:
    """Finds changed bytes, and computes the fingerprint anew.

    Nothing of what is read is run. A seal shows damage, not intent: who can write the files can
    seal them. That a run is the one that somebody else means, only --fingerprint shows. Exit
    code 0: all is well. 1: it isn't.
    """
    from gamekeeper.record.verify import verify

    found = verify(run, fingerprint=_read(fingerprint))
    screen.verdict(str(found), "good" if found.ok else "bad")
    return Answer(found.to_json(), 0 if found.ok else 1)


def _read(fingerprint: str | None) -> str | None:
    """The fingerprint as it was copied from somewhere, with what stood around it taken off.

    Raises:
        GamekeeperError: it is none, so that comparing with it would tell nothing of the run.
    """
    if fingerprint is None:
        return None
    digits = fingerprint.strip().rstrip(".…").lower()
    if len(digits) in DIGITS and set(digits) <= set("0123456789abcdef"):
        return digits
    raise GamekeeperError(
        "this is no fingerprint",
        where="--fingerprint",
        expected=f"{DIGITS.start} to {DIGITS.stop - 1} digits of 0 to 9 and a to f",
        seen=repr(fingerprint[:80]),
        mend="copy it from where the run was announced; `gamekeeper show RUN` says it too",
    )
