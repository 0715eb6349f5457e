"""Scores of training runs, as they come: [runs], [runs, episodes], or ragged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gamekeeper.core.evaluation.interval import FloatArray, figures
from gamekeeper.core.evaluation.refusals import enough
from gamekeeper.errors import EvidenceError

Scores = FloatArray | Sequence[float] | Sequence[FloatArray] | Sequence[Sequence[float]]
"""[runs] a score of each, [runs, episodes], or a list of runs of different lengths (ragged)."""


def run_scores(scores: Scores, *, where: str = "run_scores") -> FloatArray:
    """The score of each run: the mean over its episodes.

    Args:
        scores: [runs], [runs, episodes], or ragged.
        where: what asks, for the error.
    Raises:
        EvidenceError: there is no run, a run without episodes, or a figure that isn't finite.
    """
    enough(len(scores), 1, "training runs", where=where)
    if np.ndim(scores[0]) == 0:
        return figures(scores, where)  # type: ignore[arg-type]  # [runs]: the first is a number
    rows = [figures(row, where) for row in scores]  # type: ignore[arg-type]  # rows of numbers
    for row in rows:
        enough(len(row), 1, "episodes of a run", where=where)
    return np.array([row.mean() for row in rows])


def crossed(scores: Scores, *, where: str) -> FloatArray | None:
    """The scores as [runs, episodes] where all runs played equally many; None for [runs].

    Args:
        scores: [runs] or [runs, episodes].
        where: what asks, for the error.
    Raises:
        EvidenceError: runs played different numbers of episodes.
    """
    if np.ndim(scores[0]) == 0:
        return None
    lengths = sorted({len(row) for row in scores})  # type: ignore[arg-type]  # rows of numbers
    if len(lengths) > 1:
        raise EvidenceError(
            "runs didn't play the same seeds",
            where=where,
            expected="equally many episodes of each run, column for column on one seed",
            seen=f"{lengths[0]} to {lengths[-1]} episodes",
            mend="play the same seeds, or say shared_seeds=False",
        )
    return np.asarray(scores, np.float64)
