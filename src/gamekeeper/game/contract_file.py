"""Contracts as files: core reads text only, so the file is opened here.

Importing this module gives `Contract.load` its reader; the public `gamekeeper.Contract` comes from
here. It loads no numpy.
"""

from __future__ import annotations

from difflib import get_close_matches
from os import PathLike, fspath
from pathlib import Path
from typing import Final

from gamekeeper.core.contract import Contract
from gamekeeper.errors import ContractError

__all__ = ["Contract", "load_contract"]

LARGEST_BYTES: Final = 1 << 20
"""A contract that people write is a few kilobytes; more is some other file."""


def load_contract(path: str | PathLike[str]) -> Contract:
    """The contract that a TOML file declares.

    Args:
        path: a file in UTF-8.

    Raises:
        ContractError: the file can't be read, isn't TOML, isn't a contract, or contradicts
            itself; names file and line.
    """
    name = fspath(path)
    return Contract.parse(_text(Path(name), name), source=name)


def _text(path: Path, name: str) -> str:
    """The file's text, without the byte order mark that some editors put in front."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise ContractError(
            "the contract can't be opened",
            where=name,
            expected="a file that can be read",
            seen=error.strerror or type(error).__name__,
            mend=_mend(path),
        ) from None
    if len(data) > LARGEST_BYTES:
        raise ContractError(
            "the file is too large for a contract",
            where=name,
            expected=f"at most {LARGEST_BYTES} bytes",
            seen="more",
            mend="name the TOML file of the contract",
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ContractError(
            "the contract is not text in UTF-8",
            where=f"{name}, line {line}",
            expected="UTF-8",
            seen=f"byte 0x{data[error.start]:02x}",
            mend="save the file as UTF-8",
        ) from None


def _mend(path: Path) -> str:
    """Names the contract beside it that was probably meant."""
    folder = path.parent
    names = sorted(each.name for each in folder.glob("*.toml")) if folder.is_dir() else []
    near = get_close_matches(path.name, names, n=1)
    if near:
        return f"open {folder / near[0]}"
    return f"open one of {', '.join(names[:5])}" if names else "write one: gamekeeper contract ENV"


# Set once, to the one function there is: core declares the name and stays without files.
Contract.load = staticmethod(load_contract)
