"""Progress of long work as a line on a terminal, gone when the work is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def live_progress(title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A line on stderr with episodes, turns and time; yields what takes a task's reports."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.fields[said]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=None, said="")
        known: dict[str, Any] = {}

        def take(fields: dict[str, Any]) -> None:
            known.update(fields)
            done, of = ("merged", "parts") if "merged" in known else ("episode", "episodes")
            progress.update(
                task,
                total=known.get(of) if done in known else None,  # None: it pulses
                completed=known.get(done, 0),
                said=_said(known),
            )

        yield take


def _said(known: dict[str, Any]) -> str:
    if "merged" in known:
        return f"merging: {known['merged']:,} of {known['parts']:,} parts"
    said, unit = [], known.get("unit", "episodes")
    if "episode" in known and "episodes" in known:
        said.append(f"{known['episode']:,} of {known['episodes']:,} {unit}")
    if "turns" in known:
        said.append(f"{known['turns']:,} turns")
    return ", ".join(said)
