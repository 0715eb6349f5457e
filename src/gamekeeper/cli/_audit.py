"""Audits on the command line: run with progress, shown worst first, written as files."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, Final, Literal
from urllib.parse import quote

from gamekeeper._version import __version__
from gamekeeper.cli._screen import AROUND, Screen, document_text, fitted
from gamekeeper.cli._worker import MEGABYTE, name_of
from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.executors import executor_of
from gamekeeper.rollouts.executors.task import Limits, WorkTask, stopped_after
from gamekeeper.runs.worker_errors import WorkerFault

if TYPE_CHECKING:
    from gamekeeper.auditing.result import AuditResult
    from gamekeeper.episodes.evidence import Evidence
import time

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.text import Text

# -- Progress on a terminal: the probe that runs, and an estimate of the time left

TIMES: Final = len(" 0:00:00 about 1234 s left")
"""Columns of time and time left, which aren't shortened."""
ESTIMATED_FROM: Final = 0.15
"""Part of the work from which the time left is estimated."""

OnProbe = Callable[[str, int, int], None]


@contextmanager
def probing(
    shares: Mapping[str, float], *, is_shown: bool, console: Console | None = None
) -> Iterator[OnProbe]:
    """Shows a line on stderr; yields the function that an audit calls before each probe.

    Args:
        shares: shares of the probes that will run, in their order.
        is_shown: False: nothing is written.
        console: in place of stderr's.
    """
    if not is_shown:
        yield lambda name, place, count: None
        return
    console = console or Console(stderr=True)
    columns = (
        SpinnerColumn(),
        TextColumn("auditing"),
        bar := BarColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        _Left(),
    )
    total = sum(shares.values()) or 1.0
    room = console.width - AROUND - len("auditing") - TIMES
    with Progress(*columns, console=console, transient=True) as progress:
        start = fitted(bar, ["starting"], room)
        task = progress.add_task(start, total=total, since_s=time.monotonic(), part=0.0)

        def take(name: str, place: int, count: int) -> None:
            done = sum(list(shares.values())[:place])
            counts = f"({place + 1} of {count})"
            progress.update(
                task,
                completed=done,
                description=fitted(bar, [f"{name} {counts}", counts], room),
                since_s=time.monotonic(),
                part=done / total,
            )

        yield take


class _Left(ProgressColumn):
    """Estimate of the time left, by the shares of the probes that are done."""

    def render(self, task: Task) -> Text:
        """Renders `about 12 s left`; empty at the beginning."""
        part, elapsed_s = task.fields["part"], task.elapsed or 0.0
        if part < ESTIMATED_FROM:
            return Text("")
        within_s = time.monotonic() - task.fields["since_s"]
        left_s = (elapsed_s - within_s) * (1 - part) / part - within_s
        return Text(f"about {left_s:.0f} s left" if left_s >= 1 else "nearly done")


Severity = Literal["high", "medium", "low"]

MOST_LINES: Final = 40
"""Lines of a program that is shown on the screen."""
MANNERS: Final = {"high": "bad", "medium": "bad", "consequences": "bad", "low": "unsure"}


def audit_with_progress(
    screen: Screen,
    spec: str,
    *,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    memory_mb: int | None = None,
    **options: Any,
) -> AuditResult:
    """Audits an environment in a process of its own; `options` as in `gk.audit`.

    Raises:
        GamekeeperError: it can't be audited.
        KeyboardInterrupt: by Ctrl-C.
    """
    from gamekeeper.auditing.audit_process import audit

    is_dumb = os.environ.get("TERM") == "dumb"
    is_shown = not screen.is_quiet and sys.stderr.isatty() and not is_dumb
    shares = shares_of(select, ignore) if is_shown else {}
    with probing(shares, is_shown=is_shown) as take:
        return audit(
            spec,
            select=select,
            ignore=ignore,
            on_probe=take,
            say=screen.note,
            memory_bytes=None if memory_mb is None else memory_mb * MEGABYTE,
            **options,
        )


def shares_of(select: Sequence[str], ignore: Sequence[str]) -> dict[str, float]:
    """The probes that these checks need, and their shares of the budget."""
    from gamekeeper.auditing.audit import needed
    from gamekeeper.auditing.probe import probes
    from gamekeeper.checks.check import selected

    names = needed(selected(tuple(select), tuple(ignore)), is_all=not select)
    return {name: probe.share for name, probe in probes(names).items()}


def show_audit(screen: Screen, document: Mapping[str, Any], *, is_written: bool) -> None:
    """Shows failed checks and a program, then suspected, minor and waived ones.

    Args:
        is_written: the programs of all findings are written to a folder.
    """
    from gamekeeper.checks.check import checks
    from gamekeeper.reporting.audit_text import (
        minor_text,
        program_of,
        suspected_text,
        verdicts_of,
        waived_text,
    )

    width = screen.width
    source = document.get("source") or {}
    if source.get("file") and verdicts_of(document, "failed", "suspected"):
        screen.show(f"  source: {source['file']}:{source.get('line', 1)}")
    show_failed(screen, document)
    program = program_of(document)
    if program is not None:
        id, text = program
        if text.count("\n") <= MOST_LINES:
            screen.show(f"\nA program that shows {id}: it passes once that is fixed")
            screen.program(text)
        others = "" if is_written else "  --out FOLDER writes the programs of all findings.\n"
        screen.show(f"\n{others}  gamekeeper explain {id} says why it matters.")
    known = checks().keys()
    parts = (
        suspected_text(document, width=width),
        minor_text(document, width=width),
        waived_text(document, known=known, width=width),
    )
    for part in filter(None, parts):
        screen.show(f"\n{part}")


def show_verdict(screen: Screen, document: Mapping[str, Any]) -> None:
    """Shows the result of an audit in its first line: the environment and the numbers of checks."""
    from gamekeeper.reporting.audit_text import title_text

    screen.verdict(title_text(document, width=screen.width), _manner(document))
    if document["stopped"]:
        screen.show(f"This audit is incomplete: {document['stopped']}.")


def show_measured(screen: Screen, document: Mapping[str, Any]) -> None:
    """Shows what an audit measured, behind its findings."""
    from gamekeeper.reporting.measured_text import measured_text

    text = measured_text(document, width=screen.width)
    if text:
        screen.show(f"\n{text}")


def show_failed(screen: Screen, document: Mapping[str, Any]) -> None:
    """Shows the failed checks, grouped by severity; files are named from the current folder."""
    from gamekeeper.reporting.audit_text import failed_blocks

    for heading, text in failed_blocks(_placed(document), width=screen.width):
        screen.show("")
        screen.verdict(heading, MANNERS[heading.split()[1]])
        screen.show(text)


def show_failed_rows(
    screen: Screen, evidence: Evidence, *, known: Collection[str] = ()
) -> list[dict[str, Any]]:
    """Shows the rules that the rows of a run break, but for `known` ids; returns their verdicts."""
    from gamekeeper.auditing.recorded_evidence import failed_rows
    from gamekeeper.reporting.audit_text import rows_text

    verdicts = [each.to_json() for each in failed_rows(evidence) if each.id not in known]
    if verdicts:
        run = shlex.quote(str(evidence.path))
        screen.show(f"\n{rows_text(verdicts, run, width=screen.width)}")
    show_illegal_actions(screen, evidence)
    return verdicts


def show_illegal_actions_of(screen: Screen, spec: str) -> None:
    """Shows them of a recorded run; of an environment there are none."""
    from gamekeeper.auditing.recorded_evidence import is_run
    from gamekeeper.runs.load_run import load

    if is_run(spec):
        show_illegal_actions(screen, load(spec))


def show_illegal_actions(screen: Screen, evidence: Evidence) -> None:
    """Shows the actions that their mask forbids, or that are out of their space."""
    from gamekeeper.auditing.recorded_evidence import masked_actions, outside_actions
    from gamekeeper.reporting.audit_text import masked_text, outside_text

    for text in (
        masked_text(masked_actions(evidence), width=screen.width),
        outside_text(outside_actions(evidence), width=screen.width),
    ):
        if text:
            screen.show(f"\n{text}")


def say_not_exercised(screen: Screen, document: Mapping[str, Any]) -> None:
    """Counts checks not exercised or on few cases, and shows checks that raised, on stderr."""
    from gamekeeper.reporting.audit_text import (
        chances_text,
        errors_text,
        not_exercised_text,
        verdicts_of,
    )

    if verdicts_of(document, "not_exercised"):
        screen.note(f"\n{not_exercised_text(document, width=screen.width)}")
    chances = chances_text(document, width=screen.width)
    if chances:
        screen.note(chances)
    if verdicts_of(document, "error"):
        screen.error(errors_text(document, width=screen.width))
        screen.error(
            "This is a fault of the check, not of the environment: please report it, with "
            "`reason` from --json."
        )


def _manner(document: Mapping[str, Any]) -> str:
    outcomes = {each["outcome"] for each in document["verdicts"]}
    if "failed" in outcomes:
        return "bad"
    is_unsure = document["stopped"] or outcomes & {"error", "suspected"} or "passed" not in outcomes
    return "unsure" if is_unsure else "good"


def audit_code(document: Mapping[str, Any], *, fail_on: Severity = "low", strict: bool) -> int:
    """Returns 0: passed. 1: failed, as bad as `fail_on`. 2: an error, or ended with no answer yet.

    If strict, 2 is for suspected checks and those that were not exercised too.
    """
    from gamekeeper.checks.verdict import SEVERITIES

    bad = SEVERITIES[: SEVERITIES.index(fail_on) + 1]
    verdicts = document["verdicts"]
    if any(x["outcome"] == "failed" and x["severity"] in bad for x in verdicts):
        return 1
    unsure = {"error", "not_exercised", "suspected"} if strict else {"error"}
    outcomes = {each["outcome"] for each in verdicts}
    has_answer = not document["stopped"] or outcomes & {"passed", "failed", "waived"}
    return 2 if outcomes & unsure or not has_answer else 0


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
        f"{each['id']}{f'-{place}' if place > 1 else ''}.py": finding["reproducer"]
        for each in document["verdicts"]
        for place, finding in enumerate(each["findings"], start=1)
        if finding["reproducer"]
    }


def junit_of(*documents: Mapping[str, Any]) -> str:
    """The audits as JUnit XML; source files are named from the current folder."""
    from gamekeeper.reporting.audit_formats import junit_xml

    placed = []
    for document in documents:
        source = dict(document.get("source") or {})
        if "file" in source:
            source["file"] = _from_here(source["file"]) or source["file"]
        placed.append({**document, "source": source})
    return junit_xml(placed)


def sarif_of(*documents: Mapping[str, Any]) -> str:
    """The audits as SARIF; source files inside the current folder are named from there."""
    from gamekeeper.reporting.audit_formats import sarif_json

    def address(file: str) -> str:
        inside = _from_here(file)
        return Path(file).absolute().as_uri() if inside is None else quote(inside)

    return sarif_json(list(documents), version=__version__, address=address)


def _placed(document: Mapping[str, Any]) -> dict[str, Any]:
    """The audit with lines of files in the current folder named from there."""

    def placed(line: str) -> str:
        file, _, number = line.rpartition(":")
        return f"{_from_here(file) or file}:{number}"

    def finding(each: Mapping[str, Any]) -> dict[str, Any]:
        return {**each, "lines": [placed(line) for line in each.get("lines") or ()]}

    verdicts = [{**x, "findings": [*map(finding, x["findings"])]} for x in document["verdicts"]]
    return {**document, "verdicts": verdicts}


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
    with _written("file", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", errors="replace")


def make_folder(folder: Path) -> None:
    """Makes the folder of `--out`, before the work whose results are to go there.

    Raises:
        GamekeeperError: it can't be made, or no file in it.
    """
    with _written("folder", folder):
        folder.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=folder).close()


@contextmanager
def _written(what: str, path: Path) -> Iterator[None]:
    """Tells what the system says against writing."""
    try:
        yield
    except OSError as error:
        raise GamekeeperError(
            f"the {what} can't be written",
            where=str(path),
            actual=error.strerror or str(error),
            fix="name a place that you may write to",
        ) from None


TASK: Final = "gamekeeper.cli._audit:audit_task"


def audit_task(
    report: Callable[..., None], *, spec: str, seed: int, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Audits an environment, in a worker process.

    Returns:
        The audit's document; or `environment`, `seed` and `error` where there can be none.
    """
    from gamekeeper.auditing.audit_process import audit

    try:
        found = audit(
            spec, seed=seed, on_probe=lambda name, place, count: report(probe=name), **options
        )
    except GamekeeperError as error:
        return {"environment": spec, "seed": seed, "error": error.to_json()}
    return dict(found.to_json())


def audit_many(
    screen: Screen,
    specs: Sequence[str],
    seeds: Sequence[int],
    *,
    workers: int | None,
    executor: str | None,
    memory_mb: int | None,
    **options: Any,
) -> list[dict[str, Any]]:
    """The documents of all environments' audits with all seeds, in that order.

    After Ctrl-C those that were done by then.

    Args:
        options: as in `gk.audit`, as plain JSON.
    Raises:
        KeyboardInterrupt: by Ctrl-C, before one was done.
        WorkerFault: a task of ours is broken.
    """
    wanted = [(spec, seed) for spec in dict.fromkeys(specs) for seed in seeds]
    given = {**options, "memory_bytes": None if memory_mb is None else memory_mb * MEGABYTE}
    found: dict[int, dict[str, Any]] = {}
    limits = Limits(silence_s=None)  # each audit watches over a process of its own
    with executor_of(executor or "local", workers) as players, screen.progress("auditing") as take:
        take({"episode": 0, "episodes": len(wanted), "unit": "audits"})
        with stopped_after(players.map(_tasks(wanted, given), limits=limits)) as ends:
            for done in ends:
                end = done.outcome
                if end.status == "interrupted":
                    break
                if not isinstance(end.value, dict):
                    raise WorkerFault(end.traceback or end.error or end.status)
                found[int(done.key.rpartition("-")[2])] = end.value
                take({"episode": len(found)})
    names = {
        spec: found[n]["environment"]
        for n, (spec, _) in enumerate(wanted)
        if "verdicts" in found.get(n, {})
    }
    if not found:
        raise KeyboardInterrupt
    for number, document in found.items():  # the same name where another seed could be played
        document["environment"] = names.get(wanted[number][0], document["environment"])
    return [found[number] for number in sorted(found)]


def _tasks(wanted: Sequence[tuple[str, int]], options: Mapping[str, Any]) -> Iterator[WorkTask]:
    for number, (spec, seed) in enumerate(wanted):
        given = {"spec": spec, "seed": seed, "options": options}
        yield WorkTask(f"audit-{number:06d}", TASK, given)


def show_audits(screen: Screen, documents: Sequence[Mapping[str, Any]]) -> None:
    """Shows the failed checks of each environment, and the seeds in which they failed."""
    from gamekeeper.reporting.audit_text import audits_text, not_exercised_somewhere

    for title, manner, findings in audits_text(documents, width=screen.width):
        screen.verdict(title, manner)
        if findings:
            screen.show(findings)
    worst = next((each for each in documents if audit_code_of(each) == 1), None)
    if worst is not None:
        command = f"gamekeeper audit {worst['environment']} --seed {worst['seed']}"
        screen.show(f"\nFor one in full: {command}; --out FOLDER writes all, with their programs.")
    not_exercised = not_exercised_somewhere(documents, width=screen.width)
    if not_exercised:
        screen.note(not_exercised)


def audit_code_of(
    document: Mapping[str, Any], *, fail_on: Severity = "low", strict: bool = False
) -> int:
    """The exit code of one audit, also of one that couldn't be made."""
    if "verdicts" not in document:
        return 1 if document["error"]["kind"] == "EnvError" else 2
    return audit_code(document, fail_on=fail_on, strict=strict)


def worst_code(codes: Sequence[int]) -> int:
    """The worst exit code: 1, a check failed, is worse than 2, no answer."""
    return next((code for code in (1, 2) if code in codes), 0)


def write_audits(screen: Screen, documents: Sequence[Mapping[str, Any]], out: Path) -> None:
    """Writes a folder for each audit, and all of them as JUnit XML and SARIF.

    Raises:
        GamekeeperError: a file can't be written.
    """
    audited = [each for each in documents if "verdicts" in each]
    texts = {"audits.json": f"{document_text({'audits': list(documents)})}\n"}
    if audited:
        texts |= {"junit.xml": junit_of(*audited), "audit.sarif": sarif_of(*audited)}
    for name, text in texts.items():
        write_text(out / name, text)
    specs = list(dict.fromkeys(str(each["environment"]) for each in documents))
    names = _names(specs)
    for each in audited:
        write_audit(out / names[each["environment"]] / f"seed-{each['seed']}", each)
    screen.note(f"written to {out}: {', '.join(texts)}, and a folder for each audit")


def _names(specs: Sequence[str]) -> dict[str, str]:
    """A folder's name for each environment, numbered where two are called the same."""
    found: dict[str, str] = {}
    for spec in specs:
        name, number = name_of(spec), 2
        while name in found.values():
            name, number = f"{name_of(spec)}-{number}", number + 1
        found[spec] = name
    return found
