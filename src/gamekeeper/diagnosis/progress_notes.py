"""Notes of what was played, line by line: an experiment that was stopped goes on from them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gamekeeper.errors import RunError


def note(path: Path, data: Any) -> None:
    """Adds a line."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(data) + "\n")


def damaged(path: Path, number: int, error: Exception) -> RunError:
    """The error of a line that can't be read."""
    return RunError(
        "a noted outcome is damaged",
        where=f"{path}, line {number}",
        actual=str(error)[:200],
        fix="take the file away: the experiment is played anew",
    )


def noted(path: Path, head: Mapping[str, Any]) -> Iterator[tuple[int, Any]]:
    """Yields numbers and data of lines of an earlier call; a last one that was torn is dropped.

    Args:
        path: the file; written with its head where there is none.
        head: what the file has to begin with, so that no other experiment's outcomes are taken.
    Raises:
        RunError: the file is another experiment's, or damaged.
    """
    begin = json.dumps(dict(head), sort_keys=True)
    lines = path.read_bytes().split(b"\n") if path.exists() else []
    if not lines:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(begin + "\n", encoding="utf-8")
        return
    if lines[0].decode("utf-8", "replace") != begin:
        raise RunError(
            "outcomes of another experiment lie here",
            where=str(path),
            expected="the same run, seed and set-up",
            actual=_changed(lines[0], begin),
            fix="name another folder with --out, or take this one away",
        )
    whole = lines[:-1]
    for number, line in enumerate(whole[1:], start=2):
        try:
            data = json.loads(line)
        except ValueError as error:
            raise damaged(path, number, error) from error
        yield number, data
    if lines[-1]:
        path.write_bytes(b"\n".join(whole) + b"\n")


def _changed(there: bytes, begin: str) -> str:
    """What differs between two heads, by name."""
    try:
        old, new = json.loads(there), json.loads(begin)
    except ValueError:
        old = None
    if not isinstance(old, dict):
        return there.decode("utf-8", "replace")[:200]
    pairs = _differing(old, new, "")
    return "; ".join(f"{name} was {was}, is {now}" for name, was, now in pairs)[:400]


def _differing(old: Any, new: Any, name: str) -> Iterator[tuple[str, str, str]]:
    """Yields the name of each value that differs, and both."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            inner = f"{name}.{key}" if name else key
            yield from _differing(old.get(key), new.get(key), inner)
    elif old != new:
        yield name, json.dumps(old)[:60], json.dumps(new)[:60]
