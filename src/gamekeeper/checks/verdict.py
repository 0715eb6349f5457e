"""Verdicts: the outcome of a check, with findings that name the shortest way to see them again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, TypeAlias

from gamekeeper.episodes.row_tables import html_table, html_text

Outcome: TypeAlias = Literal[
    "passed", "failed", "suspected", "not_exercised", "not_applicable", "waived", "error"
]
Severity: TypeAlias = Literal["high", "medium", "low"]

HIGH: Final = "high"
"""The game isn't the one that is described: results are wrong."""
MEDIUM: Final = "medium"
"""Some readers of the environment are misled, or crash."""
LOW: Final = "low"
"""A nuisance."""
SEVERITIES: Final = (HIGH, MEDIUM, LOW)


@dataclass(frozen=True, slots=True)
class Finding:
    """One place where a promise was broken.

    Attributes:
        where: the place, in words.
        expected: what would have been right, in words.
        actual: what was there, in words.
        fix: what the author can do about it.
        reproducer: a Python program that raises as long as the fault is there.
        lines: lines of the environment that do it, as `file:line`, where they are known.
    """

    where: str
    expected: str
    actual: str
    fix: str
    reproducer: str
    lines: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {**asdict(self), "lines": list(self.lines)}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Finding:
        """The finding from plain data."""
        return cls(**{**data, "lines": tuple(data["lines"])})

    def _repr_html_(self) -> str:
        rows = [[name, getattr(self, name)] for name in ("where", "expected", "actual", "fix")]
        rows.insert(3, ["lines", ", ".join(self.lines)])
        return html_table([["Finding", ""], *rows]) + html_text(f"Reproducer\n{self.reproducer}")


@dataclass(frozen=True, slots=True)
class Reproduced:
    """Outcome of a reproducer in fresh processes.

    Attributes:
        failed: number of processes in which it failed.
        tried: number of processes; it isn't run again once it passed.
        unchanged_passed: the same without the fault's trigger passed; None: there is no trigger.
    """

    failed: int
    tried: int
    unchanged_passed: bool | None


@dataclass(frozen=True, slots=True)
class FollowsFrom:
    """The cause of a consequence.

    Attributes:
        id: check whose failure is the cause.
        held_still: what was held still, so that the reproducer passed; empty: the reproducers of
            both end in one exception.
    """

    id: str
    held_still: str = ""


MINOR: Final = "minor: "
"""Begins the reason of what isn't promised, and is shown all the same."""
NO_CASE: Final = "no episode had what they need"
"""Begins the reason of a check that was not exercised; a colon and what it looks at may follow."""
NESTED: Final = ("findings", "reproduced", "follows_from")
SURE_OF: Final = 0.05
"""Chance of passing all cases that is left to a fault of the share that `could_miss` gives."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of one check, with its findings.

    Attributes:
        id: of the check.
        claim: the promise, in one sentence.
        outcome: `passed`, `failed`, `suspected` (a case failed, and no reproducer shows it in
            every fresh process, or a rule of the environment may explain it), `not_exercised` (no
            case to look), `not_applicable` (nothing of the kind is declared, or is there), `waived`
            (failed, with a reason in the contract), `error` (the check itself raised).
        severity: how bad it is to break the promise.
        confidence: how sure the outcome is, in (0, 1].
        cases: how often it looked.
        failed: how many of these cases failed.
        findings: the first places, the shortest ways to see them first.
        reason: why it is suspected, not exercised, not applicable, waived or an error.
        reproduced: outcome of the first reproducer in fresh processes; None: they weren't run.
        follows_from: the cause of which this is a consequence; None: it is a cause.
    """

    id: str
    claim: str
    outcome: Outcome
    severity: Severity
    confidence: float = 1.0
    cases: int = 0
    failed: int = 0
    findings: tuple[Finding, ...] = ()
    reason: str = ""
    reproduced: Reproduced | None = None
    follows_from: FollowsFrom | None = None

    def _repr_html_(self) -> str:
        rows = [[each.where, each.expected, each.actual, each.fix] for each in self.findings]
        caption = f"{self.id} {self.outcome.replace('_', ' ')}: {self.claim}"
        if not rows:
            return html_text(f"{caption}\n{self.reason}")
        return html_table([["where", "expected", "actual", "fix"], *rows], caption=caption)

    @property
    def could_miss(self) -> float | None:
        """Share of cases below which a fault may show and still pass; None of what didn't pass.

        A fault that shows in a larger share would have failed one of these cases with 95 %, if
        they were independent: the bound p of (1 - p)^n = 5 %, about 3 / n ("rule of three").

        Source: Hanley & Lippman-Hand 1983, If Nothing Goes Wrong, Is Everything All Right?
        """
        return 1 - SURE_OF ** (1 / self.cases) if self.outcome == "passed" and self.cases else None

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it stands in the audit's document."""
        return {
            **{name: getattr(self, name) for name in self.__slots__ if name not in NESTED},
            "could_miss": self.could_miss,
            "reproduced": None if self.reproduced is None else asdict(self.reproduced),
            "follows_from": None if self.follows_from is None else asdict(self.follows_from),
            "findings": [finding.to_json() for finding in self.findings],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Verdict:
        """The verdict from plain data."""
        reproduced, cause = data["reproduced"], data["follows_from"]
        nested = {
            "findings": tuple(map(Finding.from_json, data["findings"])),
            "reproduced": None if reproduced is None else Reproduced(**reproduced),
            "follows_from": None if cause is None else FollowsFrom(**cause),
        }
        own = {name: data[name] for name in cls.__slots__ if name not in NESTED}
        return cls(**{**own, **nested})
