"""`gamekeeper export RUN --to FORM`: evidence as data sets and recordings of others, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence
    from gamekeeper.plugins import Plugins

ORDER: Final = 120
GROUP: Final = "gamekeeper.exporters"
PACKAGE: Final = "gamekeeper.adapters.exporters"
BUNDLE: Final = "bundle"

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="RUN|FORM:DATA", show_default=False,
        help="The folder of evidence; or data of another form: minari:ID, minari:FOLDER.",
    ),
]  # fmt: skip
ToOption = Annotated[
    str,
    typer.Option(
        "--to", metavar="FORM", show_default=False,
        help="numpy, minari or rerun, what a package brings, or bundle: evidence out of FORM:DATA.",
    ),
]  # fmt: skip
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="PATH",
        help="The file or folder to write; for minari the folder of data sets, otherwise the one "
        "that MINARI_DATASETS_PATH names.",
    ),
]  # fmt: skip
AgentOption = Annotated[
    list[str] | None,
    typer.Option(
        "--agent", metavar="AGENT",
        help="Only this one. Repeatable. With --to bundle: what the data's one agent is called.",
    ),
]  # fmt: skip


def command(
    screen: Screen,
    run: SourceArgument,
    to: ToOption,
    out: OutOption = None,
    agent: AgentOption = None,
) -> Answer:
    """Writes evidence as NumPy arrays, Minari data sets or a Rerun recording, or reads Minari's.

    What the other form can't hold is said on stderr and stands in the document. Nothing that
    exists is written over. `gamekeeper list exporters` names the forms.
    """
    forms = found()
    source = _source(run, forms.found)
    if to == BUNDLE:
        return _bundle(screen, run, source, out, agent)
    if to not in forms.found:
        raise _unknown("--to", to, [*forms.found, BUNDLE])
    part = forms.found[to]
    given: Any = part
    write: Callable[..., Any] = getattr(given, "export", given)
    evidence = Path(run) if source is None else source[0](source[1])
    written = write(evidence, out, agents=agent, say=screen.note)
    screen.show(f"Exported  {written}")
    return Answer({"run": run, **written.to_json()})


def found() -> Plugins:
    """The forms that evidence is exported to, ours and those of installed packages."""
    from gamekeeper import plugins

    return plugins.load(GROUP, PACKAGE)


def _source(run: str, forms: Mapping[str, object]) -> tuple[Callable[..., Evidence], str] | None:
    """What reads `FORM:DATA`, and the data; None where `run` is a folder.

    Raises:
        GamekeeperError: there is no such form, or it is only written.
    """
    form, colon, data = run.partition(":")
    if not colon or Path(run).exists() or "/" in form or len(form) < 2:  # C:\ is a drive
        return None
    readers = {n: r for n, part in forms.items() if (r := getattr(part, "load", None)) is not None}
    if form not in readers:
        raise _unknown("RUN", f"{form}:", [f"{name}:" for name in readers])
    return readers[form], data


def _bundle(
    screen: Screen,
    run: str,
    source: tuple[Callable[..., Evidence], str] | None,
    out: Path | None,
    agent: list[str] | None,
) -> Answer:
    from gamekeeper.report.text import counted, summary_text

    if source is None:
        raise GamekeeperError(
            "evidence is a bundle already", where="--to bundle", expected="FORM:DATA", seen=run,
            mend="copy its folder; minari:ID reads a data set",
        )  # fmt: skip
    if out is None:
        raise GamekeeperError(
            "no folder for the evidence is named", where="--out", mend="--out runs/imported"
        )
    if agent is not None and len(agent) > 1:
        raise GamekeeperError("the data has one agent", where="--agent", seen=", ".join(agent))
    read, data = source
    evidence = read(data, out, **({} if agent is None else {"agent": agent[0]}))
    imported = evidence.manifest["environment"].get("imported") or {}
    for each in imported.get("lacks", ()):
        screen.note(f"unknown: {each}")
    screen.show(f"Imported  {counted(evidence.summary)}")
    screen.show(summary_text(evidence.summary, width=screen.width))
    screen.show(f"\nEvidence  {evidence.path}\n  fingerprint  {evidence.fingerprint}")
    status = evidence.manifest.get("status")
    return Answer({
        **evidence.to_json(), "to": BUNDLE, "path": str(evidence.path), "status": status,
        "imported": dict(imported),
    })  # fmt: skip


def _unknown(where: str, seen: str, names: list[str]) -> GamekeeperError:
    from gamekeeper.core.contract.places import nearest

    near = nearest(seen, names)
    return GamekeeperError(
        f"there is no form {seen!r}" if where == "--to" else f"nothing reads {seen!r}",
        where=where, expected=", ".join(sorted(names)), seen=repr(seen),
        mend=f"write {near!r}" if near else "gamekeeper list exporters",
    )  # fmt: skip
