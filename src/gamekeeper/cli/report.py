"""`gamekeeper report RUN [RUN2 ...]`: one page in one file, from whatever is known of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from gamekeeper.cli._options import MOST
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import GamekeeperError

ORDER: Final = 95
MEGABYTES: Final = 2.5
FRAMES_MEGABYTES: Final = 8.0
MEGABYTE: Final = 1_000_000
"""As `adapters.page` has them; that loads numpy, help doesn't."""

RunsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN", show_default=False,
        help="The run that the page is about, and runs to put beside it.",
    ),
]  # fmt: skip
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Otherwise report.html in this folder."),
]
AuditOption = Annotated[
    Path | None,
    typer.Option("--audit", metavar="FILE", help="What `gamekeeper audit ENV --json` printed."),
]
DiagnosisOption = Annotated[
    Path | None,
    typer.Option(
        "--diagnosis", metavar="FILE", help="Another one than the run's own, which is found."
    ),
]
AttributionOption = Annotated[
    Path | None,
    typer.Option(
        "--attribution", metavar="FILE", help="Another one than the run's own, which is found."
    ),
]
EvaluationOption = Annotated[
    Path | None,
    typer.Option(
        "--evaluation", metavar="FILE", help="evaluation.json of `gamekeeper evaluate`, or its "
        "folder.",
    ),
]  # fmt: skip
EpisodeOption = Annotated[
    list[int] | None,
    typer.Option(
        "--episode", metavar="N", min=0, max=MOST, help="Must be on the page. Repeatable."
    ),
]
BudgetOption = Annotated[
    float,
    typer.Option("--budget", metavar="MB", min=0.0, help="Of episodes that are on the page."),
]
FramesOption = Annotated[
    float, typer.Option("--frames-budget", metavar="MB", min=0.0, help="Of recorded pictures.")
]
TitleOption = Annotated[
    str | None, typer.Option("--title", metavar="TEXT", help="Otherwise the name of the run.")
]


def command(
    screen: Screen,
    runs: RunsArgument,
    out: OutOption = None,
    audit: AuditOption = None,
    diagnosis: DiagnosisOption = None,
    attribution: AttributionOption = None,
    evaluation: EvaluationOption = None,
    episode: EpisodeOption = None,
    budget: BudgetOption = MEGABYTES,
    frames_budget: FramesOption = FRAMES_MEGABYTES,
    title: TitleOption = None,
) -> Answer:
    """Writes one self-contained page: game form, verdicts, agents, player, causes, provenance.

    It asks for nothing from anywhere. What `diagnose`, `attribute` and `label` found out stands in
    the run and is found; what isn't known is named there with the command that finds it out.
    """
    from gamekeeper.adapters.page import report

    path = Path("report.html") if out is None else out
    if path.is_dir():
        raise GamekeeperError(
            "the page is a file, and this is a folder",
            where="--out", seen=str(path), mend=f"--out {path / 'report.html'}",
        )  # fmt: skip
    with screen.progress("reporting"):
        written = report(
            runs[0], path, others=runs[1:], audit=audit, diagnosis=diagnosis,
            attribution=attribution, evaluation=evaluation, episodes=episode or (),
            budget_bytes=round(budget * MEGABYTE),
            frames_bytes=round(frames_budget * MEGABYTE), title=title,
        )  # fmt: skip
    size = written.stat().st_size
    screen.show(f"Report  {written}  ({size / MEGABYTE:.1f} MB)")
    return Answer({"run": str(runs[0]), "report": str(written), "size_bytes": size}, 0)
