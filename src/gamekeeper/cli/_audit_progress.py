"""Progress of an audit on a terminal: the probe at work, and about how long it all still takes."""

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

TOLD_FROM: Final = 0.15
"""Part of the work after which what is left can be told from what it took."""

OnProbe = Callable[[str, int, int], None]


@contextmanager
def probing(shares: Mapping[str, float], *, is_shown: bool) -> Iterator[OnProbe]:
    """A line on stderr; yields what an audit calls before each probe.

    Args:
        shares: of the probes that will look, in their order.
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
                task, completed=done, description=f"{name} ({place + 1} of {count})",
                since_s=time.monotonic(), part=done / total,
            )  # fmt: skip

        yield take


class _Left(ProgressColumn):
    """About how long it still takes, by the shares of the probes that are done."""

    def render(self, task: Task) -> Text:
        """`about 12 s left`; empty as long as nobody can tell."""
        part, elapsed_s = task.fields["part"], task.elapsed or 0.0
        if part < TOLD_FROM:
            return Text("")
        within_s = time.monotonic() - task.fields["since_s"]
        left_s = (elapsed_s - within_s) * (1 - part) / part - within_s
        return Text(f"about {left_s:.0f} s left" if left_s >= 1 else "nearly done")
