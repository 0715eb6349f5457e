"""`gamekeeper run ENV`: structure, quick audit, recording and replay with one command."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Final, Literal

from gamekeeper.cli._audit import audit_code, audit_with_progress, show_failed_rows
from gamekeeper.cli._form import GameForm, look_at, show_form
from gamekeeper.cli._options import EPISODES, SILENCE_S, Count
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli._worker import (
    Recorded,
    evidence_folder,
    plan_of,
    record_in_worker,
    refuse_taken_folder,
)
from gamekeeper.cli.replay import replay_code, show_replayed
from gamekeeper.cli.rollout import api_of, exit_code, rollout_document, say_end
from gamekeeper.errors import GamekeeperError
from gamekeeper.import_guard import unguarded
from gamekeeper.rollouts.rollout_plan import RolloutPlan

if TYPE_CHECKING:
    from gamekeeper.episodes.divergence import Divergence
    from gamekeeper.episodes.evidence import Evidence
    from gamekeeper.runs.comparison import Replay

ORDER: Final = 10
INDENT: Final = "  "
SHOWN_DIGITS: Final = 16
"""Digits of the fingerprint in the verdict; all of it stands below, within 80 columns."""
LEAK: Final = "GK604"
"""Check of what outlives a reset."""
NEAR: Final = "1e-6"
"""Differences up to here, absolute or relative, come from arithmetic; larger ones from rules."""
HUNG_S: Final = 20.0
"""Longest time without a step in the audit that comes first, in seconds: its probe is given up."""
MOST_IDS: Final = 12
"""Most checks that are named as not exercised; `gamekeeper audit` has them all."""
NO_RUN: Final = "no run was written"
MOST_TURNS: Final = 5_000
"""Longest episode of what is a first look, in env steps: some environments never end."""
MOST_FAILED: Final = 5
"""Most failed checks that are shown; `gamekeeper audit` has them all, with programs."""


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    env: str,
    policy: list[str] | None = None,
    episodes: int = EPISODES,
    seed: int = 0,
    out: Path | None = None,
    level: Literal["full", "digest", "actions"] = "full",
    frames: bool = False,
    contract: Path | None = None,
    kwargs: str | None = None,
    options: str | None = None,
    most_turns: Count = MOST_TURNS,
    timeout: float = SILENCE_S,
    memory: int | None = None,
    no_audit: bool = False,
) -> CommandResult:
    """Shows the structure, audits quickly, records episodes and replays them.

    The summary shows return, length and endings of each agent. A folder that holds something is
    refused as --out, before anything is done.

    Exit code 0: no check failed, and the recording was verified. 1: a check failed (episodes are
    recorded all the same), the environment failed, or its replay diverged. 2: no answer.

    Example: gamekeeper run warehouse --policy reference

    Args:
        most_turns (--most-turns N): Cut an episode after this number of env steps: turns (AEC) or
            ticks (Parallel).
        no_audit (--no-audit): Skip the quick audit before the recording: about 6,000 env steps
            beside those of the recording.
    """
    refuse_taken_folder(out)
    plan = plan_of(
        env,
        policy=policy,
        episodes=episodes,
        seed=seed,
        level=level,
        frames=frames,
        contract=contract,
        kwargs=kwargs,
        options=options,
        most_turns=most_turns,
    )
    form = open_here(screen, plan, env, timeout=timeout, kwargs=kwargs)
    audit_line = audit_command(env, kwargs=kwargs, contract=contract)
    audited = None
    if not no_audit:
        with said_if_interrupted(screen, f"interrupted in the audit: {NO_RUN}"):
            audited = audit_here(screen, plan, timeout=timeout, memory_mb=memory, line=audit_line)
    with (
        evidence_folder(out, spec=env) as folder,
        said_if_interrupted(screen, f"interrupted before the first step: {NO_RUN}"),
        screen.progress("recording") as take,
    ):
        recorded = record_in_worker(
            plan, folder, silence_s=timeout, memory_mb=memory, on_message=take
        )
    say_end(screen, recorded)
    show_summary(screen, recorded, seed=seed, most_turns=most_turns)
    failed = (audited or {}).get("verdicts", ())
    known = {each["id"] for each in failed if each["outcome"] == "failed"}
    verdicts = show_failed_rows(screen, recorded.evidence, known=known)
    path = recorded.evidence.path
    is_whole = recorded.error is None and not recorded.is_interrupted
    with said_if_interrupted(screen, f"interrupted in the replay: the run in {path} is complete"):
        replayed = (
            replay_here(screen, recorded, timeout=timeout, failed=known) if is_whole else None
        )
    line = audit_line if _audit_code(audited) == 1 else None
    show_end(screen, recorded, next_command(env, line, recorded, replayed))
    record = {**rollout_document(recorded), "verdicts": verdicts}
    document = _document(form, audited, record, replayed)
    return CommandResult(document, _code(audited, recorded, replayed))


@contextmanager
def said_if_interrupted(screen: Screen, text: str) -> Iterator[None]:
    """Says on stderr what is on the disk, if Ctrl-C ends the block."""
    try:
        yield
    except KeyboardInterrupt:
        screen.error(text)
        raise


def open_here(
    screen: Screen, plan: RolloutPlan, env: str, *, timeout: float, kwargs: str | None
) -> GameForm:
    """Opens the environment, and shows its structure and what it doesn't declare."""
    with said_if_interrupted(screen, f"interrupted before the recording: {NO_RUN}"):
        with screen.progress("opening"):
            form = look_at(
                env,
                env_kwargs=plan.env_kwargs,
                contract=None if plan.contract is None else Path(str(plan.contract)),
                silence_s=timeout,
                policies=plan.portable().policies,
            )
        show_form(screen, form)
        if form.questions:
            show_undeclared(screen, form, env, kwargs=kwargs)
    return form


def audit_command(env: str, *, kwargs: str | None, contract: object) -> str:
    """The command that audits the same environment in full."""
    command = f"gamekeeper audit {quote(env)}"
    command += f" --kwargs {quote(kwargs)}" if kwargs else ""
    return command + (f" --contract {quote(str(contract))}" if contract else "")


def show_undeclared(screen: Screen, form: GameForm, env: str, *, kwargs: str | None) -> None:
    """Counts the properties without a declaration, and shows the command that drafts them."""
    count = len(form.questions)
    noun = "1 property is" if count == 1 else f"{count} properties are"
    command = f"gamekeeper contract {quote(env)}"
    command += f" --kwargs {quote(kwargs)}" if kwargs else ""
    listed = "list them" if form.is_declared else "draft a contract"
    command += "" if form.is_declared else f" --out {quote(contract_file(env, form))}"
    screen.show(f"\n{INDENT}{noun} not declared, and so not checked. To {listed}:")
    screen.show(f"{INDENT * 2}{command}")


def audit_here(
    screen: Screen, plan: RolloutPlan, *, timeout: float, memory_mb: int | None, line: str
) -> dict[str, Any]:
    """Audits with the quick budget, and shows the result in a few lines.

    Args:
        line: the command that shows all of it.
    Returns:
        The audit's document; where the audit itself was given up, its `error`.
    """
    contract = None if plan.contract is None else str(plan.contract)
    try:
        found = audit_with_progress(
            screen,
            str(plan.spec),
            contract=contract,
            quick=True,
            seed=plan.seed,
            env_kwargs=plan.env_kwargs,
            silence_s=min(timeout, HUNG_S),
            memory_mb=memory_mb,
        ).to_json()
    except GamekeeperError as error:  # recording meets it too, and keeps evidence of it
        screen.error(f"{type(error).__name__}: {error}")
        screen.show("\nAudited  given up")
        return {"error": error.to_json()}
    show_audited(screen, found, line=line)
    return found


def show_audited(screen: Screen, document: dict[str, Any], *, line: str) -> None:
    """Shows the counts, the worst failed checks, those not exercised, and the command for all."""
    from gamekeeper.reporting.audit_text import brief_rows, counts_text, verdicts_of
    from gamekeeper.reporting.results_text import few, table_lines
    from gamekeeper.reporting.text_columns import wrapped

    def show(text: str, *, first: str = INDENT) -> None:
        screen.show("\n".join(wrapped(text, screen.width, first=first, rest=INDENT)))

    screen.show("")
    show(f"{document['steps']:,} steps: {counts_text(document)}", first="Audited  ")
    rows = brief_rows(document, most=MOST_FAILED)
    for text in table_lines(rows, width=screen.width) if rows else ():
        screen.show(text)
    ids = [each["id"] for each in verdicts_of(document, "not_exercised")]
    if ids:
        show(f"not exercised, as nothing happened for them to check: {few(ids, most=MOST_IDS)}")
    wanted = ["all findings with their programs"] if rows else []
    wanted += ["why checks were not exercised"] if ids else []
    if wanted:
        screen.show(f"{INDENT}To see {', and '.join(wanted)}:\n{INDENT * 2}{line}")


def show_summary(screen: Screen, recorded: Recorded, *, seed: int, most_turns: int) -> None:
    """Shows what was recorded, agent by agent, and how many episodes were cut at `most_turns`."""
    from gamekeeper.reporting.results_text import counted, summary_text
    from gamekeeper.reporting.text_columns import wrapped

    evidence = recorded.evidence
    summary, api = evidence.summary, api_of(evidence)
    screen.show(f"\nRecorded  {counted(summary, api=api)}, from seed {seed}")
    screen.show(summary_text(summary, width=screen.width))
    table = evidence.episode_table.select(["end", "turns"]).to_pylist()
    count = sum(row["end"] == "cut" and row["turns"] == most_turns for row in table)
    if count:
        text = (
            f"{count} of {len(table)} episodes hadn't ended after {most_turns:,} env "
            f"step{'' if most_turns == 1 else 's'} and "
            "were cut: --most-turns lets them go on; a time limit of the environment truncates"
        )
        screen.show("\n".join(wrapped(text, screen.width, first=INDENT, rest=INDENT)))


def replay_here(
    screen: Screen, recorded: Recorded, *, timeout: float, failed: Collection[str] = ()
) -> Replay:
    """Replays the episodes that were just recorded, and shows the result."""
    from gamekeeper.runs.comparison import replay

    with screen.progress("replaying") as take:
        # Trusted: the user named this environment on the same command line.
        replayed = replay(
            str(recorded.evidence.path), allow_import=True, timeout_s=timeout, on_message=take
        )
    screen.show("\nReplayed in a new process")
    show_replayed(screen, replayed, indent=INDENT, digits=SHOWN_DIGITS)
    if replayed.verified and LEAK in failed:
        screen.show(f"{INDENT}in the recorded order; an episode alone may differ ({LEAK})")
    return replayed


def show_end(screen: Screen, recorded: Recorded, command: str) -> None:
    """Shows the folder of the run, and the one command that is most useful next."""
    from gamekeeper.reporting.results_text import digests_text

    evidence = recorded.evidence
    screen.show(f"\nSaved in  {evidence.path}")
    screen.show(digests_text(evidence))
    screen.show(f"Next      {command}")


def next_command(
    env: str, audit_line: str | None, recorded: Recorded, replayed: Replay | None
) -> str:
    """The command that is most useful next: the first trouble's, else a report of the run.

    Args:
        audit_line: shows the audit's findings; None: no check failed.
        replayed: its replay; None: the recording ended early.
    """
    evidence = recorded.evidence
    if replayed is None:
        return f"gamekeeper show {quote(str(evidence.path))}"
    if audit_line is not None:
        return f"{audit_line}   # the failed checks, each with its fix"
    if replayed.divergence is not None:
        return _after_divergence(env, evidence, replayed.divergence)
    return f"gamekeeper report {quote(str(evidence.path))} --open   # writes and opens report.html"


def _after_divergence(env: str, evidence: Evidence, divergence: Divergence) -> str:
    """Replaying with a tolerance where numbers nearly agree; else a run once it is fixed."""
    if not is_near(divergence.recorded, divergence.replayed):
        return f"gamekeeper run {quote(env)}   # once it is fixed"
    named = f"{quote(str(evidence.path))}{_env_option(env, evidence)}"
    return f"gamekeeper replay {named} --tolerance {NEAR}"


def is_near(one: Any, two: Any) -> bool:
    """Tells if the values differ no more than floating point does between machines."""
    import numpy as np

    try:
        ones, twos = np.asarray(one), np.asarray(two)
        is_float = ones.dtype.kind == twos.dtype.kind == "f" and ones.shape == twos.shape
        near = float(NEAR)
        return is_float and bool(np.allclose(ones, twos, rtol=near, atol=near, equal_nan=True))
    except (TypeError, ValueError):  # values of no one shape
        return False


def contract_file(env: str, form: GameForm) -> str:
    """Name of the contract's file: beside the environment's file it is found automatically."""
    file = re.fullmatch(r"(?:(?:parallel|aec):)?(.+)\.py(?::[^:/\\]+)?", env.strip())
    return f"{file[1] if file else form.name}.toml"


def _env_option(env: str, evidence: Evidence) -> str:
    """The option that `replay` needs where a run names code that isn't installed."""
    is_id = evidence.manifest["environment"].get("kind") == "id"
    return "" if is_id else f" --env {quote(env)}"


def _document(
    form: GameForm, audited: dict[str, Any] | None, record: dict[str, Any], replayed: Replay | None
) -> dict[str, Any]:
    replay = None if replayed is None else replayed.to_json()
    document = {"contract": form.to_json(), "audit": audited, "rollout": record, "replay": replay}
    return {**document, "error": record["error"]} if "error" in record else document


def _code(audited: dict[str, Any] | None, recorded: Recorded, replayed: Replay | None) -> int:
    """The exit code of the recording, the replay or the audit, whichever is worst."""
    code = exit_code(recorded) or (0 if replayed is None else replay_code(replayed))
    return code or _audit_code(audited)


def _audit_code(audited: dict[str, Any] | None) -> int:
    """The exit code of the audit; 0 of one that was given up, which has no checks."""
    return audit_code(audited, strict=False) if audited and "error" not in audited else 0
