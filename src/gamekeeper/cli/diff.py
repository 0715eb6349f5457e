"""`gamekeeper diff A B`: the first place where two runs differ."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from gamekeeper.cli._options import ToleranceOption
from gamekeeper.cli._screen import Answer, Screen

ORDER: Final = 50

FirstArgument = Annotated[Path, typer.Argument(metavar="A", show_default=False, help="A run.")]
SecondArgument = Annotated[
    Path, typer.Argument(metavar="B", show_default=False, help="Another one.")
]


def command(
    screen: Screen, a: FirstArgument, b: SecondArgument, tolerance: ToleranceOption = None
) -> Answer:
    """Names the first place where two runs differ.

    That is an episode, a turn, an agent and a field, with both values. Exit code 0: the same.
    1: different.
    """
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
