"""Results of every policy: for the team, for roles, for every agent, metric by metric."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.episodes.opposition import opponents
from gamekeeper.episodes.outcome import EACH, TEAM
from gamekeeper.evaluation.episode_rows import RETURN, REWARD, ROLE, SUCCESS, Sheet, lost
from gamekeeper.evaluation.estimates import Judge, shared
from gamekeeper.evaluation.inspection import Inspection
from gamekeeper.evaluation.matchups import Checkpoint, Pairing
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.aggregates import AGGREGATES, aggregate, profile
from gamekeeper.statistics.interval import STATISTICS, FloatArray

QUANTILES: Final = (0.05, 0.25, 0.75, 0.95)
MOST_AGENTS: Final = 32
"""Agents of an environment that have rows of their own; the raw episodes have all of them."""
ZERO_SUM: Final = "zero-sum"
FEWEST_SUMS: Final = 10
"""Episodes from which on a sum that isn't 0 counts as constant."""
CANCELS: Final = 1e-9
"""A sum of returns that is smaller, as a part of the largest, is 0 but for rounding."""


@dataclass(frozen=True, slots=True)
class Subject:
    """Subject of a figure: the team, a role, or an agent."""

    scope: str
    name: str


@dataclass(frozen=True, slots=True)
class Ground:
    """An environment's share of an evaluation.

    Attributes:
        inspection: of the environment and the policies.
        has_team: a sum over all agents means something.
        sheets: of every policy's every run by itself.
        total: what all agents' returns add up to in every episode; None: they don't add up to one
            number, or all agents are one team.
        resets: episodes of one seed that began differently for different policies, of how many.
        against: what shows that two agents compete though returns don't add up to one number.
    """

    name: str
    inspection: Inspection
    has_team: bool
    sheets: Mapping[Checkpoint, Sheet]
    total: float | None = None
    resets: tuple[int, int] = (0, 0)
    against: str | None = None

    @property
    def is_rivalry(self) -> bool:
        """True where one agent wins what others lose."""
        return not self.has_team and (self.total is not None or self.against is not None)

    def runs_of(self, policy: str) -> list[Sheet]:
        """A policy's sheets, run by run."""
        return [sheet for side, sheet in self.sheets.items() if side.policy == policy]

    @property
    def subjects(self) -> list[Subject]:
        """The team, roles whose agents are interchangeable, and agents."""
        found = [Subject(TEAM, TEAM), *(Subject(ROLE, role) for role in self.pooled)]
        agents = dict.fromkeys(agent for sheet in self.sheets.values() for agent in sheet.agents)
        return [*found, *(Subject(EACH, agent) for agent in list(agents)[:MOST_AGENTS] if agent)]

    @property
    def compared(self) -> list[Subject]:
        """Subjects of comparison: the team, roles, and agents that have no role together.

        Where returns cancel, the team has no return, but may have succeeded.
        """
        pooled = self.pooled
        alone = [
            Subject(EACH, agent)
            for agent, role in self.inspection.roles.items()
            if role not in pooled
        ]
        return [each for each in self.subjects if each.scope != EACH] + alone[:MOST_AGENTS]

    @property
    def pooled(self) -> list[str]:
        """Roles whose agents may be put together in an episode."""
        declared = self.inspection.declared
        names = dict.fromkeys(
            [*self.inspection.role_names, *(r for s in self.sheets.values() for r in s.roles)]
        )
        return [role for role in names if role and may_pool(declared, role, self.members(role))]

    def members(self, role: str) -> list[str]:
        """The agents that were seen in a role."""
        seen = {
            agent: None
            for sheet in self.sheets.values()
            for agent, its in zip(sheet.agents, sheet.roles, strict=True)
            if its == role
        }
        return list(dict.fromkeys([*self.inspection.members(role), *seen]))


def may_pool(contract: Contract, role: str, members: Sequence[str]) -> bool:
    """True where the agents of a role are interchangeable, or there is only one."""
    declared = contract.roles.get(role)
    return len(members) == 1 or (declared is not None and declared.symmetric is True)


def ground_of(
    spec: Spec, name: str, inspection: Inspection, lineups: Sequence[tuple[Pairing, Sheet]]
) -> Ground:
    """An environment's share, of all its line-ups."""
    own = {each.side: sheet for each, sheet in lineups if each.side is not None}
    sheets = [sheet for _, sheet in lineups]
    declared = any(term.kind == ZERO_SUM for term in inspection.declared.rewards.values())
    total = 0.0 if declared else constant_sum(sheets)
    team = spec.environments[name].team
    against = opposed(sheets) if total is None and team is None else None
    is_team = (total is None and against is None) if team is None else team
    return Ground(
        name,
        inspection,
        is_team,
        own,
        total=None if is_team else total,
        resets=differing_resets(sheets),
        against=against,
    )


def opposed(sheets: Iterable[Sheet]) -> str | None:
    """Sign that agents compete, by their returns in whole episodes; None: there is none."""
    for sheet in sheets:
        rows = sheet.column(RETURN)[sheet.ended] if len(sheet.agents) > 1 else np.empty((0, 0))
        found = opponents(rows, [str(agent) for agent in sheet.agents])
        if found is not None:
            return found
    return None


def constant_sum(sheets: Iterable[Sheet]) -> float | None:
    """Sum of all agents' returns where every whole episode has the same; None where that varies.

    One number tells rivals only where returns vary while their sum doesn't: a team that always
    does the same has a constant sum, too. A sum of 0 tells them wherever an agent gets anything.
    """
    rows = [sheet.column(RETURN)[sheet.ended] for sheet in sheets if len(sheet.agents) > 1]
    rows = [each[~np.isnan(each).all(axis=1)] for each in rows]
    if not sum(map(len, rows)):
        return None
    sums = np.concatenate([np.nansum(each, axis=1) for each in rows])
    largest = max(float(np.nanmax(np.abs(each), initial=0.0)) for each in rows)
    if largest == 0.0 or float(np.ptp(sums)) > CANCELS * largest:
        return None
    total = float(np.median(sums))
    if abs(total) <= CANCELS * largest:
        return 0.0
    firsts = np.concatenate([each[:, 0] for each in rows])
    varies = float(np.nanmax(firsts) - np.nanmin(firsts)) > CANCELS * largest
    return total if varies and len(sums) >= FEWEST_SUMS else None


def differing_resets(sheets: Iterable[Sheet]) -> tuple[int, int]:
    """Episodes of one seed whose first observations differ between line-ups, and of how many."""
    seen: dict[int, list[str]] = {}
    for sheet in sheets:
        for episode, digest in zip(sheet.episodes.tolist(), sheet.resets, strict=True):
            if digest is not None:
                seen.setdefault(episode, []).append(digest)
    several = [digests for digests in seen.values() if len(digests) > 1]
    return sum(len(set(digests)) > 1 for digests in several), len(several)


def results_of(spec: Spec, ground: Ground, judge: Judge) -> Iterator[dict[str, Any]]:
    """The rows of an environment: every policy's, of each run and over them."""
    _refuse_pooling(ground, judge)
    for name, policy in spec.policies.items():
        sheets = ground.runs_of(name)
        if not sheets:
            continue
        is_method = policy.is_method
        for run, sheet in enumerate(sheets):
            of = f"{name}#{run}" if is_method else name
            yield from _rows(spec, ground, judge, name, [sheet], run=run, of=of)
        if is_method and spec.unit != "episode":
            yield from _rows(spec, ground, judge, name, sheets, run=None, of=name)


def _refuse_pooling(ground: Ground, judge: Judge) -> None:
    for role in ground.inspection.role_names:
        if role not in ground.pooled:
            judge.refuse(
                f"one figure for the role {role}",
                "no contract declares its agents interchangeable "
                f"(roles.{role}.symmetric = true): they are shown one by one",
                ground.name,
            )
    if ground.is_rivalry:
        why = ground.against or (
            f"all agents' returns add up to {ground.total:g} in every episode: what one wins "
            "another loses"
        )
        end = "(team = true in the specification, if they are one team all the same)"
        judge.refuse("the team's return", f"{why} {end}", ground.name)
    agents = dict.fromkeys(agent for sheet in ground.sheets.values() for agent in sheet.agents)
    if len(agents) > MOST_AGENTS:
        judge.refuse(
            "rows for every agent",
            f"there are {len(agents):,}; the first {MOST_AGENTS} have rows, the raw episodes all",
            ground.name,
        )


def _rows(
    spec: Spec,
    ground: Ground,
    judge: Judge,
    policy: str,
    sheets: Sequence[Sheet],
    *,
    run: int | None,
    of: str,
) -> Iterator[dict[str, Any]]:
    broken = sum(int(sheet.broken.sum()) for sheet in sheets)
    if broken and spec.environments[ground.name].failed_return is None:
        judge.refuse(
            "figures of failed episodes",
            "an exception or a reward that isn't finite ended them: they count as failures and "
            "have no return (failed_return in the specification gives them one)",
            f"{of} in {ground.name} ({broken})",
        )
    for subject in ground.subjects:
        is_first = True  # success and endings stand in one row of each
        cancels = subject.scope == TEAM and not ground.has_team
        for metric in sheets[0].metrics(spec.terms, spec.infos):
            if cancels and metric.startswith((RETURN, REWARD)):
                continue
            scores = [sheet.values(metric, subject.scope, subject.name) for sheet in sheets]
            if all(np.isnan(each).all() for each in scores):
                continue
            where = {
                "environment": ground.name,
                "policy": policy,
                "run": run,
                "scope": subject.scope,
                "who": subject.name,
                "metric": metric,
            }
            is_rare = subject.scope == EACH and any(np.isnan(each).any() for each in scores)
            named = f"{subject.name if is_rare else of} in {ground.name}"
            lost_seeds = lost(sheets, scores)
            found = _figures(judge, scores, list(where.values()), named, run, lost_seeds)
            yield {
                **where,
                **found,
                "success": _success(judge, sheets, subject, run, of) if is_first else None,
                "endings": _endings(sheets, subject) if is_first else None,
            }
            is_first = False


def _figures(
    judge: Judge,
    scores: Sequence[NDArray[np.float64]],
    name: Sequence[object],
    of: str,
    run: int | None,
    lost_seeds: int,
) -> dict[str, Any]:
    """Mean, median, interquartile mean and quantiles: of episodes, or of runs' means."""
    means = scores[0][~np.isnan(scores[0])]
    if run is None:
        means = np.array([np.nanmean(each) for each in scores if not np.isnan(each).all()])
    found: dict[str, Any] = {}
    whose = f"{name[-1]} of {name[-2]}, {of}"
    for statistic in STATISTICS:
        if float(np.ptp(means)) == 0.0:
            unit = "training runs" if run is None else "episodes"
            found[statistic] = judge.flat(float(means[0]), len(means), unit, of=whose)
        elif run is None:
            found[statistic] = judge.runs(scores, statistic, of=of, name=name, lost=lost_seeds)
        else:
            found[statistic] = judge.episodes(
                scores[0], statistic, of=whose, name=name, lost=lost_seeds
            )
    return {
        "episodes": int(max((~np.isnan(each)).sum() for each in scores)),
        "broken": lost_seeds,
        "runs": len(scores),
        **found,
        "quantiles": {f"{part:g}": float(np.quantile(means, part)) for part in QUANTILES},
    }


def _success(
    judge: Judge, sheets: Sequence[Sheet], subject: Subject, run: int | None, of: str
) -> dict[str, Any] | None:
    values = [sheet.values(SUCCESS, subject.scope, subject.name) for sheet in sheets]
    share = judge.share(np.concatenate(values))
    if share is None or run is not None:
        return share
    name = ["success", subject.scope, subject.name, of]
    over = judge.runs(values, "mean", of=of, name=name, is_share=True)
    if over is None:
        return None
    return {**share, "p": over["value"], "low": over["low"], "high": over["high"]}


def _endings(sheets: Sequence[Sheet], subject: Subject) -> dict[str, Any]:
    kinds, reasons = Counter(terminated=0, truncated=0, cut=0), Counter[str]()
    for sheet in sheets:
        found = sheet.endings(subject.scope, subject.name)
        reasons.update(found.pop("reasons"))
        kinds.update(found)
    return {**kinds, "reasons": dict(reasons)}


def curves_of(spec: Spec, results: Sequence[Mapping[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Points of learning curves: means and IQM of each step, over training runs where several.

    Intervals are those of each point by itself, not of the curve as a whole.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for curve, points in spec.curves.items():
        rows = found.setdefault(curve, [])
        for step, name in points.items():
            is_method = spec.policies[name].is_method
            rows += [
                {"step": step, **{key: row[key] for key in _POINT}}
                for row in results
                if row["policy"] == name and (row["run"] is None) == is_method
            ]
    return found


_POINT: Final = ("policy", "environment", "scope", "who", "metric", "runs", "episodes", *STATISTICS)


SCORE: Final = "score"
"""The team's return on a scale that environments share: `score = [what is 0, what is 1]`."""
Scores = dict[str, FloatArray]
"""[runs, episodes] by environment."""


TAUS: Final = tuple(k / 20 for k in range(21))
"""Scores at which a performance profile is shown."""


def overall_of(spec: Spec, grounds: Sequence[Ground], judge: Judge) -> dict[str, Any]:
    """Aggregates over all environments, and probabilities of improvement; empty where there is one.

    Success is put together as it is; returns only on the scale that every environment names.
    """
    results: list[dict[str, Any]] = []
    compared: list[dict[str, Any]] = []
    if len(grounds) > 1:
        for metric in (SUCCESS, SCORE):
            scores = {name: _scores(spec, grounds, name, metric) for name in spec.policies}
            there = {name: each for name, each in scores.items() if each}
            results += [_row(spec, name, metric, each, judge) for name, each in there.items()]
            compared += _pairs(spec, metric, there, judge)
        if not results:
            judge.refuse(
                "a figure over environments",
                "no scale is shared: give every environment a success, or score = [low, high]",
            )
    return {"results": results, "comparisons": compared}


def _scores(spec: Spec, grounds: Sequence[Ground], policy: str, metric: str) -> Scores:
    """By environment; empty where one of them lacks the metric, or the policy."""
    found: Scores = {}
    for ground in grounds:
        sheets = ground.runs_of(policy)
        scale = spec.environments[ground.name].score
        if not sheets or (metric == SCORE and (scale is None or not ground.has_team)):
            return {}
        name = RETURN if metric == SCORE else SUCCESS
        values = shared([sheet.values(name, TEAM, TEAM) for sheet in sheets])
        if not values.size:
            return {}
        if metric == SCORE and scale is not None:
            values = (values - scale[0]) / (scale[1] - scale[0])
        found[ground.name] = values
    return found


def _row(spec: Spec, policy: str, metric: str, scores: Scores, judge: Judge) -> dict[str, Any]:
    is_method = spec.policies[policy].is_method
    if is_method:
        figures: dict[str, Any] = {
            each: judge.environments(scores, each, of=policy, name=["all", policy, metric])
            for each in AGGREGATES
        }
    else:
        judge.refuse(
            "intervals over all environments",
            "one policy each: such an interval is over the training runs of a method",
            policy,
        )
        nothing = dict.fromkeys(("low", "high", "method"))
        figures = {
            each: {"value": aggregate(scores, statistic=each), **nothing} for each in AGGREGATES
        }
    return {
        "policy": policy,
        "metric": metric,
        "environments": len(scores),
        "runs": min(map(len, scores.values())),
        "unit": "run" if is_method else "episode",
        "profile": profile(scores, TAUS),
        **figures,
    }


def _pairs(
    spec: Spec, metric: str, scores: Mapping[str, Scores], judge: Judge
) -> Iterator[dict[str, Any]]:
    for a, b in spec.pairs:
        if a not in scores or b not in scores:
            continue
        is_run = any(spec.policies[name].is_method for name in (a, b))
        ones, twos = (
            {env: np.asarray(each.mean(axis=1) if is_run else each[0]) for env, each in own.items()}
            for own in (scores[a], scores[b])
        )
        if not is_run and any(len(ones[name]) != len(twos[name]) for name in ones):
            continue  # an episode broke off, so that they can't be paired
        found = judge.improvement(ones, twos, paired=not is_run, of=f"{a} and {b} over all")
        yield {
            "a": a,
            "b": b,
            "metric": metric,
            "environments": len(ones),
            "unit": "run" if is_run else "episode",
            "improvement": found,
        }
