"""Result of a diagnosis, agent by agent."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Any, Self

from gamekeeper.diagnosis.arms import RaisedPolicy
from gamekeeper.diagnosis.contradictions import Contradiction
from gamekeeper.diagnosis.judgement import CAUSES, Answer
from gamekeeper.diagnosis.plain_data import PlainData
from gamekeeper.diagnosis.response_tests import ResponseTest
from gamekeeper.diagnosis.setup_differences import SetupDifference
from gamekeeper.episodes.row_tables import html_table, text_lines
from gamekeeper.statistics.paired import PairedEffect


@dataclass(frozen=True, slots=True)
class Tested(PlainData):
    """One change that was played, against the same seeds with nothing changed.

    Attributes:
        label: the failure that it stands for; None: it touches a whole policy or memory.
        intervention: what was done.
        kind: `ideal`, `swap` (another policy), `undo` (from outside) or `perturbation`.
        effect: on the `measure`, with its 95 % interval low to high.
        p: corrected for the number of changes of its kind (Holm).
        n: episodes, none of which took part in choosing.
        measure: `success`, the share of episodes that don't fail, or `return`, the team's.
        restores: of an ideal substitute: it closes the stated part of the gap.
        depends: of a perturbation: the interval excludes no effect. Dependence, not cause.
        flips_at: found on other seeds: of an ideal substitute, the worst setting of its knob that
            still restores; of a perturbation, the least strength that makes most sound episodes
            fail.
    """

    label: str | None
    intervention: str
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

    @classmethod
    def of(
        cls, effect: PairedEffect, label: str | None, intervention: str, kind: str, **more: Any
    ) -> Self:
        """An effect that was measured."""
        at = (effect.value, effect.low, effect.high)
        p, n = more.pop("p", effect.p), more.pop("n", effect.n)
        return cls(label, intervention, kind, *at, p, n, **more)

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        found = PlainData.to_json(self).items()
        return {name: x for name, x in found if x is not None or name == "label"}


@dataclass(frozen=True, slots=True)
class AgentDiagnosis(PlainData):
    """Answer for one agent, a role or the team.

    Attributes:
        answer: `isolated`, `joint` or `ambiguous` where a cause is named, `environment` or
            `protocol` where it is no agent's own; else `healthy`, `not_failing` beyond chance,
            `elsewhere` (another agent's), `unexplained`, `not_tried`.
        labels: the causes it names; none where no more than a whole policy or memory was shown.
        why: in a sentence.
        scope: whose condition was judged: the agent's own, its role's or the team's.
        tested: every change that concerns it.
        not_tested: labels that no change was played for, and why.
        success: share of successes on fresh seeds with its interval: (share, low, high).
        substitutes: the least ideal substitutes that restore.
        component: the place of the fault, as far as it was shown; None where no cause is named.
        beside: whole policies in this agent's place that restore too, and show less.
    """

    answer: Answer
    labels: tuple[str, ...]
    why: str
    scope: str
    tested: tuple[Tested, ...] = ()
    not_tested: tuple[tuple[str, str], ...] = ()
    success: tuple[float, float, float] = (0.0, 0.0, 1.0)
    substitutes: tuple[str, ...] = ()
    component: str | None = None
    beside: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return PlainData.to_json(self) | {
            "success": dict(zip(("share", "low", "high"), self.success, strict=True)),
            "not_tested": [{"label": label, "why": why} for label, why in self.not_tested],
        }


@dataclass(frozen=True, slots=True)
class Counterfactual(PlainData):
    """First divergence of a recorded episode from its counterfactual.

    Attributes:
        episode: its number in the run.
        intervention: what was at its ideal in the counterfactual.
        turn, agent, field: the first difference; None where there is none.
        failed: whether the episode failed as it was, played again.
        restored: whether its counterfactual didn't (closed loop: all policies choose).
        restored_open: the same in an open loop: only those whom the ideal substitute concerns
            choose, the others do what they had done.
        did, instead: where the first difference is an action: it, and that of the counterfactual.
        often: the action that the agent did more often than in the counterfactual, with its two
            shares; None where no share differs much, or there are few actions.
    """

    episode: int
    intervention: str
    turn: int | None
    agent: str | None
    field: str | None
    failed: bool
    restored: bool
    restored_open: bool
    did: str | None = None
    instead: str | None = None
    often: list[Any] | None = None


@dataclass(frozen=True, slots=True)
class RunDifferences(PlainData):
    """Differences between a run that fails and one that worked, and the least that explain it.

    Attributes:
        good: the run that worked.
        listed: every difference; versions can't be swapped, and name a command that tries them.
        least: the least sets that explain the gap, by names of their differences; of several each
            explains it by itself. None: none was found.
        why: in a sentence.
        measure: `success`, or `return` where no condition says when an episode failed.
        means: of the bad and of the good set-up on paired fresh seeds.
        gap: good minus bad: (value, low, high), with a 95 % interval.
        alone: by name, the part of the gap that a difference closes alone, on a few other seeds.
        tested: the sets that were confirmed.
        tried: number of sets that were played; p-values are corrected for it.
    """

    good: str
    listed: tuple[SetupDifference, ...]
    least: tuple[tuple[str, ...], ...]
    why: str
    measure: str
    means: tuple[float, float]
    gap: tuple[float, float, float]
    alone: Mapping[str, float] = field(default_factory=dict)
    tested: tuple[Tested, ...] = ()
    tried: int = 0

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        found = PlainData.to_json(self) | {
            "listed": [
                {**each.to_json(), "alone": self.alone.get(each.name)} for each in self.listed
            ],
            "means": dict(zip(("bad", "good"), self.means, strict=True)),
            "gap": dict(zip(("value", "low", "high"), self.gap, strict=True)),
        }
        return {name: each for name, each in found.items() if name != "alone"}


@dataclass(frozen=True, slots=True)
class Diagnosis(PlainData):
    """Diagnosis of a run: agents and causes, as far as the experiments tell.

    Attributes:
        run: the folder, or `memory`.
        fingerprint: of the run.
        contradictions: scopes for which fresh episodes contradict the recorded ones; where there
            is one, nothing is an all-clear.
        agents: an answer for each agent.
        team: the answer for the team as a whole; None where no condition is the team's.
        recorded: by scope, how many of the recorded episodes failed, and of how many.
        fresh: the same of the new episodes with nothing changed.
        counterfactuals: where failing episodes and their restored counterfactuals part.
        expected, part: the share of successes if nothing is wrong, and the part of the gap to it
            that restores.
        episodes: how many this call played, counterfactuals and recordings among them.
        reused: how many others the answer rests on, which an earlier call had played.
        seed: of the experiment.
        runs: folders with replayable counterfactuals, by arm.
        conditions: when an episode counts as failed, by scope; `agent`: for each of them.
        most_episodes: how many could be played.
        budget: env steps that could be taken; None: as many as those take.
        steps: env steps that were taken, but for counterfactuals and recordings.
        not_played: what the budget didn't reach, in words.
        policies: those that played the new episodes in place of the recorded ones, by agent or
            role; then new and recorded episodes can't contradict each other.
        responses: response tests of policies, by agent, where undos were tried.
        differences: to a run that worked, where one was given.
        raised: policies that broke new episodes off; where they broke off most, nothing else was
            looked for.
    """

    run: str
    fingerprint: str
    agents: Mapping[str, AgentDiagnosis]
    team: AgentDiagnosis | None
    recorded: Mapping[str, tuple[int, int]]
    fresh: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    counterfactuals: tuple[Counterfactual, ...] = ()
    expected: float = 0.9
    part: float = 0.7
    episodes: int = 0
    reused: int = 0
    seed: int = 0
    runs: Mapping[str, str] = field(default_factory=dict)
    contradictions: Mapping[str, Contradiction] = field(default_factory=dict)
    conditions: Mapping[str, str] = field(default_factory=dict)
    most_episodes: int = 2_000
    budget: int | None = None
    steps: int = 0
    not_played: tuple[str, ...] = ()
    policies: Mapping[str, str] = field(default_factory=dict)
    responses: Mapping[str, ResponseTest] = field(default_factory=dict)
    differences: RunDifferences | None = None
    raised: tuple[RaisedPolicy, ...] = ()

    @property
    def answers(self) -> tuple[AgentDiagnosis, ...]:
        """The answer for the team, where there is one, and for each agent."""
        return (*([self.team] if self.team else []), *self.agents.values())

    @property
    def has_cause(self) -> bool:
        """Some agent's failure has a named cause."""
        return any(each.answer in CAUSES for each in self.answers)

    @property
    def has_shown_cause(self) -> bool:
        """A cause is named by a change that restores success, beyond chance."""
        return any(
            each.answer in CAUSES and test.restores and test.intervention in each.substitutes
            for each in self.answers
            for test in each.tested
        )

    def since(self, answer: AgentDiagnosis) -> dict[str, int] | None:
        """The first episode that what an answer names restores, and the turn of its divergence."""
        for each in self.counterfactuals:
            mine = each.intervention in answer.substitutes and each.failed and each.restored
            if mine and each.turn is not None:
                return {"episode": each.episode, "turn": each.turn}
        return None

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper diagnose --json` prints."""
        return PlainData.to_json(self) | {
            "agents": {
                name: {**each.to_json(), "since": self.since(each)}
                for name, each in self.agents.items()
            },
            "recorded": _counts(self.recorded),
            "fresh": _counts(self.fresh),
        }

    def rows(self) -> list[list[str]]:
        """A heading and a row for the team and each agent, as texts."""
        names = [*(["team"] if self.team else []), *self.agents]
        rows = [["agent", "answer", "cause", "success", "why"]]
        for name, each in zip(names, self.answers, strict=True):
            cause = ", ".join(each.labels) or each.component or "-"
            rows.append([name, each.answer, cause, f"{each.success[0]:.0%}", each.why])
        return rows

    def _warnings(self) -> list[str]:
        told = [str(each) for each in self.raised]
        return told + [f"{scope}: {each}" for scope, each in self.contradictions.items()]

    def __str__(self) -> str:
        return "\n".join([*self._warnings(), *text_lines(self.rows())])

    def _repr_html_(self) -> str:
        told = "".join(f"<p><b>{escape(line)}</b></p>" for line in self._warnings())
        return f"{told}{html_table(self.rows(), caption='Diagnosis by agent')}"


def _counts(by_scope: Mapping[str, tuple[int, int]]) -> dict[str, dict[str, int]]:
    return {scope: {"failed": bad, "episodes": of} for scope, (bad, of) in by_scope.items()}
