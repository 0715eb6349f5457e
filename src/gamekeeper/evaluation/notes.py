"""Notes and claims of an evaluation: sentences on how it was played and what it shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.evaluation.comparisons import ALPHA, PRIMARY
from gamekeeper.evaluation.results import Ground
from gamekeeper.evaluation.spec import Spec
from gamekeeper.statistics.interval import FEWEST_RUNS, FEWEST_RUNS_APART

RULE_OF_THREE: Final = 3
"""An outcome of a chance over 3 / n is seen in 95 of 100 samples of n."""
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
        spec: of the evaluation.
        episodes: that each policy played.
        stopping: how it was decided that this is enough.
        comparisons: with their claims.
        crossplay: by environment.
        failures: the episodes that an exception ended.
        unpinned: what differs from what the suite pins.
        grounds: the environments.
    """
    return [
        *(f"Not the suite as it was pinned: {text}." for text in unpinned),
        *(f"Failed: {text}." for text in failures[:MOST_FAILURES]),
        *_about(spec),
        f"All policies played episodes 0 to {episodes - 1} of seed {spec.seed}, with the same "
        "random numbers for policies that draw them.",
        *_begun(grounds),
        *_rare(spec, episodes),
        *_stopped(stopping),
        *_unclaimed(comparisons),
        *_crossed(crossplay),
    ]


def _begun(grounds: Sequence[Ground]) -> Iterator[str]:
    """Tells whether episodes of one seed began alike for all policies."""
    for ground in grounds:
        differ, several = ground.resets
        if differ:
            yield (
                f"{ground.name} began differently for different policies in {differ} of {several} "
                "episodes of the same seed: its resets don't follow their seed, so that episodes "
                "aren't paired and comparisons take more of them."
            )
        elif several:
            yield (
                f"{ground.name}: first observations were the same for all policies in each of "
                f"{several} episodes."
            )


def _rare(spec: Spec, episodes: int) -> Iterator[str]:
    """Says what so many episodes may have missed."""
    if any(not each.is_method for each in spec.policies.values()) and episodes > RULE_OF_THREE:
        yield (
            f"An outcome of 1 in {episodes // RULE_OF_THREE} episodes, or a rarer one, may not be "
            f"among {episodes}: where it costs much (a rare crash), means are off by more than "
            "their intervals tell. IQM and median don't hang on it."
        )


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
    if tested:
        yield (
            f"Claims are of the primary comparisons alone ({tested}), with p-values by Holm's "
            f"correction: the chance that any claim is false is {100 * ALPHA:g} % at most."
        )
    if secondary:
        yield (
            f"Secondary comparisons ({secondary}; roles, agents, and figures that follow from "
            "another) stand in the tables, corrected for the number of all; no claim is made of "
            "them."
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
        kinds = [cell["kind"] for cell in found["cells"]]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        roles = ", ".join(found["roles"])
        yield f"{name}: cross-play of {len(kinds)} pairings ({counts}) by {roles}."
        if found["ranking"]:
            cycle = found["ranking"]["cycle"]
            beaten = [*cycle[1:], cycle[0]]
            said = ", ".join(f"{a} beats {b}" for a, b in zip(cycle, beaten, strict=True))
            shares = ", ".join(
                f"{policy} {100 * share:.0f} %"
                for policy, share in found["ranking"]["alpha_rank"].items()
            )
            yield (
                f"{name} has no ranking: {said}. By alpha-rank, the share of time that a "
                f"population plays each where better ones take over: {shares}."
            )
