"""`gamekeeper list`: names that commands take: checks, probes, environments, exporters, ..."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, Literal

from gamekeeper import plugins
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.explain import card_of
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.plugins import Plugins
    from gamekeeper.rollouts.intervention import Intervention

ORDER: Final = 17
SECTIONS: Final = re.compile(r"\n\n(?:Attributes|Args|Raises|Source):")
"""Parts of a docstring that are no prose."""

Kind = Literal[
    "checks", "probes", "envs", "interventions", "policies", "openers", "exporters", "suites"
]
Row = dict[str, Any]


@unguarded()  # nothing of a run is looked at
def command(screen: Screen, kind: Kind | None = None) -> CommandResult:
    """Lists checks, probes, environments, interventions, policies, exporters and suites.

    Built-in ones and those of installed packages; a plug-in that can't be loaded is named on
    stderr.

    Example: gamekeeper list envs

    Args:
        kind (KIND): Kind of names: checks, probes, envs, interventions, policies, openers,
            exporters or suites; without it, all of them, and the number of checks.
    """
    kinds = LISTS if kind is None else {kind: LISTS[kind]}
    document: dict[str, Any] = {}
    texts = []
    for name, (rows_of, title) in kinds.items():
        rows, broken = rows_of()
        document[name] = rows
        for each in broken:
            screen.note(each)
        if name == "checks":
            texts.append(_checks_text(rows, screen.width, is_counted=kind is None))
        else:
            texts.append(_rows_text(title, rows, screen.width, *SHOWN.get(name, ())))
    screen.show("\n\n".join(texts))
    return CommandResult(document)


def _rows_text(title: str, rows: list[Row], width: int, *more: str) -> str:
    from gamekeeper.reporting.results_text import table_lines

    shown = ("name", *more, "about")
    cells = [tuple(str(row[key] or "") for key in shown) for row in rows]
    return "\n".join([title, *table_lines(cells, width=width)])


def _checks_text(rows: list[Row], width: int, *, is_counted: bool) -> str:
    from gamekeeper.reporting.check_text import by_family, checks_text

    if not is_counted:
        return checks_text(rows, width=width)
    families = {name: len(members) for name, members in by_family(rows).items()}
    counted = [{"name": str(count), "about": name} for name, count in families.items()]
    return _rows_text(f"Checks ({len(rows)}; `gamekeeper list checks`)", counted, width)


def _checks() -> tuple[list[Row], list[str]]:
    from gamekeeper.checks.check import GROUP, PACKAGE, checks

    return [card_of(each) for each in checks().values()], _broken(plugins.load(GROUP, PACKAGE))


def _probes() -> tuple[list[Row], list[str]]:
    from gamekeeper.auditing.probe import GROUP, PACKAGE, probes

    rows = [
        {"name": name, "about": _sentence(each.about), "share": each.share}
        for name, each in probes().items()
    ]
    return rows, _broken(plugins.load(GROUP, PACKAGE))


def _interventions() -> tuple[list[Row], list[str]]:
    from gamekeeper.rollouts.intervention import GROUP, PACKAGE, interventions

    rows = [intervention_card(each) for each in interventions().values()]
    return rows, _broken(plugins.load(GROUP, PACKAGE))


def _policies() -> tuple[list[Row], list[str]]:
    from gamekeeper.interface.policy import GROUP

    rows, broken = _modules(plugins.load(GROUP, "gamekeeper.interface.policies"))
    rows = [{**row, "name": row["name"].replace("_", "-")} for row in rows]
    more = [
        {"name": "reference", "about": "The scripted policy of one of Gamekeeper's own tasks."},
        {"name": "module:callable", "about": "Any callable; file.py:callable too."},
    ]
    return rows + more, broken


def _openers() -> tuple[list[Row], list[str]]:
    from gamekeeper.interface.opening import BUILT_IN, GROUP

    found = plugins.load(GROUP, *BUILT_IN)
    rows = [
        {"name": str(getattr(part, "SYNTAX", name)), "about": _first_line(part)}
        for name, part in sorted(
            found.found.items(), key=lambda pair: getattr(pair[1], "ORDER", 50)
        )
    ]
    return rows, _broken(found)


def _exporters() -> tuple[list[Row], list[str]]:
    from gamekeeper.cli.export import found

    return _modules(found())


def _suites() -> tuple[list[Row], list[str]]:
    from gamekeeper.errors import GamekeeperError
    from gamekeeper.evaluation.spec_reader import read_file
    from gamekeeper.evaluation.suites import GROUP, suites

    rows, broken = [], _broken(plugins.load(GROUP))
    for name, path in suites().items():
        try:
            spec = read_file(path)
        except GamekeeperError as error:  # a package's file that can't be read
            broken.append(f"{GROUP}: {name} is left out: {error.what} ({path})")
            continue
        about = f"{', '.join(spec.environments)}: {', '.join(spec.policies)}"
        rows.append({"name": name, "about": about, "version": (spec.suite or ("", ""))[1]})
    return rows, broken


def _envs() -> tuple[list[Row], list[str]]:
    from gamekeeper.interface import registry

    broken = registry.with_ours()
    found = registry.apis().items()
    first = sorted(found, key=lambda pair: not pair[0].startswith(f"{registry.OURS}/"))
    rows = [{"name": name, "about": " and ".join(apis), "apis": list(apis)} for name, apis in first]
    return rows, [str(each) for each in broken]


def _modules(found: Plugins) -> tuple[list[Row], list[str]]:
    """A row for each plug-in: its name, the first line of what it says of itself."""
    rows = [{"name": name, "about": _first_line(part)} for name, part in found.found.items()]
    return rows, _broken(found)


def _broken(found: Plugins) -> list[str]:
    """A line for each plug-in that can't be loaded."""
    return [str(each) for each in found.broken]


def _first_line(part: object) -> str:
    return _sentence(inspect.getdoc(part) or "")


def _sentence(text: str) -> str:
    """The first line, begun in a capital."""
    line = text.partition("\n")[0]
    said = re.sub(r"^`[^`]*`: ", "", line)
    return said[:1].upper() + said[1:]


LISTS: Final[Mapping[Kind, tuple[Callable[[], tuple[list[Row], list[str]]], str]]] = {
    "envs": (_envs, "Environments"),
    "openers": (_openers, "Names of environments"),
    "policies": (_policies, "Policies"),
    "suites": (_suites, "Evaluation suites"),
    "exporters": (_exporters, "Export formats"),
    "interventions": (_interventions, "Interventions"),
    "probes": (_probes, "Probes"),
    "checks": (_checks, "Checks"),
}
SHOWN: Final[Mapping[Kind, tuple[str, ...]]] = {"interventions": ("label",)}
"""Columns between names and descriptions."""


def intervention_card(kind: type[Intervention]) -> dict[str, Any]:
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


def _line(text: str) -> str:
    return " ".join(text.split())


def _default(field: dataclasses.Field[Any]) -> str | None:
    """The default as it is typed; None where a value must be given."""
    if field.default is not dataclasses.MISSING:
        return repr(field.default)
    made = field.default_factory
    return None if made is dataclasses.MISSING else repr(made())
