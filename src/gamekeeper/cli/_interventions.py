"""Writes their page: `python -m gamekeeper.cli._interventions docs/interventions.md`.

What it says of each comes from the intervention's own docstring and constants.
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
    from gamekeeper.rollouts.intervention import Intervention

SECTIONS = re.compile(r"\n\n(?:Attributes|Args|Raises|Source):")


def card_of(kind: type[Intervention]) -> dict[str, Any]:
    """Describes an intervention, as plain data."""
    from gamekeeper.rollouts.interventions.perturbation import UNITS

    text = inspect.getdoc(kind) or ""
    about, *more = SECTIONS.split(text)[0].split("\n\n")
    unit: Any = getattr(kind, "UNIT", None)
    return {
        "name": kind.__name__,
        "about": _line(about),
        "says": [_line(part) for part in more],
        "label": kind.label,
        "kind": kind.kind,
        "on": getattr(kind, "ON", None),
        "unit": None if unit is None else UNITS.get(unit, str(unit)),
        "usual": getattr(kind, "USUAL", None),
        "most": getattr(kind, "MOST", None),
        "parameters": {field.name: _default(field) for field in dataclasses.fields(kind)},
    }


def page() -> str:
    """The page of the interventions that are part of Gamekeeper."""
    from gamekeeper.reporting.interventions_page import interventions_page
    from gamekeeper.rollouts.intervention import interventions

    ours = [each for each in interventions().values() if each.__module__.startswith("gamekeeper.")]
    return interventions_page([card_of(each) for each in ours])


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
