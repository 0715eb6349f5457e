"""Progress of an audit on a terminal: the probe that runs, and an estimate of the time left."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.text import Text

ESTIMATED_FROM: Final = 0.15
"""Part of the work from which the time left is estimated."""

OnProbe = Callable[[str, int, int], None]


@contextmanager
def probing(shares: Mapping[str, float], *, is_shown: bool) -> Iterator[OnProbe]:
    """Shows a line on stderr; yields the function that an audit calls before each probe.

    Args:
        shares: shares of the probes that will run, in their order.
        is_shown: False: nothing is written.
    """
    if not is_shown:
        yield lambda name, place, count: None
        return
    columns = (
        SpinnerColumn(),
        TextColumn("auditing"),
        BarColumn(bar_width=24),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        _Left(),
    )
    total = sum(shares.values()) or 1.0
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("starting", total=total, since_s=time.monotonic(), part=0.0)

        def take(name: str, place: int, count: int) -> None:
            done = sum(list(shares.values())[:place])
            progress.update(
                task,
                completed=done,
                description=f"{name} ({place + 1} of {count})",
                since_s=time.monotonic(),
                part=done / total,
            )

        yield take


class _Left(ProgressColumn):
    """Estimate of the time left, by the shares of the probes that are done."""

    def render(self, task: Task) -> Text:
        """Renders `about 12 s left`; empty at the beginning."""
        part, elapsed_s = task.fields["part"], task.elapsed or 0.0
        if part < ESTIMATED_FROM:
            return Text("")
        within_s = time.monotonic() - task.fields["since_s"]
        left_s = (elapsed_s - within_s) * (1 - part) / part - within_s
        return Text(f"about {left_s:.0f} s left" if left_s >= 1 else "nearly done")
