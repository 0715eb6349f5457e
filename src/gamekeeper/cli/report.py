"""`gamekeeper report RUN [RUN2 ...]`: one HTML page about a run, in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from gamekeeper.cli._options import MOST
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.view import has_display
from gamekeeper.errors import GamekeeperError

ORDER: Final = 97
MEGABYTES: Final = 2.5
FRAMES_MEGABYTES: Final = 8.0
MEGABYTE: Final = 1_000_000
"""Defaults of `viewing.report_file`; importing that loads numpy, help doesn't."""

RunsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN",
        show_default=False,
        help="Run that the page is about, and runs to compare it with.",
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="FILE", help="HTML file to write (default: ./report.html)."
    ),
]
AuditOption = Annotated[
    Path | None,
    typer.Option(
        "--audit",
        metavar="FILE",
        help="Output of `gamekeeper audit ENV --json` (default: no audit on the page).",
    ),
]
DiagnosisOption = Annotated[
    Path | None,
    typer.Option(
        "--diagnosis",
        metavar="FILE",
        help="Output of `gamekeeper diagnose RUN --json` (default: the run's own, if it has one).",
    ),
]
AttributionOption = Annotated[
    Path | None,
    typer.Option(
        "--attribution",
        metavar="FILE",
        help="Output of `gamekeeper attribute RUN --json` (default: the run's own, if it has one).",
    ),
]
PivotsOption = Annotated[
    Path | None,
    typer.Option(
        "--pivots",
        metavar="FILE",
        help="Output of `gamekeeper pivots RUN --json`, for the timeline (default: the run's own, "
        "if it has one).",
    ),
]
EvaluationOption = Annotated[
    Path | None,
    typer.Option(
        "--evaluation",
        metavar="FILE",
        help="Folder of `gamekeeper evaluate`, or its evaluation.json (default: no evaluation on "
        "the page).",
    ),
]
EpisodeOption = Annotated[
    list[int] | None,
    typer.Option(
        "--episode",
        metavar="N",
        min=0,
        max=MOST,
        help="Episode that must be on the page. Repeatable (default: a selection).",
    ),
]
BudgetOption = Annotated[
    float,
    typer.Option("--budget", metavar="MB", min=0.0, help="Size of all episodes together, in MB."),
]
FramesOption = Annotated[
    float,
    typer.Option("--frames-budget", metavar="MB", min=0.0, help="Size of recorded frames, in MB."),
]
TitleOption = Annotated[
    str | None,
    typer.Option(
        "--title", metavar="TEXT", help="Title of the page (default: the name of the run)."
    ),
]
OpenOption = Annotated[
    bool, typer.Option("--open", help="Open the page in the browser, where there is a display.")
]


def command(
    screen: Screen,
    runs: RunsArgument,
    out: OutOption = None,
    audit: AuditOption = None,
    diagnosis: DiagnosisOption = None,
    attribution: AttributionOption = None,
    pivots: PivotsOption = None,
    evaluation: EvaluationOption = None,
    episode: EpisodeOption = None,
    budget: BudgetOption = MEGABYTES,
    frames_budget: FramesOption = FRAMES_MEGABYTES,
    title: TitleOption = None,
    opens: OpenOption = False,
) -> CommandResult:
    """Writes a report as one HTML file: game form, checks, agents, player, causes, provenance.

    The page loads nothing from the network. Results of `diagnose`, `attribute` and `label` that
    are stored in the run are included; for a missing one, the page names the command that makes
    it.

    Example: gamekeeper report runs/warehouse-1 --out warehouse.html
    """
    from gamekeeper.viewing.report_file import report

    path = Path("report.html") if out is None else out
    if path.is_dir():
        raise GamekeeperError(
            "the page is a file, and this is a folder",
            where="--out",
            actual=str(path),
            fix=f"--out {path / 'report.html'}",
        )
    with screen.progress("reporting"):
        written = report(
            runs[0],
            path,
            others=runs[1:],
            audit=audit,
            diagnosis=diagnosis,
            attribution=attribution,
            pivots=pivots,
            evaluation=evaluation,
            episodes=episode or (),
            budget_bytes=round(budget * MEGABYTE),
            frames_bytes=round(frames_budget * MEGABYTE),
            title=title,
        )
    size = written.stat().st_size
    screen.show(f"Report  {written}  ({size / MEGABYTE:.1f} MB)")
    if opens:
        _open(screen, written)
    return CommandResult({"run": str(runs[0]), "report": str(written), "size_bytes": size}, 0)


def _open(screen: Screen, page: Path) -> None:
    """Opens a page in the browser, or says that there is none here."""
    import webbrowser

    address = page.resolve().as_uri()
    if not has_display() or not webbrowser.open(address):
        screen.note(f"there is no browser to open it in here; its address: {address}")
