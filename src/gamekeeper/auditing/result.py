"""Result of an audit, as frozen data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Any

from gamekeeper.checks.verdict import SEVERITIES, Finding, Verdict
from gamekeeper.episodes.agent_spec import AgentSpec


@dataclass(frozen=True, slots=True)
class AuditResult:
    """Verdicts on one environment, and the structure as it was measured.

    Attributes:
        environment: as it was named.
        api: `aec` or `parallel`.
        seconds: of wall time.
        steps: of the environment that were taken.
        seed: the verdicts are the same whenever it is.
        verdicts: one for each check, by id.
        measured: the structure as it was seen, beside what is declared.
        timings: seconds by probe, and for judging and shrinking.
        agents: the roster, each with `observation_space` and `action_space` in words.
        declared: the contract as plain data; None where there was none.
        source: `class`, `file` and `line` of the rules, as far as they are known.
        stopped: what ended the audit before its budget was spent; empty where nothing did.
        prints: file that holds what the environment's process printed; empty where it printed
            nothing, or ran in the caller's process.
    """

    environment: str
    api: str
    seconds: float
    steps: int
    seed: int
    verdicts: tuple[Verdict, ...]
    measured: Mapping[str, Any] = field(default_factory=dict)
    timings: Mapping[str, float] = field(default_factory=dict)
    agents: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    declared: Mapping[str, Any] | None = None
    source: Mapping[str, Any] = field(default_factory=dict)
    stopped: str = ""
    prints: str = ""

    @property
    def failed(self) -> tuple[Verdict, ...]:
        """Verdicts of the checks that failed, the worst first."""
        bad = [each for each in self.verdicts if each.outcome == "failed"]
        return tuple(sorted(bad, key=lambda each: (SEVERITIES.index(each.severity), each.id)))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Failing cases of the checks that failed, the worst check first."""
        return tuple(finding for verdict in self.failed for finding in verdict.findings)

    @property
    def ok(self) -> bool:
        """No check failed, and every check could do its work."""
        return all(each.outcome not in ("failed", "error") for each in self.verdicts)

    @property
    def counts(self) -> dict[str, int]:
        """Number of checks by outcome."""
        found: dict[str, int] = {}
        for each in self.verdicts:
            found[each.outcome] = found.get(each.outcome, 0) + 1
        return found

    def of(self, id: str) -> Verdict:  # the word that everybody uses for it
        """The verdict of one check.

        Raises:
            KeyError: it wasn't among the checks.
        """
        found = next((each for each in self.verdicts if each.id == id), None)
        if found is None:
            raise KeyError(id)
        return found

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
            "agents": {name: dict(each) for name, each in self.agents.items()},
            "declared": None if self.declared is None else dict(self.declared),
            "source": dict(self.source),
            "stopped": self.stopped,
            "prints": self.prints,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> AuditResult:
        """The audit from its document."""
        verdicts = tuple(map(Verdict.from_json, data["verdicts"]))
        rest = {name: data[name] for name in cls.__slots__ if name != "verdicts"}
        return cls(verdicts=verdicts, **rest)

    def __str__(self) -> str:
        lines = [f"{self.environment} ({self.api}): " + ("ok" if self.ok else "failed")]
        for each in self.failed:
            lines.append(f"  {each.id} {each.severity}: {each.claim}")
            lines += [
                f"      {at.where}: expected {at.expected}, actual {at.actual}"
                for at in each.findings[:1]
            ]
        counts = self.counts
        told = (f"{n} {name.replace('_', ' ')}" for name, n in sorted(counts.items()))
        lines.append("  " + ", ".join(told))
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """For notebooks: the same, the broken promises as a table."""
        title, *_, counted = str(self).splitlines()
        rows = [(each.id, each.severity, each.claim, *_first(each)) for each in self.failed]
        head = ("check", "severity", "promise", "where", "expected", "actual")
        lines = [_row(head, "th"), *(_row(row, "td") for row in rows)] if rows else []
        table = f"<table>{''.join(lines)}</table>" if lines else ""
        return f"<b>{escape(title)}</b>{table}<p>{escape(counted.strip())}</p>"


def _first(verdict: Verdict) -> tuple[str, str, str]:
    """Place of the first failure, with its expected and its actual value."""
    if not verdict.findings:
        return "", "", ""
    finding = verdict.findings[0]
    return finding.where, finding.expected, finding.actual


def _row(cells: tuple[str, ...], tag: str) -> str:
    inner = "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells)
    return f"<tr>{inner}</tr>"


def spaces_text(spec: AgentSpec) -> dict[str, str]:
    """The spaces in words; what the environment didn't tell before the first reset is empty."""
    spaces = {"observation_space": spec.observation_space, "action_space": spec.action_space}
    return {name: "" if space is None else str(space) for name, space in spaces.items()}
