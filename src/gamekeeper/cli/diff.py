"""`gamekeeper diff A B`: the first place where two runs differ."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from gamekeeper.cli._options import ToleranceOption
from gamekeeper.cli._screen import CommandResult, Screen

ORDER: Final = 50
SET_UP: Final = "different set-up: the turns of these runs can't be compared"
NEXT: Final = (
    "Record both runs with the same environment, arguments and seeds to compare their turns."
)

FirstArgument = Annotated[str, typer.Argument(metavar="A", show_default=False, help="Run.")]
SecondArgument = Annotated[
    str, typer.Argument(metavar="B", show_default=False, help="Run to compare with.")
]


def command(
    screen: Screen, a: FirstArgument, b: SecondArgument, tolerance: ToleranceOption = None
) -> CommandResult:
    """Shows the first place where two runs differ.

    Episode, turn, agent and field, with both values; if environment, arguments or seeds differ,
    these, as turns can't be compared then.

    Exit code 0: the same. 1: different.

    Example: gamekeeper diff runs/warehouse-1 runs/warehouse-2
    """
    from gamekeeper.reporting.results_text import divergence_text
    from gamekeeper.runs.comparison import diff, different_set_ups
    from gamekeeper.runs.load_run import load

    left, right = load(a), load(b)
    set_ups = different_set_ups(left, right)
    divergence = diff(left, right, tolerance=tolerance)
    document = {
        "a": a,
        "b": b,
        "equal": divergence is None,
        "comparable": not set_ups,
        "set_up": [each.to_json() for each in set_ups],
        "divergence": None if divergence is None else divergence.to_json(),
    }
    if divergence is None:
        screen.verdict("the same" if tolerance is None else "the same within tolerance", "good")
        return CommandResult(document)
    if set_ups:
        lines = [divergence_text(each, sides=(a, b), width=screen.width) for each in set_ups]
        screen.verdict("\n".join([SET_UP, *lines, NEXT]), "bad")
        return CommandResult(document, 1)
    text = divergence_text(divergence, sides=(a, b), width=screen.width)
    screen.verdict(f"different at {text}", "bad")
    return CommandResult(document, 1)
