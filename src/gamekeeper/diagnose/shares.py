"""Shares of an experiment, each played by a worker process of its own, side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import Any

from gamekeeper.errors import EnvError
from gamekeeper.run.watch import Outcome
from gamekeeper.run.workers import run_task


def play_shares(
    task: str,
    shares: Sequence[Mapping[str, Any]],
    take: Callable[[dict[str, Any]], None],
    *,
    silence_s: float | None,
    where: str,
    mend: str,
) -> None:
    """Runs a task once for each share, all at once.

    Args:
        task: "module:function".
        shares: the arguments of each run of it.
        take: called with each report, in several threads.
        silence_s: longest time without a sign of life.
        where, mend: what an error says of the place and of what to do.
    Raises:
        EnvError: a worker process hung or died.
        KeyboardInterrupt: by Ctrl-C.
    """
    stop = Event()

    def work(share: Mapping[str, Any]) -> Outcome:
        return run_task(task, share, silence_s=silence_s, on_message=take, stop=stop)

    with ThreadPoolExecutor(len(shares)) as pool:
        try:
            ends = list(pool.map(work, shares))
        except BaseException:
            stop.set()
            raise
    for end in ends:
        if end.status == "interrupted":
            raise KeyboardInterrupt
        if end.status != "done":
            raise EnvError(
                f"a worker process {end.status} while it played",
                where=where,
                seen=str(end.error),
                mend=mend,
            )
