"""`gamekeeper audit ENV`: what an environment promises, looked at; what it breaks, shown."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from gamekeeper.cli._audit import (
    Severity,
    audit_code,
    audit_with_progress,
    junit_of,
    sarif_of,
    say_unseen,
    show_audit,
    write_audit,
    write_text,
)
from gamekeeper.cli._audits import (
    audit_code_of,
    audit_many,
    show_audits,
    worst_code,
    write_audits,
)
from gamekeeper.cli._fan import ExecutorOption, FanOption
from gamekeeper.cli._options import (
    MOST,
    MOST_S,
    ContractOption,
    KwargsOption,
    MemoryOption,
    SeedOption,
    json_object,
)
from gamekeeper.cli._screen import Answer, Screen

ORDER: Final = 15
BUDGET: Final = 20_000
"""Environment steps, as `gamekeeper.audit.audit.BUDGET` has it; that loads numpy, help doesn't."""
SILENCE_S: Final = 120.0

EnvsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="ENV",
        show_default=False,
        help="mpe2.simple_spread_v3:parallel_env · path/to/file.py:factory · "
        "butterfly/pistonball-v6 · warehouse; parallel: or aec: in front asks for an API.",
    ),
]
SeedsOption = Annotated[
    int,
    typer.Option(
        "--seeds", metavar="N", min=1, max=MOST, help="Audits with so many seeds, from --seed on."
    ),
]
BudgetOption = Annotated[
    int,
    typer.Option("--budget", metavar="N", min=1, max=MOST, help="Environment steps of all probes."),
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="A budget of 3,000 steps: rare faults stay unseen.")
]
SelectOption = Annotated[
    list[str] | None,
    typer.Option("--select", metavar="ID", help="Only checks whose ids begin so. Repeatable."),
]
IgnoreOption = Annotated[
    list[str] | None,
    typer.Option("--ignore", metavar="ID", help="All checks but those. Repeatable."),
]
JunitOption = Annotated[
    Path | None,
    typer.Option("--junit", metavar="FILE", help="Also as JUnit XML, a test for each check."),
]
SarifOption = Annotated[
    Path | None, typer.Option("--sarif", metavar="FILE", help="Also as SARIF 2.1.0.")
]
TimingsOption = Annotated[bool, typer.Option("--timings", help="Also say what each probe took.")]
StrictOption = Annotated[bool, typer.Option("--strict", help="What nobody saw exits with 2.")]
FailOption = Annotated[
    Severity, typer.Option("--fail-on", help="The least severity that exits with 1.")
]
SilenceOption = Annotated[
    float,
    typer.Option(
        "--timeout",
        metavar="S",
        min=0.1,
        max=MOST_S,
        help="Seconds without a step that count as hung.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER",
        help="Writes audit.json, junit.xml, audit.sarif and a program for each finding there.",
    ),
]  # fmt: skip


def command(
    screen: Screen,
    env: EnvsArgument,
    contract: ContractOption = None,
    budget: BudgetOption = BUDGET,
    quick: QuickOption = False,
    seed: SeedOption = 0,
    seeds: SeedsOption = 1,
    select: SelectOption = None,
    ignore: IgnoreOption = None,
    kwargs: KwargsOption = None,
    out: OutOption = None,
    junit: JunitOption = None,
    sarif: SarifOption = None,
    timings: TimingsOption = False,
    strict: StrictOption = False,
    fail_on: FailOption = "low",
    timeout: SilenceOption = SILENCE_S,
    memory: MemoryOption = None,
    workers: FanOption = None,
    executor: ExecutorOption = None,
) -> Answer:
    """Finds the promises that an environment breaks, each with a program that shows it.

    Probes play it in many ways in a process of its own, checks judge what they saw: PettingZoo's
    promises, and what the contract declares. Exit code 0: kept. 1: something is broken. 2: it
    can't be told. Waive a finding with its reason in the contract: [waivers] GK503 = "...". Several
    environments or seeds are audited side by side, and the worst exit code counts.
    """
    asked: dict[str, Any] = {
        "contract": None if contract is None else str(contract), "budget": budget, "quick": quick,
        "select": select or (), "ignore": ignore or (), "silence_s": timeout,
        "env_kwargs": json_object(kwargs, option="--kwargs"), "memory_mb": memory,
    }  # fmt: skip
    files: dict[str, Any] = {"out": out, "junit": junit, "sarif": sarif}
    if len(env) > 1 or seeds > 1:
        documents = audit_many(
            screen, env, range(seed, seed + seeds), workers=workers, executor=executor, **asked
        )
        show_audits(screen, documents)
        if timings:
            screen.note("note: --timings changes nothing of several audits; they stand in --json")
        write_audits(screen, documents, **files)
        codes = [audit_code_of(each, fail_on=fail_on, strict=strict) for each in documents]
        return Answer({"audits": documents}, worst_code(codes))
    document = audit_with_progress(screen, env[0], seed=seed, **asked).to_json()
    show_audit(screen, document)
    if timings:
        from gamekeeper.report.audit_text import timings_text

        screen.show(f"\n{timings_text(document, width=screen.width)}")
    say_unseen(screen, document)
    _write(screen, document, **files)
    return Answer(document, audit_code(document, fail_on=fail_on, strict=strict))


def _write(
    screen: Screen,
    document: Mapping[str, Any],
    *,
    out: Path | None,
    junit: Path | None,
    sarif: Path | None,
) -> None:
    if junit is not None:
        write_text(junit, junit_of(document))
    if sarif is not None:
        write_text(sarif, sarif_of(document))
    if out is not None:
        screen.note(f"written to {out}: {', '.join(write_audit(out, document))}")
