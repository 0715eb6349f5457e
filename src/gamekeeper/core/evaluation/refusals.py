"""What intervals ask for, and the reasons they are refused below it."""

from __future__ import annotations

from typing import Final, NoReturn

from gamekeeper.core.evaluation.interval import Statistic
from gamekeeper.errors import EvidenceError

FEWEST_EPISODES: Final[dict[Statistic, int]] = {"mean": 50, "iqm": 20, "median": 10}
"""Episodes of one checkpoint from which on an interval covers as it says (docs/statistics.md)."""
FEWEST_RUNS: Final[dict[Statistic, int]] = {"mean": 20, "iqm": 12, "median": 10}
"""Training runs of a method from which on an interval covers as it says. The mean asks for most:
of ten runs none may be among the one in five that fail, and no interval can know of these."""
FEWEST_RUNS_APART: Final = 10
"""Training runs of each of two methods for their difference, and which of them is better."""
FEWEST_RUNS_TOGETHER: Final = 30
"""Training runs in all environments together, where there are several."""
FEWEST_RUNS_EACH: Final = 3
"""Training runs in each of several environments."""
FEWEST_RUNS_FOR_MEDIANS: Final = 30
"""Training runs in each environment for the median over environments of their means."""
FEWEST_PAIRS: Final = 50
"""Pairs of episodes for the probability that one beats the other."""

AGENTS_OF_ONE_EPISODE: Final = (
    "agents of one episode are no sample: they share its seed, its partners and its luck, so an "
    "interval over them claims more evidence than there is; the unit is the episode (for one "
    "checkpoint) or the training run (for a method)"
)


def refuse_agents(agents: int, *, where: str) -> NoReturn:
    """Intervals over the agents of one episode are refused.

    Args:
        agents: how many there were.
        where: what asked for the interval.
    Raises:
        EvidenceError: always.
    """
    raise EvidenceError(
        "no interval over agents of one episode",
        where=where,
        expected="one figure for each episode, or for each training run",
        seen=f"{agents} agents of one episode; {AGENTS_OF_ONE_EPISODE}",
        mend="take the mean over agents in each episode first, or play more episodes",
    )


def enough(n: int, fewest: int, unit: str, *, where: str) -> None:
    """There are as many units as the interval asks for.

    Args:
        n: units there are.
        fewest: units it asks for.
        unit: "episodes", "pairs" or "training runs".
        where: what asks.
    Raises:
        EvidenceError: there are fewer.
    """
    if n >= fewest:
        return
    raise EvidenceError(
        f"too few {unit} for an interval that covers as it says",
        where=where,
        expected=f"at least {fewest} {unit}",
        seen=str(n),
        mend=f"add {unit}, or show the {n} figures themselves without an interval",
    )
