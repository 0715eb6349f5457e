"""`gamekeeper audit ENV`: checks of an environment, each failure with a program that shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from gamekeeper.cli._audit import (
    Severity,
    audit_code,
    audit_code_of,
    audit_many,
    audit_with_progress,
    say_not_exercised,
    show_audit,
    show_audits,
    show_illegal_actions_of,
    show_verdict,
    worst_code,
    write_audit,
    write_audits,
)
from gamekeeper.cli._completion import checks
from gamekeeper.cli._fan import ExecutorOption
from gamekeeper.cli._options import (
    MOST,
    ContractOption,
    KwargsOption,
    MemoryOption,
    SeedOption,
    TimeoutOption,
    json_object,
    workers_option,
)
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.import_guard import unguarded

ORDER: Final = 15
BUDGET: Final = 20_000
"""Environment steps, as `auditing.audit.BUDGET` has it; that loads numpy, help does not."""
SILENCE_S: Final = 120.0
INTERRUPTED: Final = 130

EnvsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="ENV",
        show_default=False,
        help="Environment: warehouse, butterfly/pistonball-v6, path/to/file.py:factory or "
        "mpe2.simple_spread_v3:parallel_env; or the folder of a run, which is judged as it was "
        "recorded.",
    ),
]
SeedsOption = Annotated[
    int,
    typer.Option(
        "--seeds",
        metavar="N",
        min=1,
        max=MOST,
        help="Number of audits, each with its own seed: --seed and those after it.",
    ),
]
BudgetOption = Annotated[
    int,
    typer.Option(
        "--budget",
        metavar="N",
        min=1,
        max=MOST,
        help="Environment steps of the checks; on top, up to half as many (5,000 at most) measure "
        "the game form, and a quarter shrinks findings.",
    ),
]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="Set the budget to 3,000 steps, which miss rare faults.")
]
SecondsOption = Annotated[
    float | None,
    typer.Option(
        "--seconds",
        metavar="S",
        min=1.0,
        max=MOST,
        help="Time after which the audit ends with what it knows by then, in seconds "
        "(default: no limit).",
    ),
]
SelectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--select",
        metavar="ID",
        autocompletion=checks,
        help="Run only checks whose ids begin with ID. Repeatable (default: all checks).",
    ),
]
IgnoreOption = Annotated[
    list[str] | None,
    typer.Option(
        "--ignore",
        metavar="ID",
        autocompletion=checks,
        help="Skip checks whose ids begin with ID. Repeatable (default: none).",
    ),
]
StrictOption = Annotated[
    bool,
    typer.Option("--strict", help="Exit with 2 if a check was not exercised, or is suspected."),
]
FailOption = Annotated[
    Severity, typer.Option("--fail-on", help="Lowest severity of a failed check that exits with 1.")
]
AuditsOption = Annotated[
    int | None,
    workers_option("Number of worker processes for several audits (default: one per core)."),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FOLDER",
        help="Folder for audit.json, junit.xml, audit.sarif and a program for each finding "
        "(default: no files).",
    ),
]


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    env: EnvsArgument,
    contract: ContractOption = None,
    budget: BudgetOption = BUDGET,
    quick: QuickOption = False,
    seconds: SecondsOption = None,
    seed: SeedOption = 0,
    seeds: SeedsOption = 1,
    select: SelectOption = None,
    ignore: IgnoreOption = None,
    kwargs: KwargsOption = None,
    out: OutOption = None,
    strict: StrictOption = False,
    fail_on: FailOption = "low",
    timeout: TimeoutOption = SILENCE_S,
    memory: MemoryOption = None,
    workers: AuditsOption = None,
    executor: ExecutorOption = None,
) -> CommandResult:
    """Checks an environment against PettingZoo's rules and its contract.

    Probes play the environment in many ways in a process of its own; checks judge what was
    recorded. Each failed check names a place, a fix and a program that shows it, and that failed in
    five fresh processes; otherwise the check is suspected. Waive a finding with a reason in the
    contract: [waivers] GK503 = "...". Several environments or seeds are audited in parallel, and
    the worst exit code counts.

    Exit code 0: no check failed. 1: a check failed. 2: the audit has no answer.

    Example: gamekeeper audit path/to/my_env.py:make --quick
    """
    asked: dict[str, Any] = {
        "contract": None if contract is None else str(contract),
        "budget": budget,
        "quick": quick,
        "seconds": seconds,
        "select": select or (),
        "ignore": ignore or (),
        "silence_s": timeout,
        "env_kwargs": json_object(kwargs, option="--kwargs"),
        "memory_mb": memory,
    }
    exits: dict[str, Any] = {"fail_on": fail_on, "strict": strict}
    if len(env) > 1 or seeds > 1:
        documents = audit_many(
            screen, env, range(seed, seed + seeds), workers=workers, executor=executor, **asked
        )
        return _several(screen, documents, out, exits, count=len(set(env)) * seeds)
    code = None
    try:
        document = audit_with_progress(screen, env[0], seed=seed, **asked).to_json()
    except KeyboardInterrupt as interrupted:
        if not hasattr(interrupted, "result"):  # before anything was known
            raise
        document, code = interrupted.result.to_json(), INTERRUPTED
    show_audit(screen, document)
    show_illegal_actions_of(screen, env[0])
    say_not_exercised(screen, document)
    if out is not None:
        screen.note(f"written to {out}: {', '.join(write_audit(out, document))}")
    show_verdict(screen, document)
    return CommandResult(document, audit_code(document, **exits) if code is None else code)


def _several(
    screen: Screen,
    documents: Sequence[Mapping[str, Any]],
    out: Path | None,
    exits: Mapping[str, Any],
    *,
    count: int,
) -> CommandResult:
    """Shows and writes the audits that were done, of `count` that were asked for."""
    show_audits(screen, documents)
    if out is not None:
        write_audits(screen, documents, out)
    if len(documents) < count:
        screen.error(f"interrupted: {len(documents)} of {count} audits were done")
        return CommandResult({"audits": documents}, INTERRUPTED)
    return CommandResult(
        {"audits": documents}, worst_code([audit_code_of(each, **exits) for each in documents])
    )
