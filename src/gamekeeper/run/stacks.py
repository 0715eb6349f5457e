"""What faulthandler writes about the Python stacks of a process, made readable."""

from __future__ import annotations

import re
import sysconfig


def tidy(stacks: str, *, without: str) -> str:
    """The stacks without frames of the file named `without`, or threads that are nothing else.

    Args:
        stacks: what faulthandler dumped.
        without: name of a file, its folder left out.
    """
    ours = f'{without}", line '
    blocks = []
    for block in stacks.strip().split("\n\n"):
        lines = [line for line in block.splitlines() if ours not in line]
        if len(lines) > 1 or not block.startswith(("Thread ", "Current thread ")):
            blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def place(stacks: str | None) -> str | None:
    """Where the main thread is: "step (path.py:12)", frames of the standard library skipped."""
    if not stacks:
        return None
    threads = stacks.split("\n\n")
    current = next((text for text in threads if "Current thread" in text), threads[0])
    frames = re.findall(r'^  File "(.*)", line (\d+) in (.*)$', current, flags=re.MULTILINE)
    library = sysconfig.get_path("stdlib")
    foreign = [
        frame
        for frame in frames
        if not frame[0].startswith((library, "<frozen")) or "-packages" in frame[0]
    ]
    for path, line, name in (foreign or frames)[:1]:
        return f"{name} ({path}:{line})"
    return None
