"""Episodes that have to be played before another one, because its reset had no seed."""

from collections.abc import Collection, Mapping
from typing import Any

from gamekeeper.errors import EvidenceError
from gamekeeper.interface.openings import Opening


def chain_of(header: Mapping[str, Any], known: Collection[int]) -> range:
    """Numbers of the episodes that one runs on from, itself not among them; mostly none.

    Args:
        known: numbers of the episodes that the run has.
    Raises:
        EvidenceError: it can't be played again; the sentence says why.
    """
    number, since = header["episode"], header["since"]
    if since == number or Opening.from_text(header.get("opening")).has_states:
        return range(number, number)
    if since is None or since < 0:
        raise _refused(
            f"episode {number} was reset without a seed, and none was given before", number
        )
    chain = range(min(since, number), number)
    missing = [each for each in chain if each not in known]
    if missing:
        raise _refused(
            f"episode {number} was reset without a seed and goes on from episode {since}; the run "
            f"dropped {len(missing)} of those between",
            number,
        )
    return chain


def _refused(why: str, number: int) -> EvidenceError:
    return EvidenceError(
        why,
        where=f"episode {number}",
        fix="seed each reset; gk.record(..., seed_resets=True) does so",
    )
