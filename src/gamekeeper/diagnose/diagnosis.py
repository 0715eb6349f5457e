"""What a diagnosis says, agent by agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Any

from gamekeeper.diagnose.judge import Answer


@dataclass(frozen=True, slots=True)
class Tested:
    """One change that was played, against the same seeds with nothing changed.

    Attributes:
        label: the failure that it stands for.
        change: what was done.
        kind: `remedy` or `stressor`.
        effect: on the `measure`, with its 95 % interval low to high.
        p: corrected for the number of changes of its kind (Holm).
        n: episodes, none of which took part in choosing.
        measure: `success`, the share of episodes that don't fail, or `return`, the team's.
        restores: of a remedy: it closes the stated part of the gap.
        depends: of a stressor: the interval excludes no effect. Dependence, not cause.
        flips_at: found on other seeds: of a remedy, the worst setting of its knob that still
            restores; of a stressor, the least strength that makes most sound episodes fail.
    """

    label: str
    change: str
    kind: str
    effect: float
    low: float
    high: float
    p: float
    n: int
    measure: str = "success"
    restores: bool | None = None
    depends: bool | None = None
    flips_at: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        found = {name: getattr(self, name) for name in self.__slots__}
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True, slots=True)
class AgentDiagnosis:
    """What is answered for one agent, a role or the team.

    Attributes:
        answer: `isolated`, `joint`, `compatible` or `untested`.
        labels: the causes it names.
        why: in a sentence.
        scope: whose condition was judged: the agent's own, its role's or the team's.
        tested: every change that concerns it.
        not_tested: labels that no change was played for, and why.
        success: share of successes on fresh seeds with its interval: (share, low, high).
        remedies: the least remedies that restore.
    """

    answer: Answer
    labels: tuple[str, ...]
    why: str
    scope: str
    tested: tuple[Tested, ...] = ()
    not_tested: tuple[tuple[str, str], ...] = ()
    success: tuple[float, float, float] = (0.0, 0.0, 1.0)
    remedies: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        share, low, high = self.success
        return {
            "answer": self.answer,
            "labels": list(self.labels),
            "why": self.why,
            "scope": self.scope,
            "success": {"share": share, "low": low, "high": high},
            "remedies": list(self.remedies),
            "tested": [each.to_json() for each in self.tested],
            "not_tested": [{"label": label, "why": why} for label, why in self.not_tested],
        }


@dataclass(frozen=True, slots=True)
class Parting:
    """Where a recorded episode and its twin under a remedy part.

    Attributes:
        episode: its number in the run.
        remedy: what was at its ideal in the twin.
        turn, agent, field: the first difference; None where there is none.
        failed: whether the episode failed as it was, played again.
        restored: whether its twin didn't (closed loop: all policies choose).
        restored_open: the same in an open loop: only those whom the remedy concerns choose, the
            others do what they had done.
    """

    episode: int
    remedy: str
    turn: int | None
    agent: str | None
    field: str | None
    failed: bool
    restored: bool
    restored_open: bool

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Which agent, which cause, as far as the experiment tells.

    Attributes:
        run: the folder, or `memory`.
        fingerprint: of the run.
        agents: an answer for each agent.
        team: the answer for the team as a whole; None where no condition is the team's.
        recorded: by scope, how many of the recorded episodes failed, and of how many.
        partings: where failing episodes and their restored twins part.
        level, part: the declared share of successes, and what part of the gap restores.
        episodes: how many were played.
        seed: of the experiment.
        bundles: folders with replayable twins, by arm.
    """

    run: str
    fingerprint: str
    agents: Mapping[str, AgentDiagnosis]
    team: AgentDiagnosis | None
    recorded: Mapping[str, tuple[int, int]]
    partings: tuple[Parting, ...] = ()
    level: float = 0.9
    part: float = 0.7
    episodes: int = 0
    seed: int = 0
    bundles: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_cause(self) -> bool:
        """Some agent's failure has a named cause."""
        everybody = [*self.agents.values(), *([self.team] if self.team else [])]
        return any(each.labels for each in everybody)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper diagnose --json` prints."""
        return {
            "run": self.run,
            "fingerprint": self.fingerprint,
            "agents": {name: each.to_json() for name, each in self.agents.items()},
            "team": None if self.team is None else self.team.to_json(),
            "recorded": {
                scope: {"failed": failed, "episodes": of}
                for scope, (failed, of) in self.recorded.items()
            },
            "partings": [each.to_json() for each in self.partings],
            "level": self.level,
            "part": self.part,
            "episodes": self.episodes,
            "seed": self.seed,
            "bundles": dict(self.bundles),
        }

    def rows(self) -> list[list[str]]:
        """A heading and a row for the team and each agent, as texts."""
        everybody = [("team", self.team)] if self.team else []
        everybody += list(self.agents.items())
        return [
            ["agent", "answer", "cause", "success", "why"],
            *(
                [
                    name,
                    each.answer,
                    ", ".join(each.labels) or "-",
                    f"{each.success[0]:.0%}",
                    each.why,
                ]
                for name, each in everybody
                if each is not None
            ),
        ]

    def __str__(self) -> str:
        rows = self.rows()
        widths = [max(len(row[place]) for row in rows) for place in range(4)]
        return "\n".join(
            "  ".join(
                [*(text.ljust(width) for text, width in zip(row, widths, strict=False)), row[4]]
            )
            for row in rows
        )

    def _repr_html_(self) -> str:
        head, *rows = self.rows()
        heading = "".join(f"<th>{escape(text)}</th>" for text in head)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows
        )
        return f"<table><thead><tr>{heading}</tr></thead><tbody>{body}</tbody></table>"
