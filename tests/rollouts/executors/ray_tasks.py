"""Tasks that only make sense on a node: what it took over from the driver, and its own death."""
# ruff: noqa: D103 - a task's name says what it does
# ruff: noqa: T201 - one prints on purpose

import os
import signal
from pathlib import Path
from typing import Any


def talk(report: Any, *, lines: int) -> None:
    for number in range(lines):
        print(f"an environment says {number}")


def place(report: Any, *, names: list[str]) -> list[Any]:
    return [str(Path.cwd()), {name: os.environ.get(name) for name in names}]


def lose_node(report: Any, *, tried: str, losses: int) -> str:
    """Ray's own process beside this one is killed, the first so many times."""
    path = Path(tried)
    with path.open("a") as file:
        file.write("x")
    if path.stat().st_size <= losses:
        # On Linux a keeper stands between, which ends what a task leaves behind.
        keeper = Path(f"/proc/{os.getppid()}/stat").read_text("utf-8")
        os.kill(int(keeper.rpartition(")")[2].split()[1]), signal.SIGKILL)
        signal.pause()
    return "played"
