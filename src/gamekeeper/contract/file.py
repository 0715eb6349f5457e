"""Contract files: the one place where the package of contracts touches a disk."""

from difflib import get_close_matches
from os import PathLike, fspath
from pathlib import Path
from typing import Final

from gamekeeper.errors import ContractError

LARGEST_BYTES: Final = 1 << 20
"""A contract that people write is a few kilobytes; more is some other file."""


def contract_text(given: str | PathLike[str]) -> str:
    """The text of a contract's file, without the byte order mark that some editors put in front.

    Raises:
        ContractError: the file can't be read, is too large, or isn't UTF-8.
    """
    name = fspath(given)
    path = Path(name)
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise ContractError(
            "the contract can't be opened",
            where=name,
            expected="a file that can be read",
            actual=error.strerror or type(error).__name__,
            fix=_fix(path),
        ) from None
    if len(data) > LARGEST_BYTES:
        raise ContractError(
            "the file is too large for a contract",
            where=name,
            expected=f"at most {LARGEST_BYTES} bytes",
            actual="more",
            fix="name the TOML file of the contract",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ContractError(
            "the contract is not text in UTF-8",
            where=f"{name}, line {line}",
            expected="UTF-8",
            actual=f"byte 0x{data[error.start]:02x}",
            fix="save the file as UTF-8",
        ) from None


def _fix(path: Path) -> str:
    """Names the contract beside it that was probably meant."""
    folder = path.parent
    names = sorted(each.name for each in folder.glob("*.toml")) if folder.is_dir() else []
    near = get_close_matches(path.name, names, n=1)
    if near:
        return f"open {folder / near[0]}"
    return f"open one of {', '.join(names[:5])}" if names else "write one: gamekeeper contract ENV"
