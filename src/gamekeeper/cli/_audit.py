"""Audits on the command line: asked with progress, shown the worst first, written as files."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal
from urllib.parse import quote

from gamekeeper.cli._document import document_text
from gamekeeper.cli._screen import Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.audit.result import Audit

Severity = Literal["high", "medium", "low"]

MEGABYTE: Final = 1_000_000
MANNERS: Final = {"high": "bad", "medium": "bad", "low": "unsure"}


def audit_with_progress(
    screen: Screen,
    spec: str,
    *,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    memory_mb: int | None = None,
    **options: Any,
) -> Audit:
    """The audit of what is named by `spec`, in a process of its own; `options` as in `gk.audit`.

    Raises:
        GamekeeperError: it can't be audited.
        KeyboardInterrupt: by Ctrl-C.
    """
    from gamekeeper.audit.front import audit
    from gamekeeper.cli._audit_progress import probing

    is_dumb = os.environ.get("TERM") == "dumb"
    is_shown = not screen.is_quiet and sys.stderr.isatty() and not is_dumb
    shares = shares_of(select, ignore) if is_shown else {}
    with probing(shares, is_shown=is_shown) as take:
        return audit(
            spec, select=select, ignore=ignore, on_probe=take,
            memory_bytes=None if memory_mb is None else memory_mb * MEGABYTE, **options,
        )  # fmt: skip


def shares_of(select: Sequence[str], ignore: Sequence[str]) -> dict[str, float]:
    """The probes that these checks need, and their shares of the budget."""
    from gamekeeper.audit.audit import needed
    from gamekeeper.audit.check import selected
    from gamekeeper.audit.gather import probes

    names = needed(selected(tuple(select), tuple(ignore)), is_all=not select)
    return {name: float(probe.SHARE) for name, probe in probes(names).items()}


def show_audit(screen: Screen, document: Mapping[str, Any]) -> None:
    """Shows an audit: what is broken with the way to see it again, waivers, the measured form."""
    from gamekeeper.audit.check import checks
    from gamekeeper.report.audit_text import program_of, title_text, waived_text
    from gamekeeper.report.measured_text import measured_text

    width = screen.width
    screen.verdict(title_text(document), _manner(document))
    show_broken(screen, document)
    program = program_of(document)
    if program is not None:
        id, text = program
        screen.show(f"\nTo see {id} again")
        screen.program(text)
        screen.show(
            f"  --out FOLDER writes the programs of all findings; "
            f"`gamekeeper explain {id}` says why it matters."
        )
    known = checks().keys()
    for part in (waived_text(document, known=known, width=width),
                 measured_text(document, width=width)):  # fmt: skip
        if part:
            screen.show(f"\n{part}")


def show_broken(screen: Screen, document: Mapping[str, Any], *, least: Severity = "low") -> None:
    """Shows the broken promises, grouped by severity."""
    from gamekeeper.report.audit_text import broken_blocks

    for heading, text in broken_blocks(document, width=screen.width, least=least):
        screen.show("")
        screen.verdict(heading, MANNERS[heading.rpartition(" ")[2]])
        screen.show(text)


def say_unseen(screen: Screen, document: Mapping[str, Any]) -> None:
    """Counts on stderr what nobody saw, and tells of checks that failed themselves."""
    from gamekeeper.report.audit_text import errors_text, unseen_text, verdicts_of

    if verdicts_of(document, "unseen"):
        screen.note(unseen_text(document, width=screen.width))
    if verdicts_of(document, "error"):
        screen.error(errors_text(document, width=screen.width))
        screen.error(
            "That is a fault of the check, not of the environment: please report it, with "
            "`reason` from --json."
        )


def _manner(document: Mapping[str, Any]) -> str:
    outcomes = {each["outcome"] for each in document["verdicts"]}
    if "broken" in outcomes:
        return "bad"
    return "unsure" if "error" in outcomes or "kept" not in outcomes else "good"


def audit_code(document: Mapping[str, Any], *, fail_on: Severity = "low", strict: bool) -> int:
    """0: kept. 1: broken, at least as bad as `fail_on`. 2: a check failed, or, strictly, unseen."""
    from gamekeeper.core.verdict import SEVERITIES

    bad = SEVERITIES[: SEVERITIES.index(fail_on) + 1]
    verdicts = document["verdicts"]
    if any(x["outcome"] == "broken" and x["severity"] in bad for x in verdicts):
        return 1
    unsure = ("error", "unseen") if strict else ("error",)
    return 2 if any(each["outcome"] in unsure for each in verdicts) else 0


def write_audit(folder: Path, document: Mapping[str, Any]) -> list[str]:
    """Writes `audit.json`, `junit.xml`, `audit.sarif` and a program for each finding.

    Returns:
        The names of the files.
    Raises:
        GamekeeperError: the folder can't be written.
    """
    texts = {
        "audit.json": f"{document_text(document)}\n",
        "junit.xml": junit_of(document),
        "audit.sarif": sarif_of(document),
        **programs_of(document),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return list(texts)


def programs_of(document: Mapping[str, Any]) -> dict[str, str]:
    """The programs of all findings by the names of their files: `GK402.py`, `GK402-2.py`."""
    return {
        f"{each['id']}{f'-{place}' if place > 1 else ''}.py": finding["reproduce"]
        for each in document["verdicts"]
        for place, finding in enumerate(each["findings"], start=1)
        if finding["reproduce"]
    }


def junit_of(*documents: Mapping[str, Any]) -> str:
    """The audits as JUnit XML, the files with the rules named as from here."""
    from gamekeeper.report.junit import junit_xml

    placed = []
    for document in documents:
        source = dict(document.get("source") or {})
        if "file" in source:
            source["file"] = _from_here(source["file"]) or source["file"]
        placed.append({**document, "source": source})
    return junit_xml(placed)


def sarif_of(*documents: Mapping[str, Any]) -> str:
    """The audits as SARIF; files with rules from the current folder, if they lie inside."""
    from gamekeeper.report.sarif import sarif_json

    places: list[str | None] = []
    for document in documents:
        file = (document.get("source") or {}).get("file")
        inside = None if file is None else _from_here(file)
        absolute = None if file is None else Path(file).absolute().as_uri()
        places.append(quote(inside) if inside is not None else absolute)
    version = sys.modules["gamekeeper"].__version__  # the front stands above all layers
    return sarif_json(list(documents), version=version, places=places)


def _from_here(file: str) -> str | None:
    """The path from the current folder; None where the file doesn't lie inside it."""
    try:
        return Path(file).resolve().relative_to(Path.cwd().resolve()).as_posix()
    except ValueError:
        return None


def write_text(path: Path, text: str) -> None:
    """Writes a file, over an earlier one, and makes its folder.

    Raises:
        GamekeeperError: it can't be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise GamekeeperError(
            "the file can't be written",
            where=str(path),
            seen=error.strerror or str(error),
            mend="name a place that you may write to",
        ) from None
