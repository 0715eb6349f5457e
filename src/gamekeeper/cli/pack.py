"""`gamekeeper pack RUN...`: runs, their source and figures in one file that others can check."""

from pathlib import Path
from shlex import quote
from typing import Final

from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 150


def command(
    screen: Screen,
    runs: list[Path],
    out: Path,
    more: list[Path] | None = None,
    sign: Path | None = None,
) -> CommandResult:
    """Packs runs into a claim that others can check: evidence, source, packages, figures.

    Runs no code of the runs. The source is that of your own runs, as recording noted it, and the
    file of an environment that was named by its path. Of an evaluation, its recorded runs are
    packed, and every number of its results.

    Example: gamekeeper pack runs/warehouse-1 --out claim.zip

    Args:
        runs (RUN): Folders of recorded runs, and of evaluations (--record).
        out (--out FILE): File to write, such as claim.zip (required).
        more (--with PATH): One more file or folder to pack: a checkpoint, an evaluation and its
            specification. Repeatable (default: none).
        sign (--sign KEY): SSH key, such as ~/.ssh/id_ed25519, that signs the claim into FILE.sig
            (default: not signed).
    """
    from gamekeeper.evaluation.claim_pack import pack

    packed = pack(runs, out, files=more or (), sign=sign)
    screen.show(
        f"{packed.claim}: {len(packed.runs)} run{'s' * (len(packed.runs) != 1)}, "
        f"{len(packed.source)} source files, {packed.size_bytes:,} bytes\ndigest {packed.digest}"
    )
    if packed.signature is not None:
        screen.show(f"signed: {packed.signature}")
    screen.note(f"to check it: gamekeeper reproduce {quote(str(packed.claim))}")
    return CommandResult(packed.to_json())
