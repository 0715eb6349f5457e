"""Undos of two agents at once, where no undo of one restores: two faults may hide each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, product
from typing import Final

from gamekeeper.diagnosis.experiment import Experiment
from gamekeeper.diagnosis.trials import IdealSubstitute, joined

WAYS: Final = (
    "mirror field",
    "exchange fields",
    "turn fields",
    "mirror axis",
    "exchange axes",
    "turn axes",
    "exchange actions",
    "settle",
)
"""Undos that are paired. Scales and constants at two agents would make up for an environment that
pushes both, as wind does, which is neither's fault."""
BATCH: Final = 48
"""Pairs that are played before those that restore are looked at."""
MOST_PAIRS: Final = 600
"""Pairs that are tried at most, one failing episode each."""
SCREENED: Final = (1, 4, 10)
"""Failing episodes on which pairs are played, round by round."""
HALF: Final = 0.5
RIVAL: Final = 0.8
RESERVED: Final = 4
"""Arms whose confirmation stays affordable."""
CONFIRMED: Final = 3
"""Pairs that are confirmed at most, each beside its two parts."""


def pairs_of(ranked: Sequence[IdealSubstitute]) -> list[IdealSubstitute]:
    """Pairs of undos of different agents, likely ones first.

    The same undo at both comes first (they may have learnt from one faulty source), then pairs of
    which both stand high.

    Args:
        ranked: undos of one agent or more, the best first.
    """
    units: dict[tuple[str, ...], list[IdealSubstitute]] = {}
    for one in ranked:
        undo = one.undo
        if undo is not None and undo.way in WAYS and not one.between:
            units.setdefault(one.agents, []).append(one)
    placed = [
        ((not _is_same(one, two), max(i, j), i + j), joined((one, two)))
        for mine, others in combinations(units.values(), 2)
        if not {*mine[0].agents} & {*others[0].agents}
        for (i, one), (j, two) in product(enumerate(mine), enumerate(others))
    ]
    return [pair for _, pair in sorted(placed, key=lambda each: each[0])]


def _is_same(one: IdealSubstitute, two: IdealSubstitute) -> bool:
    """Tells whether two undos do the same thing."""
    a, b = one.undo, two.undo
    return a is not None and b is not None and _form(a) == _form(b)


def _form(undo: object) -> tuple[object, ...]:
    return tuple(getattr(undo, name) for name in ("way", "places", "amount"))


def search_pairs(
    experiment: Experiment,
    undos: Sequence[IdealSubstitute],
    failing: Sequence[int],
    scopes: Sequence[str],
    *,
    aside: int,
) -> None:
    """Screens pairs of undos on failing seeds, and confirms the best few beside their parts.

    Args:
        undos: of single agents; those of them that were searched are paired.
        failing: searched episodes that fail as it is.
        scopes: for which a success counts.
        aside: episodes that stay for what comes after.
    """
    seed, outcomes = experiment.search_seed, experiment.runner.outcomes
    known = [one for one in undos if (one.name, seed, failing[0]) in outcomes]
    experiment.groups |= {one.name: one for one in known}
    ranked = list(ranked_undos(experiment, known, failing[:1], scopes))
    pairs = pairs_of(ranked)
    reserve = aside + RESERVED * experiment.confirm
    most = max(min(experiment.left - reserve, MOST_PAIRS), 0)
    tried: dict[str, IdealSubstitute] = {}
    found: list[IdealSubstitute] = []
    for at in range(0, most, BATCH):
        batch = pairs[at : min(at + BATCH, most)]
        found = _screened(experiment, batch, failing, scopes, tried)
        if found:
            more = _beside(found[0], pairs, tried)
            found += _screened(experiment, more, failing, scopes, tried)
            break
    if len(tried) < len(pairs) and not found:
        experiment.not_played.append(f"{len(pairs) - len(tried)} of {len(pairs)} pairs of undos")
    last = ranked_undos(experiment, found, failing[: SCREENED[-1]], scopes)
    _confirm(experiment, [one for one, share in last.items() if share >= HALF], aside)
    experiment.paired = len(tried)


def _beside(
    pair: IdealSubstitute, pairs: Sequence[IdealSubstitute], tried: Mapping[str, object]
) -> list[IdealSubstitute]:
    """Pairs that share a half with one that restores, and weren't tried: they may do as well."""
    return [
        other
        for other in pairs
        if other.name not in tried and any(part in pair.parts for part in other.parts)
    ]


def _screened(
    experiment: Experiment,
    pairs: Sequence[IdealSubstitute],
    failing: Sequence[int],
    scopes: Sequence[str],
    tried: dict[str, IdealSubstitute],
) -> list[IdealSubstitute]:
    """Those of the pairs that restore on ever more failing seeds, the best first."""
    room = experiment.left - RESERVED * experiment.confirm
    left = list(pairs[: max(room, 0)])
    tried |= {one.name: one for one in left}
    experiment.groups |= tried
    for count in SCREENED[:-1]:
        shares = ranked_undos(experiment, left, failing[:count], scopes)
        left = [one for one, share in shares.items() if share >= RIVAL]
    return left


def _confirm(experiment: Experiment, pairs: Sequence[IdealSubstitute], aside: int) -> None:
    """Plays the best pair of each kind, and the parts of each, on fresh seeds."""
    kinds: dict[object, IdealSubstitute] = {}
    for one in pairs:
        kinds.setdefault(tuple((part.component, part.agents) for part in one.parts), one)
    arms: list[IdealSubstitute] = []
    for one in list(kinds.values())[:CONFIRMED]:
        more = [each for each in (*one.parts, one) if each not in (*experiment.undos, *arms)]
        if (len(arms) + len(more)) * experiment.confirm <= experiment.left - aside:
            arms += more
    experiment.undos = [*experiment.undos, *arms]
    names = [one.name for one in arms]
    experiment.confirmed = [*experiment.confirmed, *names]
    experiment.play(names, experiment.confirm_seed, range(experiment.confirm))


def ranked_undos(
    experiment: Experiment,
    undos: Sequence[IdealSubstitute],
    episodes: Sequence[int],
    scopes: Sequence[str],
) -> Mapping[IdealSubstitute, float]:
    """Shares of the episodes that succeed with each undo, the best first; returns break ties."""
    seed, runner = experiment.search_seed, experiment.runner
    experiment.play([one.name for one in undos], seed, episodes)
    played = [one for one in undos if one.name not in runner.broken]
    shares: dict[IdealSubstitute, tuple[float, float]] = {}
    for one in played:
        outcomes = runner.of(one.name, seed, episodes)
        repaired = [s for s in scopes if not experiment.is_at_cost(one, seed, episodes, s)]
        share = max(
            (
                sum(experiment.success(each, scope) for each in outcomes) / len(outcomes)
                for scope in repaired
            ),
            default=0.0,
        )
        shares[one] = share, sum(each.team_return for each in outcomes)
    best = sorted(played, key=lambda one: shares[one], reverse=True)  # of equals the likelier
    return {one: shares[one][0] for one in best}
