"""`gamekeeper diff A B`: the first place where two runs differ, or changes of an environment."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._audit import audit_with_progress
from gamekeeper.cli._options import json_object
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli._worker import record_in_worker
from gamekeeper.cli.audit import BUDGET
from gamekeeper.import_guard import unguarded
from gamekeeper.rollouts.rollout_plan import RolloutPlan

if TYPE_CHECKING:
    from gamekeeper.auditing.result import AuditResult
    from gamekeeper.runs.comparison import Replay

EPISODES: Final = 5
"""Episodes that are recorded in the first environment and replayed in the second."""
MOST_TURNS: Final = 500
DUE: Final = (
    "Results from A and B can't be compared: raise the version in the name and id (_v0 to _v1)."
)
SAME_GAME: Final = "The game is the same: the version in its name can stay."


@unguarded()  # the user names what is run
def diff_games(
    screen: Screen,
    a: str,
    b: str,
    *,
    tolerance: float | None,
    budget: int,
    quick: bool,
    seed: int,
    env_kwargs: Mapping[str, Any],
    timeout: float,
) -> CommandResult:
    """Shows what changed from one environment to the other.

    Raises:
        GamekeeperError: one of them can't be opened, or the first can't be played.
    """
    from gamekeeper.auditing.compare import changes, is_other_game

    options: dict[str, Any] = {"budget": budget, "quick": quick, "seed": seed, "silence_s": timeout}
    audits = [
        audit_with_progress(screen, spec, env_kwargs=env_kwargs, **options) for spec in (a, b)
    ]
    found = changes(*audits)
    replayed = _replayed(
        screen, a, b, tolerance=tolerance, seed=seed, env_kwargs=env_kwargs, timeout=timeout
    )
    is_other = is_other_game(found) or replayed.divergence is not None
    document = {
        "a": a,
        "b": b,
        "equal": not found and not is_other,
        "same_game": not is_other,
        "changes": [each.to_json() for each in found],
        "divergence": None if replayed.divergence is None else replayed.divergence.to_json(),
        "replayed": {"episodes": replayed.episodes, "reason": replayed.reason},
    }
    _show(screen, document, audits, replayed, sides=(a, b))
    return CommandResult(document, 0 if document["equal"] else 1)


def _replayed(
    screen: Screen,
    a: str,
    b: str,
    *,
    tolerance: float | None,
    seed: int,
    env_kwargs: Mapping[str, Any],
    timeout: float,
) -> Replay:
    """The first environment's random play, replayed in the second one."""
    from gamekeeper.runs.comparison import replay

    plan = RolloutPlan(
        spec=a, env_kwargs=env_kwargs, episodes=EPISODES, seed=seed, most_turns=MOST_TURNS
    )
    with tempfile.TemporaryDirectory(prefix="gamekeeper-diff-") as folder:
        run = Path(folder) / "a"
        with screen.progress("recording A") as take:
            recorded = record_in_worker(
                plan, run, silence_s=timeout, memory_mb=None, on_message=take
            )
        if recorded.is_interrupted:
            raise KeyboardInterrupt
        with screen.progress("replaying in B") as take:
            # Trusted: the user named both environments on the command line.
            return replay(
                run,
                env=b,
                tolerance=tolerance,
                allow_import=True,
                timeout_s=timeout,
                on_message=take,
            )


def _show(
    screen: Screen,
    document: Mapping[str, Any],
    audits: list[AuditResult],
    replayed: Replay,
    *,
    sides: tuple[str, str],
) -> None:
    from gamekeeper.reporting.changes_text import changes_text
    from gamekeeper.reporting.results_text import divergence_text

    steps = min(each.steps for each in audits)
    seen = f"by {steps:,} steps of each and {EPISODES} replayed episodes"
    if document["equal"]:
        screen.verdict(f"the same game, {seen}", "good")
        return
    is_same = document["same_game"]
    screen.verdict(
        f"{'the same game, with the changes below' if is_same else 'another game'}, {seen}",
        "unsure" if is_same else "bad",
    )
    text = changes_text(document["changes"], width=screen.width)
    if text:
        screen.show(f"\n{text}")
    if replayed.divergence is not None:
        place = divergence_text(replayed.divergence, sides=("A", "B"), width=screen.width)
        screen.show(f"\nSame seed, same actions: the first row that differs\n  {place}")
    elif replayed.reason is not None:
        screen.show(f"\nSame seed, same actions\n  can't tell: {replayed.reason}")
    else:
        screen.show("\nSame seed, same actions\n  every row is the same")
    screen.show(f"\n{SAME_GAME if is_same else DUE}")


ORDER: Final = 50
SET_UP: Final = "different set-up: the turns of these runs can't be compared"
NEXT: Final = (
    "Record both runs with the same environment, arguments and seeds to compare their turns."
)
SILENCE_S: Final = 120.0


def command(
    screen: Screen,
    a: str,
    b: str,
    tolerance: float | None = None,
    budget: int = BUDGET,
    quick: bool = False,
    seed: int = 0,
    kwargs: str | None = None,
    timeout: float = SILENCE_S,
) -> CommandResult:
    """Shows the first place where two runs differ, or the changes between two environments.

    For two runs: episode, turn, agent and field, with both values; if environment, arguments or
    seeds differ, these, as turns can't be compared then. Two environments are audited
    with the same seed and budget, and episodes of A are replayed in B: agents, spaces, measured
    structure, failed checks, and the first row that differs.

    Exit code 0: the same. 1: different.

    Example: gamekeeper diff runs/warehouse-1 runs/warehouse-2

    Args:
        a (A): Run, or environment.
        b (B): Run or environment to compare with.
    """
    if Path(a).is_dir() or Path(b).is_dir():
        return _diff_runs(screen, Path(a), Path(b), tolerance)
    return diff_games(
        screen,
        a,
        b,
        tolerance=tolerance,
        budget=budget,
        quick=quick,
        seed=seed,
        env_kwargs=json_object(kwargs, option="--kwargs"),
        timeout=timeout,
    )


def _diff_runs(screen: Screen, a: Path, b: Path, tolerance: float | None) -> CommandResult:
    from gamekeeper.reporting.results_text import divergence_text
    from gamekeeper.runs.comparison import diff, different_set_ups
    from gamekeeper.runs.load_run import load

    left, right = load(a), load(b)
    set_ups = different_set_ups(left, right)
    divergence = diff(left, right, tolerance=tolerance)
    document = {
        "a": str(a),
        "b": str(b),
        "equal": divergence is None,
        "comparable": not set_ups,
        "set_up": [each.to_json() for each in set_ups],
        "divergence": None if divergence is None else divergence.to_json(),
    }
    if divergence is None:
        screen.verdict("the same" if tolerance is None else "the same within tolerance", "good")
        return CommandResult(document)
    if set_ups:
        lines = [
            divergence_text(each, sides=(str(a), str(b)), width=screen.width) for each in set_ups
        ]
        screen.verdict("\n".join([SET_UP, *lines, NEXT]), "bad")
        return CommandResult(document, 1)
    text = divergence_text(divergence, sides=(str(a), str(b)), width=screen.width)
    screen.verdict(f"different at {text}", "bad")
    return CommandResult(document, 1)
