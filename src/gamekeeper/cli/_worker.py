"""Environments run in worker processes; whatever they do there, their turns are finalized."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import json_object
from gamekeeper.errors import ActionError, EnvError, GamekeeperError, PolicyError, RunError
from gamekeeper.import_guard import unguarded
from gamekeeper.rollouts.rollout_plan import RolloutPlan
from gamekeeper.rollouts.workers import TaskOutcome, run_task
from gamekeeper.runs.parts.part_plan import PLAN, parts_folder
from gamekeeper.runs.worker_errors import error_in

if TYPE_CHECKING:
    from gamekeeper.episodes.evidence import Evidence

RUNS: Final = Path("runs")
"""Folder of runs that are written without --out."""
MEGABYTE: Final = 1_000_000
NAMELESS: Final = ("env.py", "environment.py", "__init__.py", "main.py")
"""Files that have the same name in every package: a run is named by their folder."""


@unguarded()  # the user names what is run
def value_of_task(task: str, arguments: Mapping[str, Any], *, silence_s: float) -> Any:
    """Runs a task in a worker, and returns its value.

    Raises:
        GamekeeperError: the environment can't be opened.
        KeyboardInterrupt: by Ctrl-C.
    """
    outcome = run_task(task, dict(arguments), silence_s=silence_s)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    error = error_in(outcome)
    if error is not None:
        raise error
    return outcome.value


def plan_of(
    spec: str,
    *,
    policy: Sequence[str] | None,
    kwargs: str | None,
    options: str | None,
    contract: Path | None,
    **settings: Any,
) -> RolloutPlan:
    """The plan that a command line describes.

    Raises:
        GamekeeperError: an option can't be read.
    """
    policies: str | dict[str, str] = "random"
    if policy:
        from gamekeeper.interface.policy import parse_choices

        policies = parse_choices(policy)
    return RolloutPlan(
        spec=spec,
        env_kwargs=json_object(kwargs, option="--kwargs"),
        policies=policies,
        options=None if options is None else json_object(options, option="--options"),
        contract=None if contract is None else str(contract),
        **settings,
    )


@dataclass(frozen=True, slots=True)
class Recorded:
    """Result of a recording.

    Attributes:
        error: reason for an early end; None where there is none, or it was interrupted.
        is_interrupted: by Ctrl-C.
        depends: number of an episode that depends on those before it; None: none was found.
    """

    evidence: Evidence
    error: GamekeeperError | None = None
    is_interrupted: bool = False
    depends: int | None = None


def record_in_worker(
    plan: RolloutPlan,
    out: Path,
    *,
    silence_s: float,
    memory_mb: int | None,
    on_message: Callable[[dict[str, Any]], None],
) -> Recorded:
    """Records in a process of its own, so that an environment's crash doesn't end this one.

    Raises:
        GamekeeperError: it couldn't begin, or a policy went wrong; an environment's own failure is
            in what is returned, as long as there is evidence of it.
        KeyboardInterrupt: before there was any evidence.
    """
    outcome = run_task(
        "gamekeeper.runs.worker_tasks:record_task",
        {"plan": plan.to_json(), "out": str(out)},
        silence_s=silence_s,
        memory_bytes=None if memory_mb is None else memory_mb * MEGABYTE,
        on_message=on_message,
    )
    is_interrupted = outcome.status == "interrupted"
    error = None if is_interrupted else error_in(outcome)
    try:
        evidence = _finalized(out, outcome, error)
    except RunError as unfinalized:
        if error is None:
            raise
        fix = f"{error.fix}; the evidence in {out} can't be finalized either: {unfinalized.what}"
        raise type(error)(**{**error.parts(), "fix": fix}) from unfinalized
    if error is not None and evidence is not None and isinstance(error, ActionError | PolicyError):
        raise _placed(error, evidence)
    if error is not None and (evidence is None or not isinstance(error, EnvError)):
        raise error
    if evidence is None:
        raise KeyboardInterrupt
    return Recorded(evidence, error, is_interrupted)


def _placed(error: GamekeeperError, evidence: Evidence) -> GamekeeperError:
    """The error of a policy, with its episode and turn, and the folder of the steps before it."""
    episodes = evidence.episode_table.select(["episode", "turns"]).to_pylist()
    last = episodes[-1] if episodes else {"episode": 0, "turns": 0}
    where = f"episode {last['episode']}, turn {last['turns']}, agent {error.where}"
    fix = f"{error.fix}; the steps until then are recorded in {evidence.path}"
    return type(error)(**{**error.parts(), "where": where, "fix": fix})


def _finalized(out: Path, outcome: TaskOutcome, error: GamekeeperError | None) -> Evidence | None:
    """The evidence in `out`, finalized here where the worker didn't get that far."""
    from gamekeeper.runs.load_run import load
    from gamekeeper.runs.run_check import recover

    try:
        evidence = load(out)
    except RunError:
        return None
    if evidence.manifest.get("status") != "open":
        return evidence
    if error is None:
        return recover(out, status="finalized")
    # The last line names the error, as in a traceback of Python.
    lines = [outcome.traceback, f"{error.what}: {error.actual}".removesuffix(": ")]
    return recover(
        out,
        status="failed",
        error="\n".join(filter(None, lines)),
        is_theirs=isinstance(error, EnvError),
    )


def _has_no_parts(folder: Path) -> bool:
    """Tells if workers have not begun a recording for this folder."""
    return not (parts_folder(folder) / PLAN).exists()


def refuse_taken_folder(out: Path | None) -> None:
    """Refuses a folder for a run that holds something, before any work is done for it.

    Raises:
        RunError: something lies in it.
    """
    from gamekeeper.runs.files.folder import refuse_taken

    try:
        is_taken = out is not None and any(out.iterdir())
    except OSError:  # no folder, or unreadable: recording into it says what is wrong
        return
    if out is not None and is_taken:
        refuse_taken(out)


@contextmanager
def evidence_folder(
    out: Path | None, *, spec: str, is_free: Callable[[Path], bool] = _has_no_parts
) -> Iterator[Path]:
    """Yields the folder for a run; a folder that stays empty is removed at the end.

    Args:
        out: as the user named it; None: the first free `runs/NAME-1`, `-2`, ...
        spec: gives the name.
        is_free: tells if a folder that the user didn't name is free.
    """
    if out is not None:
        yield out
        return
    folder = _numbered(RUNS / name_of(spec), is_free)
    try:
        yield folder
    finally:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


def name_of(spec: str) -> str:
    """The name of an environment in what a user typed, fit for a folder.

    `butterfly/pistonball-v6`: pistonball-v6; `mpe2.simple_spread_v3:parallel_env`:
    simple_spread_v3; `path/to/line.py:make`: line; `src/my_task/env.py:MyTask`: my_task.
    """
    bare = re.sub(r"^(parallel|aec):", "", spec.strip())
    place = re.sub(r":[^:/\\]*$", "", bare)
    *folders, last = re.split(r"[/\\]", place)
    if last in NAMELESS and folders:
        last = f"{folders[-1]}.py"
    last = last.removesuffix(".py") if last.endswith(".py") else last.rpartition(".")[2]
    return re.sub(r"[^\w.-]+", "_", last).strip("._-") or "run"


def _numbered(stem: Path, is_free: Callable[[Path], bool]) -> Path:
    """Makes the first free `stem-N` at once, so that two parallel runs get two folders."""
    for number in count(1):
        folder = stem.with_name(f"{stem.name}-{number}")
        if not is_free(folder):
            continue
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError:  # read-only, or no folder: recording into it says what is wrong
            break
        break
    return folder
