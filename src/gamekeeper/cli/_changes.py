"""Writes the page of changes: `python -m gamekeeper.cli._changes docs/changes.md`.

What it says of each comes from the change's own docstring and constants.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gamekeeper.run.change import Change

SECTIONS = re.compile(r"\n\n(?:Attributes|Args|Raises|Source):")


def card_of(change: type[Change]) -> dict[str, Any]:
    """What is known of a change, as plain data."""
    from gamekeeper.run.stress.stressor import UNITS

    text = inspect.getdoc(change) or ""
    said = SECTIONS.split(text)[0].split("\n\n")
    unit: Any = getattr(change, "UNIT", None)
    return {
        "name": change.__name__,
        "about": _line(said[0]),
        "says": [_line(part) for part in said[1:]],
        "label": change.label,
        "kind": change.kind,
        "on": getattr(change, "ON", None),
        "unit": None if unit is None else UNITS.get(unit, str(unit)),
        "usual": getattr(change, "USUAL", None),
        "most": getattr(change, "MOST", None),
        "parameters": {field.name: _default(field) for field in dataclasses.fields(change)},
    }


def page() -> str:
    """The page of the changes that are part of Gamekeeper."""
    from gamekeeper.report.changes_page import changes_page
    from gamekeeper.run.change import changes

    ours = [each for each in changes().values() if each.__module__.startswith("gamekeeper.")]
    return changes_page([card_of(each) for each in ours])


def _line(text: str) -> str:
    return " ".join(text.split())


def _default(field: dataclasses.Field[Any]) -> str | None:
    """The default as it is typed; None where a value must be given."""
    if field.default is not dataclasses.MISSING:
        return repr(field.default)
    made = field.default_factory
    return None if made is dataclasses.MISSING else repr(made())


def main(arguments: Sequence[str]) -> int:
    """Writes the page into a file."""
    if len(arguments) != 1:
        sys.stderr.write(f"{__doc__}\n")
        return 2
    Path(arguments[0]).write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
