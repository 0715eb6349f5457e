"""The contract that an environment comes with, or that its user hands over."""

from __future__ import annotations

import inspect
from os import PathLike
from pathlib import Path
from typing import Any

from gamekeeper.contract import Contract
from gamekeeper.interface.contract_fit import check_fit
from gamekeeper.interface.env_source import Opened


def declared_contract(
    contract: Contract | str | PathLike[str] | None, opened: Opened
) -> Contract | None:
    """The contract for `opened`: the one handed over, else the one that lies beside it, else None.

    Beside an environment lies the file that its class names in `contract`, or the file of its
    module's name with the suffix `.toml`.

    Raises:
        ContractError: the file can't be read, contradicts itself, or doesn't fit the environment.
    """
    declared = _declared(contract, opened)
    if declared is not None:
        check_fit(declared, opened)
    return declared


def _declared(contract: Contract | str | PathLike[str] | None, opened: Opened) -> Contract | None:
    if isinstance(contract, Contract):
        return contract
    if contract is not None:
        return Contract.load(contract)
    own = getattr(opened.env.unwrapped, "contract", None)
    if isinstance(own, Contract):
        return own
    source = _source_file(opened.env.unwrapped)
    if source is None:
        return None
    beside = source.with_name(own) if isinstance(own, str) else source.with_suffix(".toml")
    return Contract.load(beside) if isinstance(own, str) or _is_contract(beside) else None


def _source_file(env: Any) -> Path | None:
    try:
        return Path(inspect.getfile(type(env)))
    except (TypeError, OSError):  # a class made in an interactive session has no file
        return None


def _is_contract(path: Path) -> bool:
    return path.name != "pyproject.toml" and path.is_file()
