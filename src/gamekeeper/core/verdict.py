"""Verdicts: what a check came to, with findings that name the shortest way to see them again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, TypeAlias

Outcome: TypeAlias = Literal["kept", "broken", "unseen", "not_applicable", "waived", "error"]
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
        seen: what was there, in words.
        mend: what the author can do about it.
        reproduce: a Python program that raises as long as the fault is there.
    """

    where: str
    expected: str
    seen: str
    mend: str
    reproduce: str

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What one check came to.

    Attributes:
        id: of the check.
        claim: the promise, in one sentence.
        outcome: `kept`, `broken`, `unseen` (no occasion to look), `not_applicable` (nothing of the
            kind is declared, or is there), `waived` (broken, with a reason in the contract),
            `error` (the check itself failed).
        severity: how bad it is to break the promise.
        confidence: how sure the outcome is, in (0, 1].
        occasions: how often it looked.
        broken: how often the promise was broken.
        findings: the first places, the shortest ways to see them first.
        reason: why it is unseen, not applicable, waived or an error.
    """

    id: str
    claim: str
    outcome: Outcome
    severity: Severity
    confidence: float = 1.0
    occasions: int = 0
    broken: int = 0
    findings: tuple[Finding, ...] = ()
    reason: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it stands in the audit's document."""
        return {
            **{name: getattr(self, name) for name in self.__slots__ if name != "findings"},
            "findings": [finding.to_json() for finding in self.findings],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Verdict:
        """The verdict from plain data."""
        findings = tuple(Finding(**finding) for finding in data["findings"])
        return cls(**{**data, "findings": findings})
