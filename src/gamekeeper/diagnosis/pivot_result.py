"""Result of looking for pivots: the turns from which the success of failed episodes was lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Self, TypeAlias

from gamekeeper.episodes.row_tables import html_table, text_lines

Question: TypeAlias = Literal["falls", "last action"]
QUESTIONS: Final[Mapping[Question, str]] = {
    "falls": "where does the share of continuations that succeed fall beyond chance?",
    "last action": "all continuations that were tried fail: at which turn does another action of "
    "one agent succeed for the last time?",
}
Loss: TypeAlias = Literal["action", "draws", "several", "not tried"]


class ContinuationShare:
    """Share of continuations that succeed."""

    __slots__: tuple[str, ...] = ()
    successes: int
    n: int

    @property
    def share(self) -> float:
        """The share."""
        return self.successes / self.n if self.n else 0.0

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: getattr(self, name) for name in self.__slots__} | {"share": self.share}


@dataclass(frozen=True, slots=True)
class CurvePoint(ContinuationShare):
    """Share of continuations from a turn that succeed.

    Attributes:
        turn: env steps that were as recorded.
        successes, n: continuations.
        low, high: its interval, corrected for the number of turns; equal where it is known.
    """

    turn: int
    successes: int
    n: int
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class AlternativeAction(ContinuationShare):
    """An action in place of a recorded one, that of the other agents held.

    Attributes:
        agent: that took it.
        action: as text; None: whatever its policy chose on fresh draws.
        source: `policy`, `legal`, `sample` or `reference`.
        successes, n: continuations.
        p: of its success being that of the recorded actions, corrected for the number of agents;
            None: it was played too few times to say.
        keeps: it would have kept the success.
    """

    agent: str
    action: str | None
    source: str
    successes: int
    n: int
    p: float | None = None
    keeps: bool = False


@dataclass(frozen=True, slots=True)
class Pivot:
    """A turn at which success was lost.

    Attributes:
        turn: the one whose actions lost it.
        before, after: shares of success before it and after it, on continuations of their own.
        p: of no fall, corrected for the number of turns that were looked at like this.
        loss: `action`: another action of one agent keeps it. `draws`: most of the fall comes
            back if the recorded actions meet fresh draws. `several`: no action that was tried of
            one agent alone keeps it. `not tried`: the budget was spent.
        agents: those whose action would have kept it, the one first whose own policy, choosing
            again, keeps it most often.
        tried: actions in place of recorded ones.
    """

    turn: int
    before: CurvePoint
    after: CurvePoint
    p: float
    loss: Loss = "not tried"
    agents: tuple[str, ...] = ()
    tried: tuple[AlternativeAction, ...] = ()

    @property
    def fall(self) -> float:
        """Loss of success."""
        return self.before.share - self.after.share

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: getattr(self, name) for name in self.__slots__} | {
            "fall": self.fall,
            "before": self.before.to_json(),
            "after": self.after.to_json(),
            "agents": list(self.agents),
            "tried": [each.to_json() for each in self.tried],
        }


@dataclass(frozen=True, slots=True)
class EpisodePivots:
    """Pivots of one failed episode.

    Attributes:
        episode: its number.
        scope: whose condition it failed by: the team's, a role's or an agent's.
        turns: its env steps.
        question: that was answered; a key of `QUESTIONS`.
        curve: by turn; empty where nothing draws anything.
        pivots: the largest fall first.
        steps: env steps that were taken for it.
        by_copies: continuations went on from copies of the environment, else from replays.
        not_tried: what the budget didn't reach, in words.
    """

    episode: int
    scope: str
    turns: int
    question: Question
    curve: tuple[CurvePoint, ...] = ()
    pivots: tuple[Pivot, ...] = ()
    steps: int = 0
    by_copies: bool = False
    not_tried: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {name: getattr(self, name) for name in self.__slots__} | {
            "curve": [each.to_json() for each in self.curve],
            "pivots": [each.to_json() for each in self.pivots],
            "not_tried": list(self.not_tried),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """The same again."""
        pivots = tuple(
            Pivot(
                turn=each["turn"],
                before=_point(each["before"]),
                after=_point(each["after"]),
                p=each["p"],
                loss=each["loss"],
                agents=tuple(each["agents"]),
                tried=tuple(
                    AlternativeAction(**_own(AlternativeAction, one)) for one in each["tried"]
                ),
            )
            for each in data["pivots"]
        )
        plain = _own(cls, data) | {"curve": tuple(map(_point, data["curve"])), "pivots": pivots}
        return cls(**plain | {"not_tried": tuple(data["not_tried"])})


@dataclass(frozen=True, slots=True)
class Pivots:
    """Pivots of a run's failed episodes.

    Attributes:
        run: the folder, or `memory`.
        fingerprint: of the run.
        episodes: an answer for each failed episode that was looked at.
        failed: failed episodes of the run, and all of them.
        conditions: when an episode counts as failed, by scope.
        budget: env steps that could be taken.
        seed: of the continuations.
        policies: those that played on in place of the recorded ones, by agent or role.
    """

    run: str
    fingerprint: str
    episodes: tuple[EpisodePivots, ...]
    failed: tuple[int, int]
    conditions: Mapping[str, str] = field(default_factory=dict)
    budget: int = 0
    seed: int = 0
    policies: Mapping[str, str] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The document that `gamekeeper pivots --json` prints."""
        return {
            "run": self.run,
            "fingerprint": self.fingerprint,
            "failed": {"failed": self.failed[0], "episodes": self.failed[1]},
            "conditions": dict(self.conditions),
            "budget": self.budget,
            "steps": sum(each.steps for each in self.episodes),
            "seed": self.seed,
            "policies": dict(self.policies),
            "episodes": [each.to_json() for each in self.episodes],
        }

    def rows(self) -> list[list[str]]:
        """A heading and a row for each pivot, as texts."""
        head = ["episode", "turn", "success before", "after", "agents", "loss"]
        return [
            head,
            *(
                [
                    str(each.episode),
                    str(pivot.turn),
                    f"{pivot.before.share:.0%}",
                    f"{pivot.after.share:.0%}",
                    ", ".join(pivot.agents) or "-",
                    pivot.loss,
                ]
                for each in self.episodes
                for pivot in each.pivots
            ),
        ]

    def __str__(self) -> str:
        return "\n".join(text_lines(self.rows()))

    def _repr_html_(self) -> str:
        return html_table(self.rows(), caption=f"Pivots of {self.run}")


def _point(data: Mapping[str, Any]) -> CurvePoint:
    return CurvePoint(**_own(CurvePoint, data))


def _own(kind: type[Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a class in plain data that holds more."""
    return {name: data[name] for name in kind.__slots__}
