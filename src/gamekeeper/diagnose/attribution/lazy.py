"""The lazy agent: the team does as well without it, while others of its role work. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gamekeeper.diagnose.attribution.measured import Measured

PART: Final = 0.5
"""Of a fair share; who surely brings less is lazy. A fair share is what the others of its role
bring on average, as Shapley values. What is lost without an agent is compared with what is lost
without another of its role on average, or with a fair share where that is more."""


@dataclass(frozen=True, slots=True)
class Laziness:
    """Whether an agent is lazy; None where it can't be told, with the reason.

    Attributes:
        is_lazy: its share and what is lost without it are both surely below `PART` of a fair share,
            and another of its role surely brings something.
        why: in words.
        fair: the fair share, in units of return.
    """

    is_lazy: bool | None
    why: str
    fair: float | None = None


def laziness(
    agent: str,
    peers: list[str],
    differences: Mapping[str, Measured],
    shapley: Mapping[str, Measured],
    *,
    baseline: str,
) -> Laziness:
    """Whether an agent is lazy.

    Both figures have to say so: a team with hands to spare loses nothing where any one of them
    stops, though each does its part; the Shapley value sees that.

    Args:
        peers: the agents of its role, itself among them.
        baseline: what took the agents' places; only doing nothing tells.
    """
    if len(peers) < 2:
        return Laziness(None, "nobody else has its role")
    if baseline != "noop":
        return Laziness(None, f"the baseline is {baseline}, not doing nothing")
    own, lost = shapley.get(agent), differences.get(agent)
    if own is None or lost is None or own.high is None or lost.high is None:
        return Laziness(None, "too few episodes for an interval")
    others = [shapley[name] for name in peers if name != agent]
    fair = sum(other.value for other in others) / len(others)
    if fair <= 0 or not any(other.low is not None and other.low > 0 for other in others):
        return Laziness(False, "no other of its role surely brings anything", fair)
    usual = sum(differences[name].value for name in peers if name != agent) / len(others)
    usual = max(usual, fair)
    said = (
        f"its share is at most {own.high:.3g} (a fair one {fair:.3g}), the loss without it at most "
        f"{lost.high:.3g} (usually {usual:.3g})"
    )
    return Laziness(own.high < PART * fair and lost.high < PART * usual, said, fair)
