"""Environments run in worker processes; whatever they do there, what was recorded is sealed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import json_object
from gamekeeper.errors import BundleError, EnvError, GamekeeperError
from gamekeeper.record.parts.plan import PLAN, Plan, parts_folder
from gamekeeper.record.told import WorkerFault, error_in
from gamekeeper.run.watch import Outcome
from gamekeeper.run.workers import run_task

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence

__all__ = [
    "MEGABYTE",
    "Plan",
    "Recorded",
    "WorkerFault",
    "error_in",
    "evidence_folder",
    "name_of",
    "plan_of",
    "record_in_worker",
]

RUNS: Final = Path("runs")
"""Where evidence goes that has no folder of its own."""
MEGABYTE: Final = 1_000_000
NAMELESS: Final = ("env.py", "environment.py", "__init__.py", "main.py")
"""Files that are called so in every package: the folder says which one it is."""


def plan_of(
    spec: str,
    *,
    policy: Sequence[str] | None,
    kwargs: str | None,
    options: str | None,
    contract: Path | None,
    **settings: Any,
) -> Plan:
    """The plan that a command line describes.

    Raises:
        GamekeeperError: an option can't be read.
    """
    policies: dict[str, str] = {}
    if policy:
        from gamekeeper.game.policy import parse_choices

        policies = parse_choices(policy)
    return Plan(
        spec=spec,
        env_kwargs=json_object(kwargs, option="--kwargs"),
        policies=policies,
        options=None if options is None else json_object(options, option="--options"),
        contract=None if contract is None else str(contract),
        **settings,
    )


@dataclass(frozen=True, slots=True)
class Recorded:
    """What became of a recording.

    Attributes:
        evidence: what was recorded, sealed.
        error: why it ended early; None where it didn't, or where it was interrupted.
        is_interrupted: by Ctrl-C.
    """

    evidence: Evidence
    error: GamekeeperError | None = None
    is_interrupted: bool = False


def record_in_worker(
    plan: Plan,
    out: Path,
    *,
    silence_s: float,
    memory_mb: int | None,
    on_message: Callable[[dict[str, Any]], None],
) -> Recorded:
    """Records in a process of its own; what an environment breaks there stays broken there.

    Raises:
        GamekeeperError: it couldn't begin, or a policy went wrong; an environment's own failure is
            in what is returned, as long as there is evidence of it.
        KeyboardInterrupt: before there was any evidence.
    """
    outcome = run_task(
        "gamekeeper.record.tasks:record_task",
        {**asdict(plan), "out": str(out)},
        silence_s=silence_s,
        memory_bytes=None if memory_mb is None else memory_mb * MEGABYTE,
        on_message=on_message,
    )
    is_interrupted = outcome.status == "interrupted"
    error = None if is_interrupted else error_in(outcome)
    try:
        evidence = _sealed(out, outcome, error)
    except BundleError as unsealed:
        if error is None:
            raise
        mend = f"{error.mend}; the evidence in {out} can't be sealed either: {unsealed.what}"
        raise type(error)(error.what, where=error.where, seen=error.seen, mend=mend) from unsealed
    if error is not None and (evidence is None or not isinstance(error, EnvError)):
        raise error
    if evidence is None:
        raise KeyboardInterrupt
    return Recorded(evidence, error, is_interrupted)


def _sealed(out: Path, outcome: Outcome, error: GamekeeperError | None) -> Evidence | None:
    """The evidence in `out`, sealed here where the worker didn't get that far."""
    from gamekeeper.record.bundle import load
    from gamekeeper.record.recover import recover

    try:
        evidence = load(out)
    except BundleError:
        return None
    if evidence.manifest.get("status") != "open":
        return evidence
    if error is None:
        return recover(out, status="sealed")
    # The last line says what it was, as in a traceback of Python.
    told = [outcome.traceback, f"{error.what}: {error.seen}".removesuffix(": ")]
    return recover(
        out,
        status="failed",
        error="\n".join(filter(None, told)),
        is_theirs=isinstance(error, EnvError),
    )


def _has_no_parts(folder: Path) -> bool:
    """Whether no recording by workers was begun for this folder."""
    return not (parts_folder(folder) / PLAN).exists()


@contextmanager
def evidence_folder(
    out: Path | None,
    *,
    spec: str,
    is_renamed: bool = False,
    is_free: Callable[[Path], bool] = _has_no_parts,
) -> Iterator[Path]:
    """The folder that evidence will go to, taken away again if nothing came to lie in it.

    Args:
        out: as the user named it; None: the first free `runs/NAME-1`, `-2`, ...
        spec: gives the name.
        is_renamed: a folder that holds something already is left alone, and `out-2`, ... taken.
        is_free: whether nobody else has begun something for a folder that nobody named.
    """
    if out is not None and not (is_renamed and _holds_something(out)):
        yield out
        return
    stem, first = (RUNS / name_of(spec), 1) if out is None else (out, 2)
    folder = _numbered(stem, first, is_free)
    try:
        yield folder
    finally:
        if folder.is_dir() and not _holds_something(folder):
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


def _holds_something(folder: Path) -> bool:
    try:
        return any(folder.iterdir())
    except FileNotFoundError:
        return False
    except OSError:  # a file, or nobody may look: recording into it says what is wrong
        return folder.is_file()


def _numbered(stem: Path, first: int, is_free: Callable[[Path], bool]) -> Path:
    """The first free `stem-N`, made at once, so that two runs side by side get two."""
    if not stem.name:  # `.`, `/`, nothing: recording into it says what is wrong
        return stem
    number = first
    while True:
        folder = stem.with_name(f"{stem.name}-{number}")
        if not is_free(folder):
            number += 1
            continue
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
        except OSError:  # read-only, or no folder: recording into it says what is wrong
            return folder
        else:
            return folder
