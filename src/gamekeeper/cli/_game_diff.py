"""Two environments side by side: both audited, and the play of one replayed in the other."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._audit import audit_with_progress
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.cli._worker import Plan, record_in_worker

if TYPE_CHECKING:
    from gamekeeper.audit.result import Audit
    from gamekeeper.record.replay import Replay

EPISODES: Final = 5
"""Played in the first environment, and replayed in the second."""
MOST_TURNS: Final = 500
DUE: Final = (
    "Results of before can't be compared: another version is due (its name and id, _v0 to _v1)."
)
SAME_GAME: Final = "The game is the same: no other version is due."


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
) -> Answer:
    """Shows what changed from one environment to the other.

    Raises:
        GamekeeperError: one of them can't be opened, or the first can't be played.
    """
    from gamekeeper.audit.compare import changes, is_other_game

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
    return Answer(document, 0 if document["equal"] else 1)


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
    from gamekeeper.record.replay import replay

    plan = Plan(
        spec=a, env_kwargs=env_kwargs, policies={}, episodes=EPISODES, seed=seed, options=None,
        level="full", frames=False, most_turns=MOST_TURNS, contract=None,
    )  # fmt: skip
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
                run, env=b, tolerance=tolerance, allow_import=True, timeout_s=timeout,
                on_message=take,
            )  # fmt: skip


def _show(
    screen: Screen,
    document: Mapping[str, Any],
    audits: list[Audit],
    replayed: Replay,
    *,
    sides: tuple[str, str],
) -> None:
    from gamekeeper.report.changes_text import changes_text
    from gamekeeper.report.text import divergence_text

    steps = min(each.steps for each in audits)
    seen = f"as far as {steps:,} steps of each and {EPISODES} replayed episodes show"
    if document["equal"]:
        screen.verdict(f"the same game, {seen}", "good")
        return
    is_same = document["same_game"]
    screen.verdict(
        f"{'the same game, but for what follows' if is_same else 'another game'}, {seen}",
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
