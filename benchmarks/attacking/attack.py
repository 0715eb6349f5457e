"""What an attack is, and what came of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

MARK: Final = "code-ran"
"""A file beside the work folder that code writes which nobody allowed to run."""
ANSWERED: Final = frozenset({0, 1, 2})


@dataclass(frozen=True, slots=True)
class Found:
    """What a command came to: its exit code, and all that it said."""

    code: int
    said: str


def nothing(work: Path) -> None:
    """Prepares nothing."""
    del work


def no_more(work: Path, found: Found) -> dict[str, bool]:
    """Asks for nothing more."""
    del work, found
    return {}


@dataclass(frozen=True, slots=True)
class Attack:
    """One command, and what makes it an attack.

    Args:
        name: of the attack.
        words: the command line.
        codes: exit codes that are right.
        prepare: changes the folder of runs before.
        out: names in that folder that the command may write.
        cwd: where it is typed, from that folder.
        variables: of the environment.
        flags: of the interpreter; none: the current folder stands first on its path.
        more: further claims.
        act: is done in place of the command.
    """

    name: str
    words: tuple[str, ...] = ()
    codes: frozenset[int] = ANSWERED
    prepare: Callable[[Path], None] = nothing
    out: tuple[str, ...] = ()
    cwd: str = "."
    variables: Mapping[str, str] = field(default_factory=dict)
    flags: tuple[str, ...] = ("-P",)
    more: Callable[[Path, Found], dict[str, bool]] = no_more
    act: Callable[[Path], Found] | None = None
