"""Failure labels as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gamekeeper.report.columns import wrapped


def labels_text(rows: Sequence[Mapping[str, Any]], *, width: int) -> str:
    """A paragraph for each label: what, whose, where, by whom and why.

    Args:
        rows: labels as plain data.
        width: columns that no line exceeds.
    """
    if not rows:
        return "No labels. One is added with: gamekeeper label RUN LABEL [--episode N] [--agent A]"
    lines: list[str] = []
    for row in rows:
        whose = row["agent"] or "the team"
        where = "the run" if row["episode"] is None else f"episode {row['episode']}"
        where += "" if row["turn"] is None else f", turn {row['turn']}"
        lines += wrapped(f"{row['label']}: {whose}, {where}", width, rest="  ")
        said = "proposed by" if row["proposed"] else "said by"
        lines += wrapped(f"{said} {row['by']}, {row['at']}", width, first="  ", rest="  ")
        if row["why"]:
            lines += wrapped(row["why"], width, first="  ", rest="  ")
    return "\n".join(lines)
