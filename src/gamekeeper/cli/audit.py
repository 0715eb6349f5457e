"""`gamekeeper audit ENV`: checks of an environment, each failure with a program that shows it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final

from gamekeeper.cli._audit import (
    Severity,
    audit_code,
    audit_code_of,
    audit_many,
    audit_with_progress,
    make_folder,
    say_not_exercised,
    show_audit,
    show_audits,
    show_illegal_actions_of,
    show_measured,
    show_verdict,
    worst_code,
    write_audit,
    write_audits,
)
from gamekeeper.cli._options import MOST, Accepted, CheckId, Count, Workers, json_object
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.import_guard import unguarded

ORDER: Final = 15
BUDGET: Final = 20_000
"""Environment steps, as `auditing.audit.BUDGET` has it; that loads numpy, help does not."""
SILENCE_S: Final = 120.0
INTERRUPTED: Final = 130


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    env: list[str],
    contract: Path | None = None,
    budget: int = BUDGET,
    quick: bool = False,
    seconds: Annotated[float, Accepted(1.0, MOST)] | None = None,
    seed: int = 0,
    seeds: Count = 1,
    select: list[CheckId] | None = None,
    ignore: list[CheckId] | None = None,
    kwargs: str | None = None,
    out: Path | None = None,
    strict: bool = False,
    fail_on: Severity = "low",
    timeout: float = SILENCE_S,
    memory: int | None = None,
    workers: Workers | None = None,
    executor: str | None = None,
) -> CommandResult:
    """Checks an environment against PettingZoo's rules and its contract.

    Probes play the environment in many ways in a process of its own; checks judge what was
    recorded. Each failed check names a place, a fix and a program that shows it, and that failed in
    five fresh processes; otherwise the check is suspected. Waive a finding with a reason in the
    contract: [waivers] GK503 = "...". Several environments or seeds are audited in parallel, and
    the worst exit code counts.

    Exit code 0: no check failed. 1: a check failed. 2: the audit has no answer.

    Example: gamekeeper audit path/to/my_env.py:make --quick

    Args:
        env (ENV): Environment: warehouse, butterfly/pistonball-v6, path/to/file.py:factory or
            mpe2.simple_spread_v3:parallel_env; or the folder of a run, which is judged as it was
            recorded.
        seconds (--seconds S): Time after which the audit ends with what it knows by then, in
            seconds (default: no limit).
        seeds (--seeds N): Number of audits, each with its own seed: --seed and those after it.
        select (--select ID): Run only checks whose ids begin with ID, or with one of several with
            commas. Repeatable (default: all checks).
        ignore (--ignore ID): Skip checks whose ids begin with ID, or with one of several with
            commas. Repeatable (default: none).
        out (--out FOLDER): Folder for audit.json, junit.xml, audit.sarif and a program for each
            finding (default: no files).
        strict (--strict): Exit with 2 if a check was not exercised, or is suspected.
        fail_on (--fail-on): Lowest severity of a failed check that exits with 1.
        workers (--workers N): Number of worker processes for several audits (default: one per
            core).
    """
    asked: dict[str, Any] = {
        "contract": None if contract is None else str(contract),
        "budget": budget,
        "quick": quick,
        "seconds": seconds,
        "select": _ids(select),
        "ignore": _ids(ignore),
        "silence_s": timeout,
        "env_kwargs": json_object(kwargs, option="--kwargs"),
        "memory_mb": memory,
    }
    exits: dict[str, Any] = {"fail_on": fail_on, "strict": strict}
    if out is not None:
        make_folder(out)
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
    show_verdict(screen, document)
    show_audit(screen, document, is_written=out is not None)
    show_illegal_actions_of(screen, env[0])
    say_not_exercised(screen, document)
    show_measured(screen, document)
    if out is not None:
        screen.note(f"written to {out}: {', '.join(write_audit(out, document))}")
    return CommandResult(document, audit_code(document, **exits) if code is None else code)


def _ids(given: list[CheckId] | None) -> list[str]:
    """Ids of a repeatable option, each of which may hold several with commas."""
    return [each.strip() for text in given or () for each in text.split(",")]


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
