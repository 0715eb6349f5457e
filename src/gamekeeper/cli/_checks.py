"""Checks as plain data, and the specimens that break them."""

from __future__ import annotations

import ast
import importlib.util
import pkgutil
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

    The specimens are read, not run.
    """
    package = importlib.util.find_spec(SPECIMENS)
    found: dict[str, str] = {}
    for folder in [] if package is None else package.submodule_search_locations or []:
        for info in pkgutil.iter_modules([folder]):
            if not info.name.startswith("_"):
                for id in _breaks(Path(folder) / f"{info.name}.py"):
                    found.setdefault(id, f"{SPECIMENS}.{info.name}:make")
    return found


def _breaks(file: Path) -> tuple[str, ...]:
    """The value of `BREAKS` in a specimen's source."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign):
            names = [each.id for each in node.targets if isinstance(each, ast.Name)]
            if "BREAKS" in names:
                return tuple(ast.literal_eval(node.value))
    return ()
