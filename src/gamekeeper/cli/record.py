"""`gamekeeper record ENV`: episodes played by policies, kept as evidence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._document import error_document
from gamekeeper.cli._fan import (
    ExecutorOption,
    FanOption,
    StorageOption,
    free_for,
    is_fanned,
    record_by_workers,
)
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
from gamekeeper.cli._worker import Recorded, evidence_folder, plan_of, record_in_worker

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence

ORDER: Final = 30


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
    workers: FanOption = None,
    executor: ExecutorOption = None,
    storage: StorageOption = None,
) -> Answer:
    """Plays episodes and keeps them as evidence.

    The environment runs in a process of its own: if it raises, hangs or kills the process, what
    happened until then is sealed as failed, with the traceback, and the exit code is 1. Ctrl-C
    seals too. With --workers, --executor or --storage, ranges of episodes are played side by side
    and merged; stopped, the same command goes on from what is whole.
    """
    plan = plan_of(
        env, policy=policy, episodes=episodes, seed=seed, level=level, frames=frames,
        contract=contract, kwargs=kwargs, options=options, most_turns=most_turns,
    )  # fmt: skip
    if is_fanned(workers, executor, storage):
        with evidence_folder(out, spec=env, is_free=free_for(plan, storage)) as folder:
            recorded = record_by_workers(
                screen, plan, folder, workers=workers, executor=executor, storage=storage,
                silence_s=timeout, memory_mb=memory,
            )  # fmt: skip
    else:
        with evidence_folder(out, spec=env) as folder, screen.progress("recording") as take:
            recorded = record_in_worker(
                plan, folder, silence_s=timeout, memory_mb=memory, on_message=take
            )
    say_end(screen, recorded)
    show_recorded(screen, recorded.evidence)
    return Answer(record_document(recorded), exit_code(recorded))


def show_recorded(screen: Screen, evidence: Evidence) -> None:
    """Shows what was recorded, agent by agent, and where it lies."""
    from gamekeeper.report.text import counted, summary_text

    screen.show(f"Recorded  {counted(evidence.summary)}")
    screen.show(summary_text(evidence.summary, width=screen.width))
    screen.show(f"\nEvidence  {evidence.path}\n  fingerprint  {evidence.fingerprint}")


def say_end(screen: Screen, recorded: Recorded) -> None:
    """Says on stderr why a recording ended early, if it did."""
    path = recorded.evidence.path
    if recorded.is_interrupted:
        screen.error(f"interrupted; what happened until then is sealed in {path}")
    elif recorded.error is not None:
        screen.error(f"{type(recorded.error).__name__}: {recorded.error}")
        status = recorded.evidence.manifest.get("status")
        screen.error(f"  kept up to the last whole turn, status {status}: {path}")


def record_document(recorded: Recorded) -> dict[str, Any]:
    """The document of a recording; `error` stands in it only where there was one."""
    status = recorded.evidence.manifest.get("status")
    document: dict[str, Any] = {**recorded.evidence.to_json(), "status": status}
    if recorded.is_interrupted:
        document["interrupted"] = True
    if recorded.error is not None:
        document["error"] = error_document(recorded.error)
    return document


def exit_code(recorded: Recorded) -> int:
    """0: recorded. 1: the environment failed. 130: interrupted."""
    if recorded.is_interrupted:
        return 130
    return 0 if recorded.error is None else 1
