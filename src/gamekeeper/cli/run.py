"""`gamekeeper run ENV`: the main job in one go."""

from __future__ import annotations

import re
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._audit import audit_code, audit_with_progress
from gamekeeper.cli._document import error_document
from gamekeeper.cli._form import Form, look_at
from gamekeeper.cli._options import (
    EPISODES,
    SILENCE_S,
    ContractOption,
    EnvArgument,
    EpisodesOption,
    FramesOption,
    KwargsOption,
    LevelOption,
    MemoryOption,
    OutFolderOption,
    PolicyOption,
    ResetOption,
    SeedOption,
    TimeoutOption,
    TurnsOption,
)
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.cli._worker import Plan, Recorded, evidence_folder, plan_of, record_in_worker
from gamekeeper.cli.record import exit_code, record_document, say_end
from gamekeeper.cli.replay import replay_code, show_replayed
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.core.divergence import Divergence
    from gamekeeper.core.evidence import Evidence
    from gamekeeper.record.replay import Replay

ORDER: Final = 10
INDENT: Final = "  "
SHOWN_DIGITS: Final = 16
"""Of the fingerprint in the verdict; all of it stands below, where it fits into 80 columns."""
NEAR: Final = "1e-6"
"""Differences up to here, absolute or relative, come from arithmetic; larger ones from rules."""
MOST_AGENTS: Final = 24
"""Agents whose rows are shown; `gamekeeper show` has them all."""
AUDIT_S: Final = 20.0
"""Longest time of the audit that comes first, in seconds; what nobody saw by then is unseen."""
MOST_BROKEN: Final = 5
"""Broken promises that are shown; `gamekeeper audit` has them all, with programs."""

AuditOption = Annotated[
    bool, typer.Option("--no-audit", help="Record at once, without a quick audit first.")
]


def command(
    screen: Screen,
    env: EnvArgument,
    policy: PolicyOption = None,
    episodes: EpisodesOption = EPISODES,
    seed: SeedOption = 0,
    out: OutFolderOption = None,
    level: LevelOption = "full",
    frames: FramesOption = False,
    contract: ContractOption = None,
    kwargs: KwargsOption = None,
    options: ResetOption = None,
    most_turns: TurnsOption = None,
    timeout: TimeoutOption = SILENCE_S,
    memory: MemoryOption = None,
    no_audit: AuditOption = False,
) -> Answer:
    """Card, quick audit, recording, replay and each agent's part, in one go.

    Where --out holds evidence already, a new folder beside it is taken (FOLDER-2, ...). Exit code
    0: nothing is broken, recorded and verified. 1: a promise is broken (it is recorded all the
    same), the environment failed, or its replay diverged. 2: can't tell.
    """
    plan = plan_of(
        env, policy=policy, episodes=episodes, seed=seed, level=level, frames=frames,
        contract=contract, kwargs=kwargs, options=options, most_turns=most_turns,
    )  # fmt: skip
    with screen.progress("opening"):
        form = look_at(env, env_kwargs=plan.env_kwargs, contract=contract, silence_s=timeout)
    if plan.policies:
        from gamekeeper.game.policy import check_words

        check_words(plan.policies.values(), form.policies)  # rather than after the audit
    show_form(screen, form)
    audited = None
    if not no_audit:
        audited = audit_here(screen, plan, timeout=timeout, memory_mb=memory, kwargs=kwargs)
    with evidence_folder(out, spec=env, is_renamed=True) as folder:
        if out is not None and folder != out:
            screen.note(f"note: {out} holds something already; this run goes to {folder}")
        with screen.progress("recording") as take:
            recorded = record_in_worker(
                plan, folder, silence_s=timeout, memory_mb=memory, on_message=take
            )
    say_end(screen, recorded)
    show_summary(screen, recorded, seed=seed)
    is_whole = recorded.error is None and not recorded.is_interrupted
    replayed = replay_here(screen, recorded, timeout=timeout) if is_whole else None
    show_next(screen, env, form, recorded, replayed)
    document = _document(form, audited, recorded, replayed)
    return Answer(document, _code(audited, recorded, replayed))


def audit_here(
    screen: Screen, plan: Plan, *, timeout: float, memory_mb: int | None, kwargs: str | None
) -> dict[str, Any]:
    """Audits within a few seconds, and shows in as many lines what that came to.

    Returns:
        The audit's document; where the audit itself was given up, its `error`.
    """
    try:
        found = audit_with_progress(
            screen, plan.spec, contract=plan.contract, quick=True, seed=plan.seed,
            env_kwargs=plan.env_kwargs, seconds=AUDIT_S, silence_s=min(timeout, AUDIT_S),
            memory_mb=memory_mb,
        ).to_json()  # fmt: skip
    except GamekeeperError as error:  # recording meets it too, and keeps evidence of it
        screen.error(f"{type(error).__name__}: {error}")
        screen.show("\nAudited  given up")
        return {"error": error_document(error)}
    show_audited(screen, found, kwargs=kwargs, contract=plan.contract)
    return found


def show_audited(
    screen: Screen, document: dict[str, Any], *, kwargs: str | None, contract: str | None
) -> None:
    """Shows the counts, the worst of what is broken, and the command that tells all of it."""
    from gamekeeper.report.audit_text import brief_rows, counts_text
    from gamekeeper.report.text import table_lines

    screen.show(f"\nAudited  {document['steps']:,} steps: {counts_text(document)}")
    rows = brief_rows(document, most=MOST_BROKEN)
    is_late = document["seconds"] >= AUDIT_S
    if is_late:
        screen.show(f"{INDENT}unseen for want of time: it gets {AUDIT_S:.0f} s here")
    if not rows and not is_late:
        return
    for line in table_lines(rows, width=screen.width):
        screen.show(line)
    command = f"gamekeeper audit {quote(document['environment'])}"
    command += f" --kwargs {quote(kwargs)}" if kwargs else ""
    command += f" --contract {quote(contract)}" if contract else ""
    screen.show(f"{INDENT}all of it, with programs that show it:  {command}")


def show_form(screen: Screen, form: Form) -> None:
    """Shows the card's short form."""
    from gamekeeper.report.text import brief_card

    screen.show(
        brief_card(
            form.contract,
            form.agents,
            name=form.name,
            open_questions=len(form.questions),
            width=screen.width,
        )
    )


def show_summary(screen: Screen, recorded: Recorded, *, seed: int) -> None:
    """Shows what was recorded, agent by agent."""
    from gamekeeper.report.text import counted, summary_text

    summary = recorded.evidence.summary
    screen.show(f"\nRecorded  {counted(summary)}, from seed {seed}")
    screen.show(summary_text(summary, width=screen.width, most=MOST_AGENTS))


def replay_here(screen: Screen, recorded: Recorded, *, timeout: float) -> Replay:
    """Replays what was recorded a moment ago, and shows what that came to."""
    from gamekeeper.record.replay import replay

    with screen.progress("replaying") as take:
        # Trusted: the user named this environment on the same command line.
        replayed = replay(
            str(recorded.evidence.path), allow_import=True, timeout_s=timeout, on_message=take
        )
    screen.show("\nReplayed in a fresh process")
    show_replayed(screen, replayed, indent=INDENT, digits=SHOWN_DIGITS)
    return replayed


def show_next(
    screen: Screen, env: str, form: Form, recorded: Recorded, replayed: Replay | None
) -> None:
    """Shows where the evidence is, and the one command that is worth typing next."""
    evidence = recorded.evidence
    if replayed is None:
        command = f"gamekeeper show {quote(str(evidence.path))}"
    elif replayed.divergence is not None:
        command = _after_divergence(env, evidence, replayed.divergence)
    elif not form.is_declared:
        command = f"gamekeeper contract {quote(env)} --out {quote(contract_file(env, form))}"
    else:
        command = f"gamekeeper replay {quote(str(evidence.path))}{_env_option(env, evidence)}"
    screen.show(f"\nEvidence  {evidence.path}")
    screen.show(f"  fingerprint  {evidence.fingerprint}")
    screen.show(f"Next      {command}")


def _after_divergence(env: str, evidence: Evidence, divergence: Divergence) -> str:
    """Replaying with a tolerance where numbers nearly agree; else a run once it is mended."""
    if not is_near(divergence.recorded, divergence.replayed):
        return f"gamekeeper run {quote(env)}   # once it is mended"
    named = f"{quote(str(evidence.path))}{_env_option(env, evidence)}"
    return f"gamekeeper replay {named} --tolerance {NEAR}"


def is_near(one: Any, two: Any) -> bool:
    """Whether the values differ as floating point does between machines, and no more."""
    import numpy as np

    try:
        ones, twos = np.asarray(one), np.asarray(two)
        is_float = ones.dtype.kind == twos.dtype.kind == "f" and ones.shape == twos.shape
        near = float(NEAR)
        return is_float and bool(np.allclose(ones, twos, rtol=near, atol=near, equal_nan=True))
    except (TypeError, ValueError):  # values of no one shape
        return False


def contract_file(env: str, form: Form) -> str:
    """Where a contract is best written: beside the environment's file it is found by itself."""
    file = re.fullmatch(r"(?:(?:parallel|aec):)?(.+)\.py(?::[^:/\\]+)?", env.strip())
    return f"{file[1] if file else form.name}.toml"


def _env_option(env: str, evidence: Evidence) -> str:
    """What `replay` asks for where evidence names code that isn't installed."""
    is_id = evidence.manifest["environment"].get("kind") == "id"
    return "" if is_id else f" --env {quote(env)}"


def _document(
    form: Form, audited: dict[str, Any] | None, recorded: Recorded, replayed: Replay | None
) -> dict[str, Any]:
    record = record_document(recorded)
    replay = None if replayed is None else replayed.to_json()
    document = {"contract": form.to_json(), "audit": audited, "record": record, "replay": replay}
    return {**document, "error": record["error"]} if "error" in record else document


def _code(audited: dict[str, Any] | None, recorded: Recorded, replayed: Replay | None) -> int:
    """The recording's, the replay's or the audit's, whichever is worst."""
    told = exit_code(recorded) or (0 if replayed is None else replay_code(replayed))
    if told or audited is None or "error" in audited:
        return told
    return audit_code(audited, strict=False)
