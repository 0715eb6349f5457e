"""Whether messages tell of what their speaker knows, go with what others do, and are heeded. Pure.

Mutual information of equal but unrelated series isn't 0, so it is judged by a permutation test that
pairs the messages of whole episodes with what happened in others, turn by turn: what episodes have
in common by their course is in both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.stats import Share, wilson

ROUNDS: Final = 199
"""Permutations; the least p-value is then 1 / 200."""
FEWEST: Final = 10
"""Episodes with a message, below which nothing is said."""
BINS: Final = 4
"""Into which numbers with many values are cut, equally full."""
FEW_VALUES: Final = 8

Kind = Literal["signalling", "coordination", "listening"]


@dataclass(frozen=True, slots=True)
class Talk:
    """One finding on messages.

    Attributes:
        kind: `signalling`: messages depend on what their speaker was shown. `coordination`: what
            `to` does next goes with them. `listening`: `to` decides otherwise where it alone is
            shown another message.
        source: who says it; None where all messages are meant.
        to: who hears it; None for signalling.
        bits: mutual information beyond what unrelated episodes have; None for listening.
        p: of the permutation test; for listening the share of decisions that changed.
        share: of listening: changed decisions among the looks, with its interval.
        sham: of listening: changed decisions though nothing else was shown.
        n: episodes; for listening looks.
    """

    kind: Kind
    source: str | None
    to: str | None
    bits: float | None
    p: float
    share: Share | None
    sham: float | None
    n: int

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        data = {"kind": self.kind, "from": self.source, "to": self.to, "p": self.p, "n": self.n}
        if self.share is None:
            return data | {"bits": self.bits}
        return data | {"low": self.share.low, "high": self.share.high, "sham": self.sham}


def talk(
    said: Iterable[Mapping[str, Any]], listened: Iterable[Mapping[str, Any]], *, rng: Generator
) -> list[Talk]:
    """All findings on messages.

    Source: Lowe et al. 2019, "On the pitfalls of measuring emergent communication" (speaker
        consistency, instantaneous coordination, causal influence of communication); Jaques et al.
        2019, "Social influence as intrinsic motivation for multi-agent deep reinforcement learning"
        (counterfactual messages).
    """
    by_speaker: dict[str, list[Mapping[str, Any]]] = {}
    for each in said:
        if each["messages"]:
            by_speaker.setdefault(each["from"], []).append(each)
    found: list[Talk] = []
    for speaker, episodes in sorted(by_speaker.items()):
        if len(episodes) >= FEWEST:
            found += _of_speaker(speaker, episodes, rng)
    return [*found, *_listening(listened)]


def _of_speaker(
    speaker: str, episodes: Sequence[Mapping[str, Any]], rng: Generator
) -> Iterator[Talk]:
    length = min(len(each["messages"]) for each in episodes)
    words = _codes([each["messages"][:length] for each in episodes])
    width = min(len(row) for each in episodes for row in each["seen"][:length])
    seen = np.array([[row[:width] for row in each["seen"][:length]] for each in episodes])
    places = [binned(seen[:, :, k]) for k in range(width)]
    places = [each for each in places if each.max(initial=0) > 0]
    if places:
        bits, p = dependence(words, places, rng=rng)
        yield Talk("signalling", speaker, None, bits, p, None, None, len(episodes))
    listeners = sorted(set.intersection(*(set(each["next"]) for each in episodes)))
    for other in listeners:
        deeds = _codes([each["next"][other][:length] for each in episodes])
        bits, p = dependence(words, [deeds], rng=rng)
        yield Talk("coordination", speaker, other, bits, p, None, None, len(episodes))


def _listening(looks: Iterable[Mapping[str, Any]]) -> Iterator[Talk]:
    by_listener: dict[str, list[Mapping[str, Any]]] = {}
    for look in looks:
        by_listener.setdefault(look["to"], []).append(look)
    for name, mine in sorted(by_listener.items()):
        share = wilson(sum(look["changed"] for look in mine), len(mine))
        sham = sum(look["sham"] for look in mine) / len(mine)
        yield Talk("listening", None, name, None, share.p, share, sham, len(mine))


def dependence(
    words: NDArray[np.int64], places: Sequence[NDArray[np.int64]], *, rng: Generator
) -> tuple[float, float]:
    """How many bits messages tell of the place that they tell most of, and the p-value of that.

    Args:
        words: [episodes, turns] the messages as numbers from 0.
        places: each [episodes, turns], what they may tell of, as numbers from 0.
        rng: draws which episodes are paired.
    Returns:
        The largest mutual information less the mean of the largest ones of unrelated episodes, not
        below 0; and the share of these that are as large.
    """
    own = max(information(words, place) for place in places)
    others = np.array([
        max(information(shuffled, place) for place in places)
        for shuffled in (words[rng.permutation(len(words))] for _ in range(ROUNDS))
    ])  # fmt: skip
    p = float((1 + np.count_nonzero(others >= own - 1e-12)) / (ROUNDS + 1))
    return max(float(own - others.mean()), 0.0), p


def information(one: NDArray[np.int64], two: NDArray[np.int64]) -> float:
    """The mutual information of two series of categories, in bits."""
    width = int(two.max()) + 1
    table = np.bincount(
        (one * width + two).ravel(), minlength=(int(one.max()) + 1) * width
    ).reshape(-1, width)  # fmt: skip
    joint = table / table.sum()
    apart = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    known = joint > 0
    return float((joint[known] * np.log2(joint[known] / apart[known])).sum())


def binned(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Numbers as categories: each value its own where there are few, else equally full bins."""
    kinds, codes = np.unique(values, return_inverse=True)
    if len(kinds) <= FEW_VALUES:
        return codes.reshape(values.shape).astype(np.int64)
    cuts = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)[1:-1]))
    return np.searchsorted(cuts, values, side="right").astype(np.int64)


def _codes(texts: Sequence[Sequence[str]]) -> NDArray[np.int64]:
    """[episodes, turns] numbers from 0 for texts."""
    codes = np.unique(np.array(texts), return_inverse=True)[1]
    return codes.reshape(len(texts), -1).astype(np.int64)
