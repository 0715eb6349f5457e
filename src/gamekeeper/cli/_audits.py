"""Several audits side by side: environments by seeds, played by the workers of an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gamekeeper.cli._audit import (
    Severity,
    audit_code,
    junit_of,
    sarif_of,
    write_audit,
    write_text,
)
from gamekeeper.cli._document import document_text
from gamekeeper.cli._screen import Screen
from gamekeeper.cli._worker import MEGABYTE, WorkerFault, name_of
from gamekeeper.errors import GamekeeperError
from gamekeeper.run.executors.choose import executor_of
from gamekeeper.run.executors.task import Limits, Task, stopped_after

TASK: Final = "gamekeeper.cli._audits:audit_task"


def audit_task(
    report: Callable[..., None], *, spec: str, seed: int, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Audits what is named by `spec`, in a process that this one starts.

    Returns:
        The audit's document; or `environment`, `seed` and `error` where there can be none.
    """
    from gamekeeper.audit.front import audit
    from gamekeeper.cli._document import error_document

    try:
        found = audit(
            spec, seed=seed, on_probe=lambda name, place, count: report(probe=name), **options
        )
    except GamekeeperError as error:
        return {"environment": spec, "seed": seed, "error": error_document(error)}
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

    Args:
        options: as in `gk.audit`, as plain JSON.

    Raises:
        KeyboardInterrupt: by Ctrl-C.
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
                    raise KeyboardInterrupt
                if not isinstance(end.value, dict):
                    raise WorkerFault(end.traceback or end.error or end.status)
                found[int(done.key.rpartition("-")[2])] = end.value
                take({"episode": len(found)})
    names = {spec: found[n]["environment"] for n, (spec, _) in enumerate(wanted)
             if "verdicts" in found[n]}  # fmt: skip
    for number, (spec, _) in enumerate(wanted):  # the same name where another seed could be played
        found[number]["environment"] = names.get(spec, found[number]["environment"])
    return [found[number] for number in range(len(wanted))]


def _tasks(wanted: Sequence[tuple[str, int]], options: Mapping[str, Any]) -> Iterator[Task]:
    for number, (spec, seed) in enumerate(wanted):
        given = {"spec": spec, "seed": seed, "options": options}
        yield Task(f"audit-{number:06d}", TASK, given)


def show_audits(screen: Screen, documents: Sequence[Mapping[str, Any]]) -> None:
    """Shows by environment what is broken, and in which seeds."""
    from gamekeeper.report.audits_text import audits_text, unseen_somewhere

    for title, manner, findings in audits_text(documents, width=screen.width):
        screen.verdict(title, manner)
        if findings:
            screen.show(findings)
    worst = next((each for each in documents if audit_code_of(each) == 1), None)
    if worst is not None:
        seen = f"gamekeeper audit {worst['environment']} --seed {worst['seed']}"
        screen.show(f"\nTo see one whole: {seen}; --out FOLDER writes all, with their programs.")
    unseen = unseen_somewhere(documents, width=screen.width)
    if unseen:
        screen.note(unseen)


def audit_code_of(
    document: Mapping[str, Any], *, fail_on: Severity = "low", strict: bool = False
) -> int:
    """The exit code of one audit, also of one that couldn't be made."""
    if "verdicts" not in document:
        return 1 if document["error"]["kind"] == "EnvError" else 2
    return audit_code(document, fail_on=fail_on, strict=strict)


def worst_code(codes: Sequence[int]) -> int:
    """1, something is broken, is worse than 2, it can't be told."""
    return next((code for code in (1, 2) if code in codes), 0)


def write_audits(
    screen: Screen,
    documents: Sequence[Mapping[str, Any]],
    *,
    out: Path | None,
    junit: Path | None,
    sarif: Path | None,
) -> None:
    """Writes what was asked for: a folder for each audit, all of them as JUnit XML and SARIF.

    Raises:
        GamekeeperError: a file can't be written.
    """
    audited = [each for each in documents if "verdicts" in each]
    if junit is not None:
        write_text(junit, junit_of(*audited))
    if sarif is not None:
        write_text(sarif, sarif_of(*audited))
    if out is None:
        return
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
