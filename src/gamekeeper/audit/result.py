"""What an audit came to, as frozen data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gamekeeper.core.verdict import SEVERITIES, Verdict


@dataclass(frozen=True, slots=True)
class Audit:
    """Verdicts on one environment, and the game form as it was measured.

    Attributes:
        environment: as it was named.
        api: `aec` or `parallel`.
        seconds: of wall time.
        steps: of the environment that were taken.
        seed: the verdicts are the same whenever it is.
        verdicts: one for each check, by id.
        measured: the game form as it was seen, beside what is declared.
        timings: seconds by probe, and for judging and shrinking.
    """

    environment: str
    api: str
    seconds: float
    steps: int
    seed: int
    verdicts: tuple[Verdict, ...]
    measured: Mapping[str, Any] = field(default_factory=dict)
    timings: Mapping[str, float] = field(default_factory=dict)

    @property
    def broken(self) -> tuple[Verdict, ...]:
        """The promises that were broken, the worst first."""
        bad = [each for each in self.verdicts if each.outcome == "broken"]
        return tuple(sorted(bad, key=lambda each: (SEVERITIES.index(each.severity), each.id)))

    @property
    def ok(self) -> bool:
        """No promise was broken, and every check could do its work."""
        return all(each.outcome not in ("broken", "error") for each in self.verdicts)

    def of(self, id: str) -> Verdict:  # the word that everybody uses for it
        """The verdict of one check.

        Raises:
            KeyError: it wasn't among the checks.
        """
        return next((each for each in self.verdicts if each.id == id), None) or _missing(id)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper audit --json` prints."""
        return {
            "environment": self.environment,
            "api": self.api,
            "ok": self.ok,
            "seconds": round(self.seconds, 3),
            "steps": self.steps,
            "seed": self.seed,
            "verdicts": [each.to_json() for each in self.verdicts],
            "measured": dict(self.measured),
            "timings": {name: round(value, 3) for name, value in self.timings.items()},
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Audit:
        """The audit from its document."""
        names = ("environment", "api", "seconds", "steps", "seed", "measured", "timings")
        verdicts = tuple(map(Verdict.from_json, data["verdicts"]))
        return cls(verdicts=verdicts, **{name: data[name] for name in names})

    def __str__(self) -> str:
        lines = [f"{self.environment} ({self.api}): " + ("ok" if self.ok else "broken")]
        for each in self.broken:
            lines.append(f"  {each.id} {each.severity}: {each.claim}")
            lines += [f"      {at.where}: expected {at.expected}, seen {at.seen}"
                      for at in each.findings[:1]]  # fmt: skip
        counts: dict[str, int] = {}
        for each in self.verdicts:
            counts[each.outcome] = counts.get(each.outcome, 0) + 1
        lines.append("  " + ", ".join(f"{n} {name}" for name, n in sorted(counts.items())))
        return "\n".join(lines)


def _missing(id: str) -> Verdict:  # the word that everybody uses for it
    raise KeyError(id)
