"""`gamekeeper verify RUN`: whether a bundle is what it says, byte by byte."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gamekeeper.cli._options import RunArgument
from gamekeeper.cli._screen import Answer, Screen

ORDER: Final = 60

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

    found = verify(run, fingerprint=fingerprint)
    screen.verdict(str(found), "good" if found.ok else "bad")
    return Answer(found.to_json(), 0 if found.ok else 1)
