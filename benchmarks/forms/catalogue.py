"""Environments of known structure: factories, each with its true form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchmarks.forms import (
    cards,
    continuous,
    delays,
    endings,
    grids,
    masks,
    matrix,
    races,
    standalone,
    talk,
    wrapped,
)
from benchmarks.forms.form import Form

SUBJECTS = (
    matrix,
    races,
    masks,
    endings,
    delays,
    cards,
    grids,
    continuous,
    talk,
    standalone,
    wrapped,
)


def forms() -> list[tuple[Callable[[], Any], Form]]:
    """All factories, each with the true form of its environment."""
    return [pair for subject in SUBJECTS for pair in subject.FORMS]
