"""`gamekeeper rollout ENV`: plays episodes with policies, and records them as a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from gamekeeper.cli import _options as shared
from gamekeeper.cli._audit import show_failed_rows
from gamekeeper.cli._fan import free_for, is_fanned, record_by_workers
from gamekeeper.cli._options import Count
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli._worker import (
    Recorded,
    evidence_folder,
    plan_of,
    record_in_worker,
    refuse_taken_folder,
)
from gamekeeper.import_guard import unguarded

if TYPE_CHECKING:
    from gamekeeper.episodes.evidence import Evidence

ORDER: Final = 30


@unguarded()  # the user names what is run
def command(
    screen: Screen,
    env: str,
    policy: list[str] | None = None,
    episodes: int = shared.EPISODES,
    seed: int = 0,
    out: Path | None = None,
    level: Literal["full", "digest", "actions"] = "full",
    check: bool = True,
    frames: bool = False,
    contract: Path | None = None,
    kwargs: str | None = None,
    options: str | None = None,
    most_turns: Count | None = None,
    timeout: float = shared.SILENCE_S,
    memory: int | None = None,
    workers: int | None = None,
    executor: str | None = None,
    storage: str | None = None,
) -> CommandResult:
    """Plays episodes, and records them as a run.

    The environment runs in a process of its own: if it raises, hangs or kills the process, the
    steps until then are finalized as a failed run, with the traceback, and the exit code is 1.
    Ctrl-C finalizes the run too. A folder that holds something is refused as --out. With
    --workers, --executor or --storage, ranges of episodes are played in parallel and merged; after
    an interruption the same command continues.

    Example: gamekeeper rollout butterfly/pistonball-v6 --episodes 5 --seed 7

    Args:
        check (--check/--no-check): At level actions, replay the first finished episode in a worker
            meanwhile, and say at once if it diverges; with several workers, play one of eight or
            more episodes again, and say if it depends on those before it.
        most_turns (--most-turns N): Cut an episode after this number of env steps: turns (AEC) or
            ticks (Parallel) (default: 100,000).
        storage (--storage PLACE): Place of the workers' parts: a folder that all workers reach, or
            a URL such as s3://... or gs://... (default: RUN-parts).
    """
    plan = plan_of(
        env,
        policy=policy,
        episodes=episodes,
        seed=seed,
        level=level,
        check=check,
        frames=frames,
        contract=contract,
        kwargs=kwargs,
        options=options,
        most_turns=most_turns,
    )
    if is_fanned(workers, executor, storage):
        with evidence_folder(out, spec=env, is_free=free_for(plan, storage)) as folder:
            recorded = record_by_workers(
                screen,
                plan,
                folder,
                workers=workers,
                executor=executor,
                storage=storage,
                silence_s=timeout,
                memory_mb=memory,
            )
    else:
        refuse_taken_folder(out)
        with evidence_folder(out, spec=env) as folder, screen.progress("recording") as take:
            recorded = record_in_worker(
                plan, folder, silence_s=timeout, memory_mb=memory, on_message=take
            )
    say_end(screen, recorded)
    show_recorded(screen, recorded.evidence)
    verdicts = show_failed_rows(screen, recorded.evidence)
    document = {**rollout_document(recorded), "verdicts": verdicts}
    return CommandResult(document, exit_code(recorded))


def show_recorded(screen: Screen, evidence: Evidence) -> None:
    """Shows what was recorded, agent by agent, and where it lies."""
    from gamekeeper.reporting.results_text import counted, digests_text, summary_text

    screen.show(f"Recorded  {counted(evidence.summary, api=api_of(evidence))}")
    screen.show(summary_text(evidence.summary, width=screen.width))
    screen.show(f"\nSaved in  {evidence.path}\n{digests_text(evidence)}")


def api_of(evidence: Evidence) -> str:
    """The API of a run's environment: "aec" or "parallel"."""
    return str(evidence.manifest["environment"]["api"])


def say_end(screen: Screen, recorded: Recorded) -> None:
    """Says on stderr why a recording ended early, if it did."""
    path = recorded.evidence.path
    if recorded.is_interrupted:
        screen.error(f"interrupted: the steps until then are finalized in {path}")
    elif recorded.error is not None:
        screen.error(f"{type(recorded.error).__name__}: {recorded.error}")
        status = recorded.evidence.manifest.get("status")
        screen.error(f"  recorded up to the last complete step, status {status}: {path}")


def rollout_document(recorded: Recorded) -> dict[str, Any]:
    """The document of a recording; `error` stands in it only where there was one."""
    status = recorded.evidence.manifest.get("status")
    document: dict[str, Any] = {**recorded.evidence.to_json(), "status": status}
    if recorded.is_interrupted:
        document["interrupted"] = True
    if recorded.error is not None:
        document["error"] = recorded.error.to_json()
    if recorded.depends is not None:
        document["depends"] = recorded.depends
    return document


def exit_code(recorded: Recorded) -> int:
    """0: recorded. 1: the environment failed, or an episode depends on others. 130: interrupted."""
    if recorded.is_interrupted:
        return 130
    return 0 if recorded.error is None and recorded.depends is None else 1
