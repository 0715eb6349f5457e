"""`gamekeeper report RUN [RUN2 ...]`: one HTML page about a run, in one file."""

from pathlib import Path
from typing import Annotated, Final

from gamekeeper.cli._options import Accepted, Number
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.cli.view import has_display
from gamekeeper.errors import GamekeeperError

ORDER: Final = 97
MEGABYTES: Final = 2.5
FRAMES_MEGABYTES: Final = 8.0
MEGABYTE: Final = 1_000_000
"""Defaults of `viewing.report_file`; importing that loads numpy, help doesn't."""


def command(
    screen: Screen,
    runs: list[Path],
    out: Path | None = None,
    audit: Path | None = None,
    diagnosis: Path | None = None,
    attribution: Path | None = None,
    pivots: Path | None = None,
    evaluation: Path | None = None,
    episode: list[Number] | None = None,
    budget: Annotated[float, Accepted(0.0)] = MEGABYTES,
    frames_budget: Annotated[float, Accepted(0.0)] = FRAMES_MEGABYTES,
    title: str | None = None,
    expand: bool = False,
    allow_import: bool = False,
    opens: bool = False,
) -> CommandResult:
    """Writes a report as one HTML file: structure, checks, agents, player, causes, provenance.

    The page loads nothing from the network. Results of `diagnose`, `attribute` and `label` that
    are stored in the run are included; for a missing one, the page names the command that makes
    it.

    Example: gamekeeper report runs/warehouse-1 --out warehouse.html

    Args:
        runs (RUN): Run that the page is about, and runs to compare it with.
        out (--out, -o FILE): HTML file to write (default: ./report.html).
        audit (--audit FILE): Output of `gamekeeper audit ENV --json` (default: no audit on the
            page).
        diagnosis (--diagnosis FILE): Output of `gamekeeper diagnose RUN --json` (default: the run's
            own, if it has one).
        attribution (--attribution FILE): Output of `gamekeeper attribute RUN --json` (default: the
            run's own, if it has one).
        pivots (--pivots FILE): Output of `gamekeeper pivots RUN --json`, for the timeline (default:
            the run's own, if it has one).
        evaluation (--evaluation FILE): Folder of `gamekeeper evaluate`, or its evaluation.json
            (default: no evaluation on the page).
        episode (--episode N): Episode that must be on the page. Repeatable (default: a selection).
        budget (--budget MB): Size of all episodes together, in MB.
        frames_budget (--frames-budget MB): Size of recorded frames, in MB.
        title (--title TEXT): Title of the page (default: the name of the run).
        expand (--expand): Play a run of level actions again, to show it in full; the result stays
            in your cache folder.
        opens (--open): Open the page in the browser, where there is a display.
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
            expand=expand,
            allow_import=allow_import,
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
