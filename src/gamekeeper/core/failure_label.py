"""What a failure may be called: the seven labels, which a person or a diagnosis gives."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

Label: TypeAlias = Literal[
    "perception",
    "state estimation",
    "planning",
    "control",
    "timing",
    "data coverage",
    "evaluation",
]

LABELS: Final[tuple[Label, ...]] = (
    "perception",
    "state estimation",
    "planning",
    "control",
    "timing",
    "data coverage",
    "evaluation",
)
"""From what an agent senses to how it is judged: the order in which they are always listed."""
