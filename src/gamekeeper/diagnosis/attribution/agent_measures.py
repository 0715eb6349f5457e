"""Measures of agents from outcomes and scans: shares, laziness, influence, Shapley values.

Pure; nothing is played here.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import factorial
from typing import Any, Final, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.checks.effects import influence_rows
from gamekeeper.diagnosis.attribution.message_influence import Talk
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.episodes.plain_json import fields_json, plain
from gamekeeper.episodes.row_tables import html_table, text_lines
from gamekeeper.episodes.summary import Summary
from gamekeeper.statistics.paired import FEWEST, paired_effect
from gamekeeper.statistics.significance import Share, holm, wilson


@dataclass(frozen=True, slots=True)
class Measured:
    """A mean over episodes, in units of return.

    Attributes:
        value: the mean.
        low: lower bound of its 95 % interval; None where fewer than 50 episodes were played.
        high: upper bound.
        p: of it being 0.
        n: episodes.
        baseline: what it is measured against.
    """

    value: float
    low: float | None
    high: float | None
    p: float | None
    n: int
    baseline: str


def measured(
    values: NDArray[np.float64], *, baseline: str, rng: Generator, unit: float = 1.0
) -> Measured | None:
    """The mean of figures of episodes; None where there is no episode.

    Args:
        values: [episodes].
        baseline: what they are measured against.
        rng: draws resamples.
        unit: what one of them could be where all are 0: that none was seen doesn't show that there
            is none, so the interval holds as many as n episodes may well have hidden.
    """
    if not len(values):
        return None
    if len(values) < FEWEST:
        return Measured(float(np.mean(values)), None, None, None, len(values), baseline)
    effect = paired_effect(np.zeros(len(values)), np.asarray(values, np.float64), rng=rng)
    scale = unit if not values.any() else 1.0
    low, high = effect.low * scale, effect.high * scale
    return Measured(effect.value, low, high, effect.p, effect.n, baseline)


@dataclass(frozen=True, slots=True)
class Own:
    """Rewards of one agent in the recorded run.

    Attributes:
        value: mean over its episodes of the sum of its rewards.
        terms: the same by reward term; empty where the run doesn't tell terms.
        share: its part of the team's return; None where any return is negative or the sum is 0.
        idle: part of its actions that are the declared noop; None where none is declared.
    """

    value: float
    terms: dict[str, float]
    share: float | None
    idle: float | None

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it stands in an agent's entry."""
        return {"return": self.value, "terms": self.terms, "share": self.share, "idle": self.idle}


def own_rewards(summary: Summary, outcomes: Iterable[Outcome]) -> dict[str, Own]:
    """Each agent's rewards, idle turns and share of the team's return."""
    terms = mean_terms({a: each.terms.get(a, {}) for a in each.returns} for each in outcomes)
    return {
        agent: Own(of.return_mean, terms.get(agent, {}), of.share, of.idle)
        for agent, of in summary.agents.items()
    }


def mean_terms(
    episodes: Iterable[Mapping[str, Mapping[str, float]]],
) -> dict[str, dict[str, float]]:
    """Each agent's rewards by term, on average over the episodes that have it."""
    counts: Counter[str] = Counter()
    sums: dict[str, Counter[Any]] = {}
    for each in episodes:
        for agent, terms in each.items():
            counts[agent] += 1
            sums.setdefault(agent, Counter()).update(terms)
    return {agent: {t: x / counts[agent] for t, x in mine.items()} for agent, mine in sums.items()}


PART: Final = 0.5
"""Part of a fair share below which an agent is lazy.

A fair share is the average Shapley value of the others of its role. The loss without an agent is
compared with the average loss without another of its role, or with a fair share where that is
more.
"""


ACROSS: Final = 0.1
"""The same where no other agent has its role: roles may differ in what they bring."""
ALPHA: Final = 0.05
NOOP: Final = "noop"


@dataclass(frozen=True, slots=True)
class Laziness:
    """Verdict on an agent's laziness; None where it can't be told, with the reason.

    Attributes:
        is_lazy: its share and what is lost without it are both surely below `PART` of a fair share,
            and another of its role surely brings something.
        fair: the fair share, in units of return.
    """

    is_lazy: bool | None
    why: str
    fair: float | None = None


@dataclass(frozen=True, slots=True)
class Harm:
    """Verdict on an agent's harm to its team; None where it can't be told, with the reason.

    Attributes:
        is_harmful: the team surely has more where it does nothing, beyond chance for the number of
            agents, and its Shapley value is surely negative; None where another baseline plays in
            its place, which an agent that does too little loses to as well.
    """

    is_harmful: bool | None
    why: str


def harms(differences: Mapping[str, Measured], shapley: Mapping[str, Measured]) -> dict[str, Harm]:
    """Tells of each agent whether its team would have more without it.

    Args:
        differences: what the team loses without it.
    """
    told = {name: each for name, each in differences.items() if each.p is not None}
    corrected = dict(zip(told, holm([each.p or 0.0 for each in told.values()]), strict=True))
    found = {}
    for name, lost in differences.items():
        own = shapley.get(name)
        if lost.high is None or own is None or own.high is None:
            found[name] = Harm(None, "too few episodes for an interval")
            continue
        is_less = lost.high < 0 and own.high < 0 and corrected[name] < ALPHA
        does = "it does nothing" if lost.baseline == NOOP else f"{lost.baseline} plays in its place"
        why = (
            f"the team has {-lost.value:.3g} more where {does} (95 % interval {-lost.high:.3g} to "
            f"{-(lost.low or 0.0):.3g}, {lost.n} new episodes), and its Shapley value is at most "
            f"{own.high:.3g}"
        )
        if not is_less:
            found[name] = Harm(False, f"the team doesn't surely have more where {does}")
        elif lost.baseline == NOOP:
            found[name] = Harm(True, why)
        else:
            found[name] = Harm(None, f"{why}; that may be harm, or doing too little")
    return found


def laziness(
    agent: str,
    peers: list[str],
    differences: Mapping[str, Measured],
    shapley: Mapping[str, Measured],
    *,
    baseline: str,
    part: float = PART,
) -> Laziness:
    """Tells whether an agent is lazy.

    Both figures have to say so: a team with hands to spare loses nothing where any one of them
    stops, though each does its part; the Shapley value sees that.

    Args:
        peers: the agents of its role, itself among them; of all roles where it is alone in its own.
        part: of a fair share below which it is lazy.
        baseline: what took the agents' places; only doing nothing tells.
    """
    if len(peers) < 2:
        return Laziness(None, "it is the only agent")
    if baseline != NOOP:
        return Laziness(None, f"{baseline} played in its place, which isn't doing nothing")
    own, lost = shapley.get(agent), differences.get(agent)
    if own is None or lost is None or own.high is None or lost.high is None:
        return Laziness(None, "too few new episodes for an interval (at least 50)")
    others = [shapley[name] for name in peers if name != agent]
    fair = sum(other.value for other in others) / len(others)
    if fair <= 0 or not any(other.low is not None and other.low > 0 for other in others):
        return Laziness(False, "no other surely brings anything", fair)
    usual = sum(differences[name].value for name in peers if name != agent) / len(others)
    usual = max(usual, fair)
    whose = " of its role" if part == PART else ""
    said = (
        f"in {lost.n} new episodes its Shapley value is at most {own.high:.3g} (the "
        f"others{whose}: {fair:.3g} on average), and the team loses at most {lost.high:.3g} where "
        f"it does nothing; lazy is below {part * fair:.3g} and {part * usual:.3g}"
    )
    return Laziness(own.high < part * fair and lost.high < part * usual, said, fair)


@dataclass(frozen=True, slots=True)
class Penalty:
    """Penalty that an agent got under a term whose earner should get it.

    Attributes:
        wrong: share of the looks at which others' doing alone caused it, not the payer's.
        unknown: looks at which nobody's doing nothing alone would have spared it.
        by: how often each other agent caused it.
        first: the first wrong payment: episode, seed, turn, amount, who caused it.
    """

    agent: str
    term: str
    wrong: Share
    unknown: int
    by: Mapping[str, int]
    first: Mapping[str, Any] | None

    @property
    def is_wrong(self) -> bool:
        """It surely isn't always its own doing."""
        return self.first is not None

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        found = fields_json(self)
        share = found.pop("wrong")
        return {**found, **share}


def penalties(scans: Iterable[Mapping[str, Any]]) -> list[Penalty]:
    """Penalties by agent and term, and how often another agent had caused them."""
    looks: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for each in scans:
        for look in each["penalties"]:
            at = {**look, "episode": each["number"]}
            looks.setdefault((look["agent"], look["term"]), []).append(at)
    return [_of(agent, term, mine) for (agent, term), mine in sorted(looks.items())]


def _of(agent: str, term: str, looks: list[Mapping[str, Any]]) -> Penalty:
    told = [look for look in looks if look["causers"]]
    wrong = [look for look in told if agent not in look["causers"]]
    by = Counter(name for look in wrong for name in look["causers"])
    first = min(wrong, key=lambda look: (look["episode"], look["turn"]), default=None)
    keys = ("episode", "seed", "turn", "paid", "causers")
    return Penalty(
        agent=agent,
        term=term,
        wrong=wilson(len(wrong), len(told)),
        unknown=len(looks) - len(told),
        by=dict(sorted(by.items())),
        first=None if first is None else {key: first[key] for key in keys},
    )


def influence(scans: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The share of replaced actions that changed something, with Wilson's 95 % interval.

    Turns from which on an unchanged rerun differs by itself are no looks, so what is counted is
    beyond the unchanged rerun.
    """
    looks: Counter[tuple[str, str, str, int]] = Counter()
    hits: Counter[tuple[str, str, str, int]] = Counter()
    for each in scans:
        for source, target, on, lag, changed, looked in each["influence"]:
            looks[source, target, on, lag] += looked
            hits[source, target, on, lag] += changed
    return influence_rows(looks, hits)


FloatArray = NDArray[np.float64]

MOST_EXACT: Final = 8
"""Players up to whom every coalition is played: 256 of them."""


def shapley_exact(values: FloatArray) -> FloatArray:
    """The Shapley values of a game whose every coalition is known.

    Args:
        values: [coalitions, episodes], coalition by its bits; all 2**n of them.
    Returns:
        [players, episodes]; they sum to the value of all minus that of none.
    Source: Shapley 1953, "A value for n-person games".
    """
    count = len(values)
    players = count.bit_length() - 1
    masks = np.arange(count)
    sizes = np.array([mask.bit_count() for mask in range(count)])
    shares = np.array(
        [
            factorial(size) * factorial(players - size - 1) / factorial(players)
            for size in range(players)
        ]
    )
    found = np.empty((players, values.shape[1]))
    for player in range(players):
        without = masks[(masks >> player) & 1 == 0]
        gains = values[without | 1 << player] - values[without]
        found[player] = shares[sizes[without]] @ gains
    return found


def prefixes(order: Sequence[int]) -> list[int]:
    """The coalitions of a team that is put together in this order, from none to all."""
    found = [0]
    for player in order:
        found.append(found[-1] | 1 << player)
    return found


def shapley_of_orders(
    played: Sequence[Sequence[int]], values: Mapping[int, float]
) -> NDArray[np.float64]:
    """Contribution of each player in one episode, on average over some orders.

    Its expectation over random orders is the Shapley value; it sums to the value of all minus that
    of none whatever the orders are.

    Args:
        values: of every coalition among their prefixes.
    Returns:
        [players].
    Source: Castro, Gomez & Tejada 2009, "Polynomial calculation of the Shapley value based on
        sampling"; Mitchell et al. 2022, "Sampling permutations for Shapley value estimation"
        (antithetic orders).
    """
    found = np.zeros(len(played[0]))
    for order in played:
        steps = prefixes(order)
        for player, before, after in zip(order, steps, steps[1:], strict=False):
            found[player] += values[after] - values[before]
    return found / len(played)


def everyone(players: int) -> int:
    """The coalition of all."""
    return (1 << players) - 1


def wanted(players: int, *, rng: Generator) -> tuple[list[int], tuple[tuple[int, ...], ...]]:
    """The coalitions to be played in one episode, and the orders where they are sampled.

    All of them up to `MOST_EXACT` players. Beyond that those of an order and its reverse, which
    evens out the chance of the first, and everybody but one, for the difference rewards.
    """
    if players <= MOST_EXACT:
        return list(range(1 << players)), ()
    order = tuple(rng.permutation(players).tolist())
    drawn = order, order[::-1]
    whole = everyone(players)
    masks = {mask for order in drawn for mask in prefixes(order)}
    masks |= {whole & ~(1 << player) for player in range(players)}
    return sorted(masks), drawn


@dataclass(frozen=True, slots=True)
class AgentPart:
    """One agent's part in what its team came to.

    Attributes:
        own: what it was paid itself in the recorded run, its share, its idle part.
        difference: what the team loses where the baseline plays for it and the others react; None
            where nobody can choose anew, or where it joins late.
        turn_all: what the team loses where it does nothing all along and the others do what they
            did.
        turn_one: the same of one of its actions, on average.
        shapley: its Shapley value.
        laziness: whether it is lazy.
        harm: whether the team has more without it.
    """

    own: Own
    difference: Measured | None
    turn_all: Measured | None
    turn_one: Measured | None
    shapley: Measured | None
    laziness: Laziness
    harm: Harm

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            **self.own.to_json(),
            "difference": plain(self.difference),
            "turn": {"all": plain(self.turn_all), "one": plain(self.turn_one)},
            "shapley": plain(self.shapley),
            "lazy": self.laziness.is_lazy,
            "lazy_why": self.laziness.why,
            "fair_share": self.laziness.fair,
            "harmful": self.harm.is_harmful,
            "harmful_why": self.harm.why,
        }


@dataclass(frozen=True, slots=True)
class Attribution:
    """Attribution of a run's returns, influence and penalties to its agents.

    Attributes:
        run: the folder, or None.
        episodes: recorded ones that were looked into.
        fresh: fresh ones that were played.
        reused: of all those, how many an earlier call had played.
        steps: env steps that these took.
        budget: those that could be taken; None: as many as the episodes take.
        recorded: all of the run, of which the agents' own figures are.
        replayed: recorded and fresh ones that were looked into.
        loop: `closed`: policies react. `open`: only recorded actions could be played.
        policies: named in place of the recorded ones, by agent, role or `*`.
        baseline: what was asked to take agents' places; what did is named with each figure.
        method: of the Shapley values: `exact` or `sampled`.
        everyone: mean team return where all play their policies; None where none can.
        nobody: the same where all play the baseline.
        agents: by name.
        influence: rows of from, to, on, lag, p, low, high, n.
        messages: signalling, coordination, listening.
        penalties: who paid under terms that their earner should pay.
        not_tested: what wasn't looked at, and why.
        rivals: what shows that agents compete; then there is no figure of a team. None: nothing.
    """

    run: str | None
    episodes: int
    fresh: int
    reused: int
    steps: int
    budget: int | None
    recorded: int
    replayed: int
    loop: Literal["closed", "open"]
    policies: Mapping[str, str]
    baseline: str
    method: Literal["exact", "sampled"] | None
    everyone: float | None
    nobody: float | None
    agents: Mapping[str, AgentPart]
    influence: tuple[Mapping[str, Any], ...]
    messages: tuple[Talk, ...]
    penalties: tuple[Penalty, ...]
    not_tested: tuple[Mapping[str, str], ...]
    rivals: str | None = None

    @property
    def lazy(self) -> tuple[str, ...]:
        """The lazy agents."""
        return tuple(a for a, part in self.agents.items() if part.laziness.is_lazy)

    @property
    def harmful(self) -> tuple[str, ...]:
        """The agents without which the team has more."""
        return tuple(a for a, part in self.agents.items() if part.harm.is_harmful)

    @property
    def wrong_penalties(self) -> tuple[Penalty, ...]:
        """The penalties of which some were another's doing."""
        return tuple(each for each in self.penalties if each.is_wrong)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper attribute --json` prints."""
        found = fields_json(self)
        names = {"all": "everyone", "none": "nobody", "shapley": "method"}
        team = {name: found.pop(own) for name, own in names.items()}
        return {**found, "team": team}

    def rows(self) -> list[list[str]]:
        """A heading and a row for each agent, as texts."""
        head = ["agent", "return", "share", "idle", "difference", "Shapley", "verdict"]
        return [head, *(_row(name, part) for name, part in self.agents.items())]

    def __str__(self) -> str:
        lines = text_lines(self.rows())
        for each in self.wrong_penalties:
            lines.append(f"{each.agent} pays {each.term} for what {', '.join(each.by)} did")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html_table(self.rows(), caption="Attribution of the run's returns")


def _row(name: str, part: AgentPart) -> list[str]:
    own, lazy = part.own, part.laziness.is_lazy
    verdict = "-" if lazy is None else "lazy" if lazy else "not lazy"
    return [
        name,
        f"{own.value:.3f}",
        "-" if own.share is None else f"{own.share:.0%}",
        "-" if own.idle is None else f"{own.idle:.0%}",
        _shown(part.difference),
        _shown(part.shapley),
        "harmful" if part.harm.is_harmful else verdict,
    ]


def _shown(part: Measured | None) -> str:
    if part is None:
        return "-"
    if part.low is None or part.high is None:
        return f"{part.value:.3f} (n = {part.n})"
    return f"{part.value:.3f} ({part.low:.3f} to {part.high:.3f})"
