"""What may be said of an evaluation, in words: never more than it was made for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.evaluation.refusals import FEWEST_RUNS
from gamekeeper.evaluate.spec import Spec

MOST_CLAIMS: Final = 24
"""Comparisons that are told in words; teams and rivals always are."""


def claims_of(
    spec: Spec,
    *,
    episodes: int,
    stopping: Mapping[str, Any] | None,
    comparisons: Sequence[Mapping[str, Any]],
    crossplay: Mapping[str, Mapping[str, Any]],
    errors: Sequence[str],
    unpinned: Sequence[str],
) -> list[str]:
    """Sentences in the order of their weight.

    Args:
        spec: of the evaluation.
        episodes: that each line-up played.
        stopping: how it was decided that this is enough.
        comparisons: with their claims.
        crossplay: by environment.
        errors: what exceptions broke episodes off with.
        unpinned: what differs from what the suite pins.
    """
    return [
        *(f"Not the suite as it was pinned: {text}." for text in unpinned),
        *(f"Episodes broke off: {text.splitlines()[0][:200]}." for text in errors[:5]),
        *_about(spec),
        f"Every line-up played episodes 0 to {episodes - 1} of seed {spec.seed}: the same resets, "
        f"and the same random streams for its policies.",
        *_stopped(stopping),
        *_compared(comparisons),
        *_crossed(crossplay),
    ]


def _about(spec: Spec) -> Iterator[str]:
    """Of what the claims are."""
    single = [name for name, each in spec.policies.items() if not each.is_method]
    if single:
        are = "is one checkpoint" if len(single) == 1 else "are one checkpoint each"
        which = "it" if len(single) == 1 else "them"
        yield (
            f"{', '.join(single)} {are}: what is said is about {which}, "
            "not about a method or how it was trained; the unit is the episode."
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


def _compared(comparisons: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """What was found between policies: of teams and rivals first, of roles as far as they go."""
    told = [row for row in comparisons if (row["difference"] or {}).get("low") is not None]
    wide = [row for row in told if row["scope"] in ("team", "seats")]
    rest = [row for row in told if row not in wide]
    shown = [*wide, *rest[: max(MOST_CLAIMS - len(wide), 0)]]
    yield from (f"{row['claim']}." for row in shown)
    if len(shown) < len(told):
        yield f"{len(told) - len(shown)} more comparisons of roles and agents stand in the tables."
    if len(told) < len(comparisons):
        yield (
            f"{len(comparisons) - len(told)} comparisons have no interval: nothing is claimed of "
            "them."
        )


def _stopped(stopping: Mapping[str, Any] | None) -> Iterator[str]:
    if stopping is None:
        return
    asked = f"{stopping['metric']} of {stopping['who']} known to {stopping['width']:g}"
    end = "reached" if stopping["reached"] else f"not reached by episode {stopping['most']}"
    yield (
        f"Playing went on until {asked} for every checkpoint: {end} after {stopping['episodes']} "
        f"episodes, looked at {stopping['rounds']} times. Its intervals allow for looking until "
        "they are narrow; those of other figures don't."
    )


def _crossed(crossplay: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, found in crossplay.items():
        kinds = [cell["kind"] for cell in found["cells"]]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        roles = ", ".join(found["roles"])
        yield f"{name}: cross-play of {len(kinds)} line-ups ({counts}) by {roles}."
    if any(found["best_response"] for found in crossplay.values()):
        yield (
            "Best responses were chosen on the same episodes that they are shown by, so their "
            "leads are overstated."
        )
