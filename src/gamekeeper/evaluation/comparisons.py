"""Policies against one another, on the same seeds, with p-values corrected for their number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.evaluation.crossplay import CrossplayTable, both_ways
from gamekeeper.evaluation.episode_rows import RETURN, SUCCESS
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.results import Ground, Whom
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.interval import FEWEST_RUNS
from gamekeeper.statistics.significance import holm

ALPHA: Final = 0.05


def comparisons_of(
    spec: Spec, grounds: Sequence[Ground], tables: Mapping[str, CrossplayTable], judge: Judge
) -> list[dict[str, Any]]:
    """Every pair in every environment that both play in; Holm's correction is over all of them.

    Where rewards cancel, returns of policies that each play against themselves say nothing of who
    is better: there they are compared against one another, both ways, if cross-play has it.
    """
    found = []
    for ground in grounds:
        metrics = (RETURN, SUCCESS) if ground.has_team else (SUCCESS,)
        found += [
            row
            for a, b in spec.pairs
            for whom in ground.compared
            for metric in metrics
            if (row := _row(spec, ground, judge, (a, b), whom, metric)) is not None
        ]
        if not ground.has_team:
            found += _head_to_head(spec, ground, tables.get(ground.name), judge)
    judged = [row for row in found if (row["difference"] or {}).get("p") is not None]
    for row, p in zip(judged, holm([row["difference"]["p"] for row in judged]), strict=True):
        row["difference"] |= {"p": p, "p_alone": row["difference"]["p"]}
    return [{**row, "claim": claim_of(spec, row)} for row in found]


def _head_to_head(
    spec: Spec, ground: Ground, table: CrossplayTable | None, judge: Judge
) -> Iterator[dict[str, Any]]:
    """Pairs that sat opposite one another both ways on the same seeds."""
    met = {} if table is None else both_ways(table)
    if not met:
        judge.refuse(
            "returns compared",
            "rewards cancel, so that one who plays against itself shows no strength; cross-play "
            "lets two policies meet both ways",
            ground.name,
        )
    for a, b in spec.pairs:
        figures = met.get((a, b)) or tuple(reversed(met.get((b, a), ())))
        if not figures or table is None:
            continue
        name = [ground.name, a, b, "both seats", RETURN]
        of = f"{a} and {b} in {ground.name}"
        difference, improvement, n = judge.paired(*figures, of=of, name=name)
        yield {
            "environment": ground.name,
            "a": a,
            "b": b,
            "scope": "seats",
            "who": " and ".join(table.seats),
            "metric": RETURN,
            "unit": "episode",
            "n": n,
            "difference": difference,
            "improvement": improvement,
        }


def _row(
    spec: Spec, ground: Ground, judge: Judge, pair: tuple[str, str], whom: Whom, metric: str
) -> dict[str, Any] | None:
    a, b = pair
    ones, twos = (
        [sheet.values(metric, whom.scope, whom.name) for sheet in ground.runs_of(name)]
        for name in pair
    )
    if not ones or not twos or any(np.isnan(each).all() for each in [*ones, *twos]):
        return None
    is_run = spec.unit != "episode" and any(spec.policies[name].is_method for name in pair)
    if not is_run and len(ones) + len(twos) > 2:
        return None  # runs of methods, each taken alone: there is no one difference
    of = f"{a} and {b} in {ground.name}"
    name = [ground.name, a, b, whom.scope, whom.name, metric]
    if is_run:
        difference, improvement, n = judge.between_runs(ones, twos, of=of, name=name)
    else:
        difference, improvement, n = judge.paired(ones[0], twos[0], of=of, name=name)
    return {
        "environment": ground.name,
        "a": a,
        "b": b,
        "scope": whom.scope,
        "who": whom.name,
        "metric": metric,
        "unit": "run" if is_run else "episode",
        "n": n,
        "difference": difference,
        "improvement": improvement,
    }


def claim_of(spec: Spec, row: dict[str, Any]) -> str:
    """A comparison in words, as far as it goes."""
    whom = "" if row["scope"] == "team" else f" of {row['who']}"
    what = "success" if row["metric"] == SUCCESS else f"{row['metric']}"
    where = f"{row['environment']}: {what}{whom}"
    difference = row["difference"]
    if difference is None:
        return f"{where}: {row['a']} and {row['b']} have no episode in common"
    figure = signed(difference, is_share=row["metric"] == SUCCESS)
    scope = _scope(spec, row)
    if difference["low"] is None:
        return f"{where}: {row['a']} against {row['b']} {figure}, no interval; {scope}"
    p = difference.get("p")
    is_clear = difference["low"] > 0 or difference["high"] < 0
    if is_clear and (p is None or p <= ALPHA):
        verb = "is above" if difference["value"] > 0 else "is below"
    else:
        verb = "isn't shown to differ from"
    corrected = "" if p is None else f", p = {p:.3g} (Holm)"
    return f"{where}: {row['a']} {verb} {row['b']}, {figure}{corrected}; {scope}"


def _scope(spec: Spec, row: dict[str, Any]) -> str:
    """Subject of the claim."""
    if row["unit"] == "episode":
        return f"about these two policies as they are, {row['n']} paired episodes"
    single = [name for name in (row["a"], row["b"]) if not spec.policies[name].is_method]
    if single:
        return f"about the method and the one policy of {single[0]}, {row['n']} training runs"
    return f"about the methods, {row['n']} training runs"


def signed(found: dict[str, Any], *, is_share: bool = False) -> str:
    """`+0.12 (+0.03 to +0.21)`; of shares in percentage points."""
    unit = " percentage points" if is_share else ""
    value = _number(found["value"], is_share) + unit
    if found["low"] is None:
        return value
    return f"{value} ({_number(found['low'], is_share)} to {_number(found['high'], is_share)})"


def _number(value: float, is_share: bool) -> str:
    return f"{100 * value:+.1f}" if is_share else f"{value:+.3g}"


MOST_CLAIMS: Final = 24
"""Comparisons that are claims in words; those of teams and rivals always are."""
MOST_FAILURES: Final = 5
"""Most failures that notes name; the raw episodes have all."""


def notes_of(
    spec: Spec,
    *,
    episodes: int,
    stopping: Mapping[str, Any] | None,
    comparisons: Sequence[Mapping[str, Any]],
    crossplay: Mapping[str, Mapping[str, Any]],
    failures: Sequence[str],
    unpinned: Sequence[str],
) -> list[str]:
    """Sentences on how it was played and what the figures are about, the most important first.

    Args:
        spec: of the evaluation.
        episodes: that each policy played.
        stopping: how it was decided that this is enough.
        comparisons: with their claims.
        crossplay: by environment.
        failures: the episodes that an exception ended.
        unpinned: what differs from what the suite pins.
    """
    return [
        *(f"Not the suite as it was pinned: {text}." for text in unpinned),
        *(f"Failed: {text}." for text in failures[:MOST_FAILURES]),
        *_about(spec),
        f"All policies played the same episodes, 0 to {episodes - 1} of seed {spec.seed}: the same "
        f"resets, and the same random numbers for policies that draw them.",
        *_stopped(stopping),
        *_unclaimed(comparisons),
        *_crossed(crossplay),
    ]


def _about(spec: Spec) -> Iterator[str]:
    """Subjects of the claims."""
    single = [name for name, each in spec.policies.items() if not each.is_method]
    if single:
        about = "is one policy: claims are about it as it is"
        if len(single) > 1:
            about = "are one policy each: claims are about them as they are"
        yield (
            f"{', '.join(single)} {about}, not about a training method; the statistical unit is "
            "the episode."
        )
    for name, policy in spec.policies.items():
        if not policy.is_method:
            continue
        runs = max(len(policy.runs_in(each)) for each in spec.environments)
        fewest = min(FEWEST_RUNS.values())
        if runs < fewest:
            yield (
                f"{name} has {runs} training run{'s' * (runs != 1)}: too few for an interval over "
                f"runs ({fewest} are needed), so they are listed one by one."
            )
        else:
            yield f"{name} has {runs} training runs: they are the unit of what is said about it."


def claims_of(comparisons: Sequence[Mapping[str, Any]]) -> list[str]:
    """Comparisons that have an interval, in words: teams and rivals first, then roles."""
    return [f"{row['claim']}." for row in _claimed(comparisons)]


def _claimed(comparisons: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    known = _with_interval(comparisons)
    wide = [row for row in known if row["scope"] in ("team", "seats")]
    rest = [row for row in known if row not in wide]
    return [*wide, *rest[: max(MOST_CLAIMS - len(wide), 0)]]


def _with_interval(comparisons: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [row for row in comparisons if (row["difference"] or {}).get("low") is not None]


def _unclaimed(comparisons: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Counts the comparisons that no claim words."""
    known = len(_with_interval(comparisons))
    more = known - len(_claimed(comparisons))
    if more:
        yield f"{more} more comparisons of roles and agents stand in the tables."
    if known < len(comparisons):
        yield f"{len(comparisons) - known} comparisons have no interval: no claim is made of them."


def _stopped(stopping: Mapping[str, Any] | None) -> Iterator[str]:
    if stopping is None:
        return
    asked = f"{stopping['metric']} of {stopping['who']} known to {stopping['width']:g}"
    end = "reached" if stopping["reached"] else f"not reached by episode {stopping['most']}"
    yield (
        f"Playing went on until {asked} for every policy: {end} after {stopping['episodes']} "
        f"episodes, looked at {stopping['rounds']} times. Its intervals allow for looking until "
        "they are narrow; those of other figures don't."
    )


def _crossed(crossplay: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, found in crossplay.items():
        kinds = [cell["kind"] for cell in found["cells"]]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        roles = ", ".join(found["roles"])
        yield f"{name}: cross-play of {len(kinds)} pairings ({counts}) by {roles}."
    if any(found["best_response"] for found in crossplay.values()):
        yield (
            "Best responses were chosen on the same episodes that they are shown by, so their "
            "leads are overstated."
        )
