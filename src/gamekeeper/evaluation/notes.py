"""Notes and claims of an evaluation: sentences on how it was played and what it shows."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.evaluation.comparisons import ALPHA, PRIMARY
from gamekeeper.evaluation.results import Ground
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.interval import (
    FEWEST_EPISODES,
    FEWEST_RUNS,
    FEWEST_RUNS_APART,
    RULE_OF_THREE,
)

_LONG: Final = {"mean": "mean", "iqm": "interquartile mean", "median": "median"}
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
    grounds: Sequence[Ground],
) -> list[str]:
    """Sentences on how it was played and what the figures are about, the most important first.

    Args:
        stopping: how it was decided that this is enough.
        failures: the episodes that an exception ended.
        unpinned: what differs from what the suite pins.
    """
    return [
        *(f"Not the suite as it was pinned: {text}." for text in unpinned),
        *(f"Failed: {text}." for text in failures[:MOST_FAILURES]),
        *_about(spec),
        *_begun(spec, grounds, episodes),
        *_rare(spec, episodes),
        *_stopped(stopping),
        *_unclaimed(comparisons),
        *_crossed(crossplay),
    ]


def _begun(spec: Spec, grounds: Sequence[Ground], episodes: int) -> Iterator[str]:
    """Tells which episodes were played, and whether those of one seed began alike for all."""
    differing = [ground for ground in grounds if ground.resets[0]]
    alike = (
        ""
        if differing or not any(ground.resets[1] for ground in grounds)
        else ("; first observations were the same")
    )
    yield (
        f"All policies played episodes 0 to {episodes - 1} of seed {spec.seed}, with the same "
        f"random numbers{alike}."
    )
    for ground in differing:
        differ, several = ground.resets
        yield (
            f"{ground.name} began differently for different policies in {differ} of {several} "
            "episodes of the same seed: its resets don't follow their seed, so that episodes "
            "aren't paired and comparisons take more of them."
        )


def _rare(spec: Spec, episodes: int) -> Iterator[str]:
    """Says what so many episodes may have missed, where means have intervals."""
    is_single = any(not each.is_method for each in spec.policies.values())
    if is_single and episodes >= FEWEST_EPISODES["mean"]:
        yield (
            f"Outcomes rarer than 1 in {episodes // RULE_OF_THREE} episodes may be missing from "
            f"these {episodes}. Where one would cost much, the mean's interval is too narrow; "
            "IQM and median don't depend on it."
        )
    runs = [
        max(len(policy.runs_in(each)) for each in spec.environments)
        for policy in spec.policies.values()
        if policy.is_method
    ]
    most = max(runs, default=0)
    if most >= FEWEST_RUNS["mean"]:
        yield (
            f"A way of training that fails less than once in {most // RULE_OF_THREE} runs may "
            f"not have failed in {most}: the mean and its interval don't know of it; the IQM "
            "doesn't depend on it."
        )


def _about(spec: Spec) -> Iterator[str]:
    """Subjects of the claims."""
    single = [name for name, each in spec.policies.items() if not each.is_method]
    if single:
        names = "these policies" if len(single) == len(spec.policies) else ", ".join(single)
        yield f"Claims about {names} are about one checkpoint each, not about how it was trained."
    for name, policy in spec.policies.items():
        if not policy.is_method:
            continue
        runs = max(len(policy.runs_in(each)) for each in spec.environments)
        text = f"{name} has {runs} training run{'s' * (runs != 1)}"
        lacking = [
            f"{fewest} for the {_LONG[each]}"
            for each, fewest in FEWEST_RUNS.items()
            if runs < fewest
        ]
        if runs < FEWEST_RUNS_APART:
            lacking.append(f"{FEWEST_RUNS_APART} of each for a difference of two methods")
        if lacking:
            yield f"{text}: too few for some intervals over runs ({', '.join(lacking)})."
        else:
            yield f"{text}: they are the unit of what is said about it."


def claims_of(comparisons: Sequence[Mapping[str, Any]]) -> list[str]:
    """Comparisons of the primary family that were tested, in words."""
    return [f"{row['claim']}." for row in comparisons if row["family"] == PRIMARY and _tested(row)]


def _tested(row: Mapping[str, Any]) -> bool:
    return (row["difference"] or {}).get("p") is not None


def _unclaimed(comparisons: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Tells the families of comparisons, and how many have no claim."""
    if not comparisons:
        return
    primary = [row for row in comparisons if row["family"] == PRIMARY]
    tested = sum(map(_tested, primary))
    secondary = len(comparisons) - len(primary)
    if tested > 1:
        yield (
            f"Where policies don't differ, the chance that any of these {tested} comparisons says "
            f"they do is {100 * ALPHA:g} % at most."
        )
    if secondary:
        yield (
            f"Of the other comparisons ({secondary}: roles, agents, and figures that follow from "
            "another) no claim is made; their p-values are corrected for the number of all "
            "comparisons."
        )
    for row in primary:
        if not _tested(row):
            yield f"No claim: {row['claim']}."


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
        if found["ranking"]:
            cycle = found["ranking"]["cycle"]
            beaten = [*cycle[1:], cycle[0]]
            beats = ", ".join(f"{a} beats {b}" for a, b in zip(cycle, beaten, strict=True))
            shares = ", ".join(
                f"{policy} {100 * share:.0f} %"
                for policy, share in found["ranking"]["alpha_rank"].items()
            )
            yield (
                f"{name} has no ranking: {beats}. By alpha-rank, the share of time that a "
                f"population plays each where better ones take over: {shares}."
            )
