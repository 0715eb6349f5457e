"""`gamekeeper list`: what there is to name: checks, probes, environments, exporters, ..."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from gamekeeper.cli._checks import card_of
from gamekeeper.cli._screen import Answer, Screen

if TYPE_CHECKING:
    from gamekeeper.plugins import Plugins

ORDER: Final = 17

Kind = Literal["checks", "probes", "envs", "changes", "policies", "openers", "exporters", "suites"]
Row = dict[str, Any]

KindArgument = Annotated[
    Kind | None, typer.Argument(metavar="KIND", show_default=False,
                                help="checks, probes, envs, changes, policies, openers, exporters, "
                                "suites.")
]  # fmt: skip


def command(screen: Screen, kind: KindArgument = None) -> Answer:
    """Lists what can be named: checks, environments, changes, policies, suites, exporters, ...

    Built-in ones and those of installed packages; a package's that can't be loaded is named on
    stderr. Without a kind, all but the checks are listed, and the checks counted.
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
    return Answer(document)


def _rows_text(title: str, rows: list[Row], width: int, *more: str) -> str:
    from gamekeeper.report.text import table_lines

    shown = ("name", *more, "about")
    cells = [tuple(str(row[key] or "") for key in shown) for row in rows]
    return "\n".join([title, *table_lines(cells, width=width)])


def _checks_text(rows: list[Row], width: int, *, is_counted: bool) -> str:
    from gamekeeper.report.check_text import by_family, checks_text

    if not is_counted:
        return checks_text(rows, width=width)
    families = {name: len(members) for name, members in by_family(rows).items()}
    counted = [{"name": str(count), "about": name} for name, count in families.items()]
    return _rows_text(f"Checks ({len(rows)}; `gamekeeper list checks`)", counted, width)


def _checks() -> tuple[list[Row], list[str]]:
    from gamekeeper import plugins
    from gamekeeper.audit.check import GROUP, PACKAGE, checks

    rows = [card_of(each) for each in checks().values()]
    return rows, [str(each) for each in plugins.load(GROUP, PACKAGE).broken]


def _probes() -> tuple[list[Row], list[str]]:
    from gamekeeper import plugins
    from gamekeeper.audit.gather import GROUP, PACKAGE

    found = plugins.load(GROUP, PACKAGE)
    return _modules(found, share=lambda part: float(getattr(part, "SHARE", 1.0)))


def _changes() -> tuple[list[Row], list[str]]:
    from gamekeeper import plugins
    from gamekeeper.cli._changes import card_of
    from gamekeeper.run.change import GROUP, PACKAGE, changes

    rows = [card_of(each) for each in changes().values()]
    return rows, [str(each) for each in plugins.load(GROUP, PACKAGE).broken]


def _policies() -> tuple[list[Row], list[str]]:
    from gamekeeper import plugins
    from gamekeeper.game.policy import GROUP

    rows, broken = _modules(plugins.load(GROUP, "gamekeeper.game.policies"))
    rows = [{**row, "name": row["name"].replace("_", "-")} for row in rows]
    more = [
        {"name": "reference", "about": "The task's own scripted policy, where it has one."},
        {"name": "module:callable", "about": "Any callable; file.py:callable too."},
    ]
    return rows + more, broken


def _openers() -> tuple[list[Row], list[str]]:
    from gamekeeper import plugins
    from gamekeeper.game.open import GROUP

    found = plugins.load(GROUP, "gamekeeper.game.openers")
    rows = [
        {"name": str(getattr(part, "SYNTAX", name)), "about": _first_line(part)}
        for name, part in sorted(
            found.found.items(), key=lambda pair: getattr(pair[1], "ORDER", 50)
        )
    ]
    return rows, [str(each) for each in found.broken]


def _exporters() -> tuple[list[Row], list[str]]:
    from gamekeeper.cli.export import found

    return _modules(found())


def _suites() -> tuple[list[Row], list[str]]:
    from gamekeeper import plugins
    from gamekeeper.errors import GamekeeperError
    from gamekeeper.evaluate.reading import read_file
    from gamekeeper.evaluate.suites import GROUP, suites

    rows, broken = [], [str(each) for each in plugins.load(GROUP).broken]
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
    from gamekeeper.game.openers import _registry

    broken = _registry.with_ours()
    found = _registry.apis().items()
    first = sorted(found, key=lambda pair: not pair[0].startswith(f"{_registry.OURS}/"))
    rows = [{"name": name, "about": " and ".join(apis), "apis": list(apis)} for name, apis in first]
    return rows, [str(each) for each in broken]


def _modules(found: Plugins, **more: Callable[[object], Any]) -> tuple[list[Row], list[str]]:
    """A row for each plug-in: its name, the first line of what it says of itself."""
    rows = [
        {"name": name, "about": _first_line(part), **{key: of(part) for key, of in more.items()}}
        for name, part in found.found.items()
    ]
    return rows, [str(each) for each in found.broken]


def _first_line(part: object) -> str:
    line = (inspect.getdoc(part) or "").partition("\n")[0]
    said = re.sub(r"^`[^`]*`: ", "", line)
    return said[:1].upper() + said[1:]


LISTS: Final[Mapping[Kind, tuple[Callable[[], tuple[list[Row], list[str]]], str]]] = {
    "envs": (_envs, "Environments"),
    "openers": (_openers, "How environments are named"),
    "policies": (_policies, "Policies"),
    "suites": (_suites, "Suites to evaluate"),
    "exporters": (_exporters, "Forms to export to"),
    "changes": (_changes, "Changes"),
    "probes": (_probes, "Probes"),
    "checks": (_checks, "Checks"),
}
SHOWN: Final[Mapping[Kind, tuple[str, ...]]] = {"changes": ("label",)}
"""Columns between names and what they are about."""
