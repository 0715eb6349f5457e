"""`gamekeeper diff A B`: the first place where two runs differ, or what changed in a game."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from gamekeeper.cli._game_diff import diff_games
from gamekeeper.cli._options import KwargsOption, SeedOption, ToleranceOption, json_object
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.cli.audit import BUDGET, BudgetOption, QuickOption, SilenceOption

ORDER: Final = 50
SILENCE_S: Final = 120.0

FirstArgument = Annotated[
    str, typer.Argument(metavar="A", show_default=False, help="A run, or an environment.")
]
SecondArgument = Annotated[
    str, typer.Argument(metavar="B", show_default=False, help="Another one.")
]


def command(
    screen: Screen,
    a: FirstArgument,
    b: SecondArgument,
    tolerance: ToleranceOption = None,
    budget: BudgetOption = BUDGET,
    quick: QuickOption = False,
    seed: SeedOption = 0,
    kwargs: KwargsOption = None,
    timeout: SilenceOption = SILENCE_S,
) -> Answer:
    """Names the first place where two runs differ, or what changed between two environments.

    Of two runs: episode, turn, agent and field, with both values. Of two environments, both are
    audited with one seed and budget, and A's play is replayed in B: roster, spaces, what was
    measured, promises, the first row that differs; then another version (_v1) is due. Exit code
    0: the same. 1: different.
    """
    if Path(a).is_dir() or Path(b).is_dir():
        return _diff_runs(screen, Path(a), Path(b), tolerance)
    return diff_games(
        screen, a, b, tolerance=tolerance, budget=budget, quick=quick, seed=seed,
        env_kwargs=json_object(kwargs, option="--kwargs"), timeout=timeout,
    )  # fmt: skip


def _diff_runs(screen: Screen, a: Path, b: Path, tolerance: float | None) -> Answer:
    from gamekeeper.record.diff import diff
    from gamekeeper.report.text import divergence_text

    divergence = diff(a, b, tolerance=tolerance)
    found = None if divergence is None else divergence.to_json()
    document = {"a": str(a), "b": str(b), "equal": divergence is None, "divergence": found}
    if divergence is None:
        screen.verdict("the same" if tolerance is None else "the same within tolerance", "good")
        return Answer(document)
    text = divergence_text(divergence, sides=(str(a), str(b)), width=screen.width)
    screen.verdict(f"different at {text}", "bad")
    return Answer(document, 1)
