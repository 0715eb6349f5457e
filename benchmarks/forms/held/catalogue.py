"""Environments of known structure that are held back: factories, each with its true form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchmarks.forms.form import Form
from benchmarks.forms.held import endings, lots, masks, own, races, spaces, tables, tolls

SUBJECTS = (masks, races, endings, tables, spaces, own, lots, tolls)


def forms() -> list[tuple[Callable[[], Any], Form]]:
    """All factories, each with the true form of its environment."""
    return [pair for subject in SUBJECTS for pair in subject.FORMS]
