"""`gamekeeper verify RUN`: compares every file of a run with its checksums and digests."""

from pathlib import Path
from typing import Final

from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 60


def command(
    screen: Screen, run: Path, root: str | None = None, fingerprint: str | None = None
) -> CommandResult:
    """Compares every file of a run with its checksum, and computes its digests again.

    Runs no code of the run. Checksums show damage, not intent: a person who can write the files
    can also write new checksums. Only --root shows that a run is the one that somebody else
    means. Files in the folder that aren't part of the run are listed as strays.

    Exit code 0: all files are whole. 1: a file is damaged, or a digest differs.

    Example: gamekeeper verify runs/warehouse-1

    Args:
        root (--root X): Root digest that the run should have, at least 32 digits; labels that are
            added later don't change it (default: not compared).
        fingerprint (--fingerprint X): Fingerprint that the run should have, at least 32 digits; it
            covers what happened, not every byte (default: not compared).
    """
    from gamekeeper.reporting.text_columns import wrapped
    from gamekeeper.runs.run_check import verify

    found = verify(run, root=root, fingerprint=fingerprint)
    lines = [line for text in str(found).splitlines() for line in wrapped(text, screen.width)]
    screen.verdict("\n".join(lines), "good" if found.ok else "bad")
    return CommandResult(found.to_json(), 0 if found.ok else 1)
