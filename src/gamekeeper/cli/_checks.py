"""Checks as plain data, and the specimens that break them."""

from __future__ import annotations

import ast
import importlib.util
import pkgutil
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from gamekeeper.audit.check import Check

SPECIMENS: Final = "gamekeeper.audit.specimens"


def card_of(check: Check) -> dict[str, Any]:
    """A check as plain data, for reports and JSON."""
    names = ("id", "name", "claim", "about", "severity", "confidence", "mend", "api")
    return {**{name: getattr(check, name) for name in names}, "needs": list(check.needs)}


def specimens() -> dict[str, str]:
    """By check id, an environment of ours that breaks it, as a user types it.

    One that breaks it without a contract comes first. The specimens are read, not run.
    """
    found: dict[str, str] = {}
    for needs_contract in (False, True):
        for name, values in _sources().items():
            for id in values.get("BREAKS", ()) if ("CONTRACT" in values) is needs_contract else ():
                found.setdefault(id, f"{SPECIMENS}.{name}:make")
    return found


def needs_contract(specimen: str) -> bool:
    """Whether a specimen is broken only under the contract that its module declares."""
    return "CONTRACT" in _sources()[specimen.removesuffix(":make").rpartition(".")[2]]


@cache
def _sources() -> dict[str, dict[str, Any]]:
    """By module of a specimen, the values of its names in capitals, as far as they are literals."""
    package = importlib.util.find_spec(SPECIMENS)
    folders = [] if package is None else package.submodule_search_locations or []
    return {
        info.name: _capitals(Path(folder) / f"{info.name}.py")
        for folder in folders
        for info in pkgutil.iter_modules([folder])
        if not info.name.startswith("_")
    }


def _capitals(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        for target in targets:
            if isinstance(target, ast.Name) and target.id.isupper():
                found[target.id] = _literal(getattr(node, "value", None))
    return found


def _literal(node: Any) -> Any:
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError):  # an expression, as it may be in CONTRACT
        return None
