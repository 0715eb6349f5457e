"""Rule by which a flight recorder retains episodes: `last 1000`, `failed`, `64 MB`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Protocol

from gamekeeper.errors import EvidenceError

BYTES: Final = 256 << 20
"""Size of a run's folder that isn't exceeded, where the rule names none."""
LEAST_BYTES: Final = 8 * 10**6
SHARE: Final = 1 / 4
"""Part of that size which retained episodes take: a second copy of them is written meanwhile."""
UNITS: Final = {"kB": 10**3, "MB": 10**6, "GB": 10**9}
_PART: Final = re.compile(r"failed|last (\d{1,9})|(\d{1,6}(?:\.\d{1,3})?) ?(kB|MB|GB)")


class Ranked(Protocol):
    """Episode that is over, as far as a rule looks at it."""

    @property
    def number(self) -> int:
        """Number in the training."""

    @property
    def size_bytes(self) -> float:
        """Bytes that it takes."""

    @property
    def is_failed(self) -> bool:
        """True if it failed."""


@dataclass(frozen=True, slots=True)
class KeepRule:
    """Rule of retention.

    Attributes:
        text: the rule as it was given.
        last: newest episodes that are retained; None: as many as fit.
        has_failed: it names failed episodes, so that something has to say when one failed.
        most_bytes: size of the run's folder.
    """

    text: str
    last: int | None
    has_failed: bool
    most_bytes: int

    def retained(self, ended: Iterable[Ranked], marked: Iterable[int]) -> set[int]:
        """Numbers of the episodes that stay.

        First the marked ones (longest, best, worst), whatever their size; then failed ones, newest
        first, then the newest, as long as there is room.

        Args:
            ended: episodes that are over, in the order of their ends.
            marked: numbers of the marked ones among them.
        """
        newest = [*ended][::-1]
        marks, found = set(marked), set[int]()
        room = SHARE * self.most_bytes
        ranks = (
            [each for each in newest if each.number in marks],
            [each for each in newest if each.is_failed],
            newest if self.last is None else newest[: self.last],
        )
        for rank in ranks:
            for each in rank:
                if each.number in found:
                    continue
                if each.size_bytes > room and each.number not in marks:
                    break  # an older one isn't retained in the place of a newer one
                room -= each.size_bytes
                found.add(each.number)
        return found


def keep_rule(keep: Any) -> KeepRule:
    """The rule that `keep` spells: parts between commas, in any order.

    Raises:
        EvidenceError: it spells none.
    """
    parts = [part.strip() for part in keep.split(",")] if isinstance(keep, str) else []
    found = [_PART.fullmatch(part) for part in parts]
    last, most_bytes = None, BYTES
    has_failed = "failed" in parts
    kinds: list[str] = []
    for match in found:
        if match is None:
            break
        kinds.append("last" if match[1] else "bytes" if match[2] else "failed")
        if match[1]:
            last = int(match[1])
        elif match[2]:
            most_bytes = int(float(match[2]) * UNITS[match[3]])
    if not found or None in found or len(set(kinds)) < len(kinds) or most_bytes < LEAST_BYTES:
        raise EvidenceError(
            "no rule says which episodes are retained",
            where="keep",
            expected="'last N', 'failed', a size of at least 8 MB as '64 MB', or some of them "
            "between commas",
            actual=repr(keep)[:100],
            fix='write keep="failed", keep="last 1000" or keep="failed, last 100, 64 MB"',
        )
    if has_failed and last is None:
        last = 0
    return KeepRule(keep, last, has_failed, most_bytes)
