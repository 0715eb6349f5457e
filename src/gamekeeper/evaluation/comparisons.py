"""Policies against one another, on the same seeds, with p-values corrected for their number."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.episodes.outcome import TEAM
from gamekeeper.evaluation.crossplay import CrossplayTable, both_ways
from gamekeeper.evaluation.episode_rows import RETURN, SUCCESS, lost
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.results import Ground, Subject
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.interval import FloatArray, rounded
from gamekeeper.statistics.significance import holm

ALPHA: Final = 0.05
POSITIONS: Final = "positions"
WIDE: Final = (TEAM, POSITIONS)
"""Scopes that are about whole policies."""


PRIMARY, SECONDARY = "primary", "secondary"
"""Families of comparisons. Claims are made of the primary one: of teams, or of rivals in both
positions; where an environment has neither, of its roles and agents."""


def comparisons_of(
    spec: Spec, grounds: Sequence[Ground], tables: Mapping[str, CrossplayTable], judge: Judge
) -> list[dict[str, Any]]:
    """Every pair in every environment that both play in.

    Where one agent wins what others lose, returns of policies that each play against themselves
    say nothing of who is better: there they are compared against one another, both ways, if
    cross-play has it. What says the same twice is compared once: the team, a role and the agent of
    an environment of one agent; success where it is whether the return exceeds a threshold is
    secondary. p-values of the primary family are corrected for their number (Holm), those of the
    secondary one for the number of all.
    """
    found: list[dict[str, Any]] = []
    for ground in grounds:
        rows = [row for pair in spec.pairs for row in _rows_of(spec, ground, judge, pair)]
        if ground.is_rivalry:
            rows += _head_to_head(spec, ground, tables.get(ground.name), judge)
        wide = [row for row in rows if row["scope"] in WIDE]
        for row in rows:
            is_primary = not row.pop("repeats") and (row["scope"] in WIDE or not wide)
            found.append({**row, "family": PRIMARY if is_primary else SECONDARY})
    for family in (PRIMARY, SECONDARY):
        _correct(found, family)
    begun = {ground.name: ground.resets for ground in grounds}
    return [{**row, "claim": claim_of(spec, row, begun[row["environment"]])} for row in found]


def _correct(rows: Sequence[dict[str, Any]], family: str) -> None:
    """Puts corrected p-values into a family: of it alone, or of all rows for the secondary one."""
    tested = [row for row in rows if (row["difference"] or {}).get("p") is not None]
    if family == PRIMARY:
        tested = [row for row in tested if row["family"] == PRIMARY]
    alone = [row["difference"].get("p_alone", row["difference"]["p"]) for row in tested]
    for row, p, its in zip(tested, holm(alone), alone, strict=True):
        if row["family"] == family:
            row["difference"] |= {"p": p, "p_alone": its, "tests": len(tested)}


def _head_to_head(
    spec: Spec, ground: Ground, table: CrossplayTable | None, judge: Judge
) -> Iterator[dict[str, Any]]:
    """Pairs that sat opposite one another both ways on the same seeds."""
    met = {} if table is None else both_ways(table)
    for a, b in spec.pairs:
        duel = met.get((a, b)) or (met[b, a].reversed if (b, a) in met else None)
        if duel is None or table is None:
            judge.refuse("returns compared", _unmet(table), f"{a} and {b} in {ground.name}")
            continue
        name = [ground.name, a, b, "both positions", RETURN]
        compared = duel.compared(judge, of=f"{a} and {b} in {ground.name}", name=name)
        yield {
            "environment": ground.name,
            "a": a,
            "b": b,
            "scope": POSITIONS,
            "who": " and ".join(table.positions),
            "metric": RETURN,
            "unit": "run" if compared.seeds is not None else "episode",
            **compared.to_json(),
            "repeats": False,
        }


def _unmet(table: CrossplayTable | None) -> str:
    """Reason why two rivals can't be compared."""
    if table is None:
        return (
            "one wins what the other loses, so that a policy that plays against itself shows no "
            "strength; cross-play lets two policies meet both ways"
        )
    if len(table.positions) != 2:
        return "rivals are compared in two positions, and cross-play has more: name two of them"
    return "they didn't meet in both positions: name both among the partners of cross-play"


def _rows_of(
    spec: Spec, ground: Ground, judge: Judge, pair: tuple[str, str]
) -> Iterator[dict[str, Any]]:
    """The rows of a pair; those that only repeat another row's differences are left out."""
    seen: list[FloatArray] = []
    metrics = (SUCCESS,) if ground.is_rivalry else (RETURN, SUCCESS)
    for subject in ground.compared:
        has_interval = False
        for metric in metrics:
            if subject.scope == TEAM and metric == RETURN and not ground.has_team:
                continue
            row = _row(spec, ground, judge, pair, subject, metric)
            if row is None:
                continue
            shape = _shape(ground, pair, subject, metric)
            is_known = any(np.allclose(shape, other, rtol=0.0, atol=1e-12) for other in seen)
            if metric == RETURN and shape.any() and is_known:
                continue
            seen.append(shape)
            repeats = has_interval and metric == SUCCESS and _is_threshold(ground, pair, subject)
            has_interval = (row["difference"] or {}).get("low") is not None
            yield {**row, "repeats": repeats}


def _values(ground: Ground, pair: tuple[str, str], subject: Subject, metric: str) -> FloatArray:
    """[episodes] a figure of all runs of both policies, one after the other."""
    sheets = [sheet for name in pair for sheet in ground.runs_of(name)]
    return np.concatenate([sheet.values(metric, subject.scope, subject.name) for sheet in sheets])


def _shape(ground: Ground, pair: tuple[str, str], subject: Subject, metric: str) -> FloatArray:
    """Figures without their unit: a team's sum and its only agent's return look the same."""
    values = np.nan_to_num(_values(ground, pair, subject, metric), nan=0.0)
    largest = float(np.abs(values).max(initial=0.0))
    return np.asarray(values / largest if largest > 0 else values)


def _is_threshold(ground: Ground, pair: tuple[str, str], subject: Subject) -> bool:
    """True where an episode succeeded if, and only if, its return is over some number."""
    returns, success = (_values(ground, pair, subject, metric) for metric in (RETURN, SUCCESS))
    there = ~np.isnan(returns) & ~np.isnan(success)
    hits, misses = returns[there & (success == 1.0)], returns[there & (success == 0.0)]
    return not len(hits) or not len(misses) or bool(misses.max() < hits.min())


def _row(
    spec: Spec, ground: Ground, judge: Judge, pair: tuple[str, str], subject: Subject, metric: str
) -> dict[str, Any] | None:
    """A comparison; None where a policy doesn't play here or has no such figure."""
    a, b = pair
    sheets = [ground.runs_of(name) for name in pair]
    ones, twos = ([s.values(metric, subject.scope, subject.name) for s in each] for each in sheets)
    if not ones or not twos:
        return None
    of_all = list(zip([*sheets[0], *sheets[1]], [*ones, *twos], strict=True))
    figures = [values[~sheet.broken] for sheet, values in of_all]
    known = [not np.isnan(each).all() for each in figures if len(each)]
    if not known or not all(known):
        return None
    is_run = spec.unit != "episode" and any(spec.policies[name].is_method for name in pair)
    if not is_run and len(ones) + len(twos) > 2:
        return None  # runs of methods, each taken alone: there is no one difference
    broken = lost(*(list(each) for each in zip(*of_all, strict=True)))
    of = f"{metric} of {subject.name}, {a} and {b} in {ground.name}"
    name = [ground.name, a, b, subject.scope, subject.name, metric]
    is_share = metric == SUCCESS
    if is_run:
        compared = judge.between_runs(ones, twos, of=of, name=name, lost=broken, is_share=is_share)
    else:
        compared = judge.paired(ones[0], twos[0], of=of, name=name, lost=broken, is_share=is_share)
    return {
        "environment": ground.name,
        "a": a,
        "b": b,
        "scope": subject.scope,
        "who": subject.name,
        "metric": metric,
        "unit": "run" if is_run else "episode",
        **compared.to_json(),
    }


def claim_of(spec: Spec, row: dict[str, Any], begun: tuple[int, int] = (0, 0)) -> str:
    """A comparison in words, as far as it goes.

    Args:
        begun: episodes that began differently for two policies on one seed, and of how many.
    """
    a, b = row["a"], row["b"]
    subject = "" if row["scope"] == TEAM else f" of {row['who']}"
    where = f"{row['environment']}: {row['metric']}{subject}"
    difference, broken = row["difference"], row["broken"]
    if difference is None:
        if not broken:
            return f"{where}: {a} and {b} have no episode in common"
        return f"{where}: {a} and {b} can't be compared, {_whole(row)}"
    figure = signed(difference, is_share=row["metric"] == SUCCESS)
    scope = _scope(spec, row, begun)
    p = difference.get("p")
    if difference["low"] is None:
        if p is None:
            return f"{where}: {a} against {b} {figure}, no interval; {scope}"
        above, below = difference["above"], difference["below"]
        side, other = ("above", "below") if above > below else ("below", "above")
        claimed = p <= ALPHA
        if claimed and row["n"] in (above, below):
            found = f"is {side} {b} in each of {row['n']} pairs"
        else:
            more = f"is more often {side} {b} than {other}"
            more = more if claimed else f"isn't shown to differ from {b}"
            found = f"{more}: above in {above}, below in {below} of {row['n']} pairs"
        test = f"p = {p:.2g} (sign test, Holm); {figure} on average, without an interval"
        return f"{where}: {a} {found}, {test}; {scope}"
    # The interval is of this comparison alone, p of the whole family: a claim takes both.
    is_apart = difference["low"] > 0 or difference["high"] < 0
    corrected = "" if p is None else f", p = {p:.2g} (Holm)"
    if is_apart and (p is None or p <= ALPHA):
        verb = "is above" if difference["value"] > 0 else "is below"
    else:
        verb = "isn't shown to differ from"
        if is_apart:
            corrected = (
                f", p = {p:.2g} by Holm's correction for {difference['tests']} comparisons "
                f"(alone {difference['p_alone']:.2g}; the interval is that of one comparison)"
            )
    return f"{where}: {a} {verb} {b}, {figure}{corrected}; {scope}"


def _whole(row: Mapping[str, Any]) -> str:
    """Says on how many episodes a comparison rests."""
    if not row["broken"]:
        return f"{row['episodes']}"
    return f"{row['broken']} of {row['of_episodes']} episodes broke off"


def _scope(spec: Spec, row: dict[str, Any], begun: tuple[int, int]) -> str:
    """Subject of the claim, and the number of units that it rests on."""
    note = f" ({_whole(row)})" if row["broken"] else ""
    if row["unit"] == "episode":
        paired = "episodes that don't begin alike on one seed" if begun[0] else "paired episodes"
        return f"about these two policies as they are, {row['n']} {paired}{note}"
    single = [name for name in (row["a"], row["b"]) if not spec.policies[name].is_method]
    units = f"{row['n']} training runs on {row['episodes']} seeds{note}"
    if single:
        return f"about the method and the one policy of {single[0]}, {units}"
    return f"about the methods, {units}"


def signed(found: dict[str, Any], *, is_share: bool = False) -> str:
    """`+0.12 (+0.03 to +0.21)`; of shares in percentage points."""
    unit, scale = (" percentage points", 100.0) if is_share else ("", 1.0)
    if found["low"] is None:
        return f"{scale * found['value']:+z.4g}{unit}"
    low, high = scale * found["low"], scale * found["high"]
    value, *bounds = (
        rounded(each, low, high, sign="+") for each in (scale * found["value"], low, high)
    )
    return f"{value}{unit} ({' to '.join(bounds)})"
