"""Result of an attribution, agent by agent: frozen data, with its JSON document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from gamekeeper.diagnosis.attribution.agent_measures import Harm, Laziness, Measured, Own, Penalty
from gamekeeper.diagnosis.attribution.message_influence import Talk
from gamekeeper.episodes.row_tables import html_table, text_lines


@dataclass(frozen=True, slots=True)
class AgentPart:
    """One agent's part in what its team came to.

    Attributes:
        own: what it was paid itself in the recorded run, its share, its idle part.
        difference: what the team loses where the baseline plays for it and the others react; None
            where nobody can choose anew, or where it joins late.
        turn_all: what the team loses where it does nothing all along and the others do what they
            did.
        turn_one: the same of one of its actions, on average.
        shapley: its Shapley value.
        laziness: whether it is lazy.
        harm: whether the team has more without it.
    """

    own: Own
    difference: Measured | None
    turn_all: Measured | None
    turn_one: Measured | None
    shapley: Measured | None
    laziness: Laziness
    harm: Harm

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            **self.own.to_json(),
            "difference": _json(self.difference),
            "turn": {"all": _json(self.turn_all), "one": _json(self.turn_one)},
            "shapley": _json(self.shapley),
            "lazy": self.laziness.is_lazy,
            "lazy_why": self.laziness.why,
            "fair_share": self.laziness.fair,
            "harmful": self.harm.is_harmful,
            "harmful_why": self.harm.why,
        }


@dataclass(frozen=True, slots=True)
class Attribution:
    """Attribution of a run's returns, influence and penalties to its agents.

    Attributes:
        run: the folder, or None.
        episodes: recorded ones that were looked into.
        fresh: fresh ones that were played.
        reused: of all those, how many an earlier call had played.
        steps: env steps that these took.
        budget: those that could be taken; None: as many as the episodes take.
        recorded: all of the run, of which the agents' own figures are.
        replayed: recorded and fresh ones that were looked into.
        loop: `closed`: policies react. `open`: only recorded actions could be played.
        policies: named in place of the recorded ones, by agent, role or `*`.
        baseline: what was asked to take agents' places; what did is named with each figure.
        method: of the Shapley values: `exact` or `sampled`.
        everyone: mean team return where all play their policies; None where none can.
        nobody: the same where all play the baseline.
        agents: by name.
        influence: rows of from, to, on, lag, p, low, high, n.
        messages: signalling, coordination, listening.
        penalties: who paid under terms that their earner should pay.
        not_tested: what wasn't looked at, and why.
        rivals: what shows that agents compete; then there is no figure of a team. None: nothing.
    """

    run: str | None
    episodes: int
    fresh: int
    reused: int
    steps: int
    budget: int | None
    recorded: int
    replayed: int
    loop: Literal["closed", "open"]
    policies: Mapping[str, str]
    baseline: str
    method: Literal["exact", "sampled"] | None
    everyone: float | None
    nobody: float | None
    agents: Mapping[str, AgentPart]
    influence: tuple[Mapping[str, Any], ...]
    messages: tuple[Talk, ...]
    penalties: tuple[Penalty, ...]
    not_tested: tuple[Mapping[str, str], ...]
    rivals: str | None = None

    @property
    def lazy(self) -> tuple[str, ...]:
        """The lazy agents."""
        return tuple(a for a, part in self.agents.items() if part.laziness.is_lazy)

    @property
    def harmful(self) -> tuple[str, ...]:
        """The agents without which the team has more."""
        return tuple(a for a, part in self.agents.items() if part.harm.is_harmful)

    @property
    def wrong_penalties(self) -> tuple[Penalty, ...]:
        """The penalties of which some were another's doing."""
        return tuple(each for each in self.penalties if each.is_wrong)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper attribute --json` prints."""
        counts = ("episodes", "fresh", "reused", "steps", "budget", "recorded", "replayed")
        return {
            **{
                name: getattr(self, name) for name in ("run", *counts, "loop", "baseline", "rivals")
            },
            "policies": dict(self.policies),
            "team": {"all": self.everyone, "none": self.nobody, "shapley": self.method},
            "agents": {name: part.to_json() for name, part in self.agents.items()},
            "influence": [dict(row) for row in self.influence],
            "messages": [each.to_json() for each in self.messages],
            "penalties": [each.to_json() for each in self.penalties],
            "not_tested": [dict(each) for each in self.not_tested],
        }

    def rows(self) -> list[list[str]]:
        """A heading and a row for each agent, as texts."""
        head = ["agent", "return", "share", "idle", "difference", "Shapley", "verdict"]
        return [head, *(_row(name, part) for name, part in self.agents.items())]

    def __str__(self) -> str:
        lines = text_lines(self.rows())
        for each in self.wrong_penalties:
            lines.append(f"{each.agent} pays {each.term} for what {', '.join(each.by)} did")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html_table(self.rows(), caption="Attribution of the run's returns")


def _row(name: str, part: AgentPart) -> list[str]:
    own, lazy = part.own, part.laziness.is_lazy
    verdict = "-" if lazy is None else "lazy" if lazy else "not lazy"
    return [
        name,
        f"{own.value:.3f}",
        "-" if own.share is None else f"{own.share:.0%}",
        "-" if own.idle is None else f"{own.idle:.0%}",
        _shown(part.difference),
        _shown(part.shapley),
        "harmful" if part.harm.is_harmful else verdict,
    ]


def _shown(part: Measured | None) -> str:
    if part is None:
        return "-"
    if part.low is None or part.high is None:
        return f"{part.value:.3f} (n = {part.n})"
    return f"{part.value:.3f} ({part.low:.3f} to {part.high:.3f})"


def _json(part: Measured | None) -> dict[str, Any] | None:
    return None if part is None else asdict(part)
