"""Two recorded runs side by side."""

from __future__ import annotations

from os import PathLike
from typing import Final

from gamekeeper.core.divergence import Divergence
from gamekeeper.core.evidence import IDENTITY, Evidence
from gamekeeper.core.side_by_side import compare_strips
from gamekeeper.record.bundle import load

PRINTS: Final = ("fingerprint", "info_fingerprint")


def diff(
    a: str | PathLike[str] | Evidence,
    b: str | PathLike[str] | Evidence,
    *,
    tolerance: float | None = None,
) -> Divergence | None:
    """The first place where two runs differ, or None if they are the same.

    Episodes are compared in their order: first what their resets were told, then turn by turn.
    What is the same but for volatile infos is the same.

    Args:
        tolerance: numbers that differ by no more, absolutely or relative to the larger one, count
            as equal.
    Raises:
        BundleError: one of them is no bundle, or damaged.
    """
    left, right = (each if isinstance(each, Evidence) else load(each) for each in (a, b))
    if all(_named(left, name) == _named(right, name) is not None for name in PRINTS):
        return None
    volatile = left.contract.volatile_infos() | right.contract.volatile_infos()
    one, two = (
        {header["episode"]: header for header in side.episodes.to_pylist()}
        for side in (left, right)
    )
    for episode in sorted(one.keys() | two.keys()):
        if episode not in one or episode not in two:
            values = ["present" if episode in side else None for side in (one, two)]
            return Divergence(episode, None, None, "episode", *values)
        for field in ("seed", "options"):
            values = [side[episode][field] for side in (one, two)]
            if values[0] != values[1]:
                return Divergence(episode, None, None, field, *values)
        found = compare_strips(
            left.strip(one[episode]), right.strip(two[episode]),
            known=left.extent(one[episode]), tolerance=tolerance, volatile=volatile,
        )  # fmt: skip
        if found.divergence is not None:
            return found.divergence
    return _header_difference(left, right)


def _named(evidence: Evidence, name: str) -> str | None:
    """A fingerprint that the evidence names, None where it has none yet."""
    return evidence.manifest.get(name) or None


def _header_difference(left: Evidence, right: Evidence) -> Divergence | None:
    """What of the run as a whole differs: environment, arguments, spaces."""
    for field in IDENTITY:
        values = [side.manifest["environment"].get(field) for side in (left, right)]
        if values[0] != values[1]:
            return Divergence(0, None, None, f"environment.{field}", *values)
    values = [side.manifest["spaces"] for side in (left, right)]
    for agent in dict.fromkeys([*values[0], *values[1]]):
        pair = [value.get(agent) for value in values]
        if pair[0] != pair[1]:
            return Divergence(0, None, agent, "spaces", *pair)
    return None
