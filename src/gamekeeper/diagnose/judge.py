"""What the arms say: which remedy restores, and whether another one would as well. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.failure_label import LABELS
from gamekeeper.core.paired import Effect, paired_effect
from gamekeeper.core.stats import holm, wilson
from gamekeeper.diagnose.remedies import Remedy

Answer = Literal["isolated", "joint", "compatible", "untested"]
Successes = NDArray[np.float64]
"""[episodes] 1 where the episode didn't fail, paired by seed between arms."""

ALPHA: Final = 0.05
LEVEL: Final = 0.9
"""The share of episodes that succeed where nothing is wrong, unless told otherwise."""
PART: Final = 0.7
"""A remedy restores where it closes this part of the gap to the declared level."""


@dataclass(frozen=True, slots=True)
class Tried:
    """One remedy against the sham.

    Attributes:
        remedy: what was put at its ideal.
        effect: the change of the share of successes, with its interval.
        p: the effect's p-value, corrected for the number of remedies (Holm).
        recovered: the part of the gap that it closes; 1: up to the declared level.
        restores: it closes the stated part, and the effect isn't chance.
    """

    remedy: Remedy
    effect: Effect
    p: float
    recovered: float
    restores: bool


@dataclass(frozen=True, slots=True)
class Finding:
    """What is answered for one scope: the team, a role or an agent.

    Attributes:
        answer: `isolated`, `joint`, `compatible` or `untested`.
        labels: the causes that it names, none where untested.
        remedies: the least remedies that restore.
        tried: everything that was tried on fresh seeds.
        success: the share of successes as it is: (share, low, high).
        why: in a sentence.
    """

    answer: Answer
    labels: tuple[str, ...]
    remedies: tuple[Remedy, ...]
    tried: tuple[Tried, ...]
    success: tuple[float, float, float]
    why: str


def is_failing(sham: Successes, level: float) -> bool:
    """The set-up fails more often than declared, beyond chance."""
    return wilson(int(sham.sum()), len(sham)).high < level


def recovered(sham: Successes, arm: Successes, level: float) -> float:
    """The part of the gap to the level that an arm closes; 0 where there is no gap."""
    gap = level - float(sham.mean())
    return float(arm.mean() - sham.mean()) / gap if gap > 0 else 0.0


def judged(
    sham: Successes,
    arms: Mapping[Remedy, Successes],
    *,
    level: float = LEVEL,
    part: float = PART,
    everything: Successes | None = None,
    rng: Generator,
) -> Finding:
    """The answer that fresh seeds give.

    Args:
        sham: the set-up as it is, on fresh seeds.
        arms: each remedy on the same seeds.
        level: the declared share of successes.
        part: of the gap to it that a remedy has to close.
        everything: all remedies at once, on the same seeds.
        rng: for intervals that are drawn.
    """
    share = wilson(int(sham.sum()), len(sham))
    success = (share.p, share.low, share.high)
    tried = _tried(sham, arms, level, part, rng)
    if not is_failing(sham, level):
        why = (
            f"it succeeds in {share.p:.0%} of fresh episodes (95 %: {share.low:.0%} to "
            f"{share.high:.0%}), which doesn't fall short of the declared {level:.0%}"
        )
        return Finding("untested", (), (), tried, success, why)
    least = _least(tried)
    singles = [one for one in least if "+" not in one.remedy.label]
    if singles:
        return _of_singles(singles, tried, success)
    better = [one for one in least if _beats_its_parts(one, arms, rng)]
    if better:
        return _of_pairs(better, tried, success)
    if least:
        why = "a pair restores, and one of its parts may do as well: more episodes would tell"
        labels = _labels([one.remedy for one in least])
        return Finding("compatible", labels, tuple(o.remedy for o in least), tried, success, why)
    if everything is not None and recovered(sham, everything, level) >= part:
        labels = _labels(arms)
        why = "all remedies at once restore, and no single one or pair does"
        return Finding("compatible", labels, (), tried, success, why)
    why = "no remedy restores, nor do all at once: the cause has no handle that was tried"
    if not arms:
        why = (
            "there is no handle to try: no knob is away from its ideal, no reference policy is left"
        )
    return Finding("untested", (), (), tried, success, why)


def _tried(
    sham: Successes, arms: Mapping[Remedy, Successes], level: float, part: float, rng: Generator
) -> tuple[Tried, ...]:
    effects = {remedy: paired_effect(sham, arm, rng=rng) for remedy, arm in arms.items()}
    corrected = holm([effect.p for effect in effects.values()])
    return tuple(
        Tried(
            remedy, effect, p, share := recovered(sham, arms[remedy], level),
            restores=share >= part and effect.value > 0 and p < ALPHA,
        )
        for (remedy, effect), p in zip(effects.items(), corrected, strict=True)
    )  # fmt: skip


def _least(tried: Sequence[Tried]) -> list[Tried]:
    """What restores and contains nothing else that does."""
    restoring = [one for one in tried if one.restores]
    return [
        one
        for one in restoring
        if not any(_is_within(other.remedy, one.remedy) for other in restoring)
    ]


def _is_within(part: Remedy, whole: Remedy) -> bool:
    """A remedy makes up for another, or a pair for all that another pair does and for more."""
    is_pair = "+" in part.label and "+" in whole.label
    return part.name in whole.contains or (is_pair and part.contains < whole.contains)


def _beats_its_parts(pair: Tried, arms: Mapping[Remedy, Successes], rng: Generator) -> bool:
    """A pair restores more episodes than either of its parts, beyond chance."""
    whole = arms[pair.remedy]
    return all(
        paired_effect(part, whole, rng=rng).low > 0
        for remedy, part in arms.items()
        if remedy.name in pair.remedy.contains
    )


def _of_singles(
    least: Sequence[Tried], tried: tuple[Tried, ...], success: tuple[float, float, float]
) -> Finding:
    remedies = tuple(one.remedy for one in least)
    labels = _labels(remedies)
    names = ", ".join(remedy.name for remedy in remedies)
    if len(labels) == 1:
        why = f"{names} restores by itself, and nothing else that was tried does without it"
        return Finding("isolated", labels, remedies, tried, success, why)
    why = f"each of {names} restores by itself, so they can't be told apart"
    return Finding("compatible", labels, remedies, tried, success, why)


def _of_pairs(
    least: Sequence[Tried], tried: tuple[Tried, ...], success: tuple[float, float, float]
) -> Finding:
    """Pairs restore, and neither of their parts does."""
    remedies = tuple(one.remedy for one in least)
    labels = _labels(remedies)
    names = "; ".join(remedy.name for remedy in remedies)
    if len(remedies) == 1:
        why = f"{names}: both together restore, neither does alone"
        return Finding("joint", labels, remedies, tried, success, why)
    why = f"several pairs restore ({names}), so they can't be told apart"
    return Finding("compatible", labels, remedies, tried, success, why)


def _labels(remedies: Any) -> tuple[str, ...]:
    named = {label for remedy in remedies for label in remedy.label.split(" + ")}
    return tuple(label for label in LABELS if label in named)
