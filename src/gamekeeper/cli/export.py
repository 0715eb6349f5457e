"""`gamekeeper export RUN --to FORM`: runs as data sets of other libraries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.episodes.evidence import Evidence
    from gamekeeper.plugins import Plugins

ORDER: Final = 120
GROUP: Final = "gamekeeper.exporters"
PACKAGE: Final = "gamekeeper.adapters.exporters"


def command(
    screen: Screen, run: str, to: str, out: Path | None = None, agent: list[str] | None = None
) -> CommandResult:
    """Exports a run as NumPy arrays, Minari data sets or a Rerun recording.

    Columns that the other form can't hold are listed on stderr and in the JSON document. An
    earlier file is overwritten. `gamekeeper list exporters` names the forms.

    Example: gamekeeper export runs/warehouse-1 --to numpy --out warehouse.npz

    Args:
        run (RUN|FORM:DATA): Folder of a recorded run; or data of another form: minari:ID,
            minari:FOLDER.
        to (--to FORM): Form to write: numpy, minari, rerun, or one of an installed package
            (required).
        out (--out PATH): File or folder to write (required; for minari the folder of its data sets,
            default: the one that MINARI_DATASETS_PATH names).
        agent (--agent AGENT): Agent to export. Repeatable (default: all agents).
    """
    forms = found()
    source = source_of(run, forms.found)
    if to not in forms.found:
        raise _unknown("--to", to, [*forms.found])
    form: Any = forms.found[to]
    write: Callable[..., Any] = getattr(form, "export", form)
    evidence = Path(run) if source is None else source[0](source[1])
    written = write(evidence, out, agents=agent, say=screen.note)
    screen.show(f"Exported  {written}")
    return CommandResult({"run": run, **written.to_json()})


def found() -> Plugins:
    """Returns the forms that runs are exported to, built in and of installed packages."""
    from gamekeeper import plugins

    return plugins.load(GROUP, PACKAGE)


def source_of(run: str, forms: Mapping[str, object]) -> tuple[Callable[..., Evidence], str] | None:
    """Returns the reader of `FORM:DATA`, and the data; None where `run` is a folder.

    Raises:
        GamekeeperError: there is no such form, or it is only written.
    """
    form, colon, data = run.partition(":")
    if not colon or Path(run).exists() or "/" in form or len(form) < 2:  # C:\ is a drive
        return None
    readers = {n: r for n, part in forms.items() if (r := getattr(part, "load", None)) is not None}
    if form not in readers:
        raise _unknown("FORM:DATA", f"{form}:", [f"{name}:" for name in readers])
    return readers[form], data


def _unknown(where: str, seen: str, names: list[str]) -> GamekeeperError:
    from gamekeeper.contract.validation import nearest

    near = nearest(seen, names)
    return GamekeeperError(
        f"no exporter is called {seen!r}" if where == "--to" else f"nothing reads {seen!r}",
        where=where,
        expected=", ".join(sorted(names)),
        actual=repr(seen),
        fix=f"write {near!r}" if near else "gamekeeper list exporters",
    )
