"""Result of looking for pivots: the turns from which the success of failed episodes was lost."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Self, TypeAlias

from gamekeeper.diagnosis.plain_data import PlainData, frozen
from gamekeeper.episodes.row_tables import html_table, html_text, text_lines

Question: TypeAlias = Literal["falls", "last action"]
"""`falls`: where the share of continuations that succeed falls beyond chance; `last action`: where
another action of one agent succeeds for the last time, as all continuations that were tried fail.
"""
Loss: TypeAlias = Literal["action", "draws", "several", "not tried"]


class ContinuationShare(PlainData):
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
        return PlainData.to_json(self) | {"share": self.share}


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
class Pivot(PlainData):
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
        return PlainData.to_json(self) | {"fall": self.fall}


@dataclass(frozen=True, slots=True)
class EpisodePivots(PlainData):
    """Pivots of one failed episode.

    Attributes:
        episode: its number.
        scope: whose condition it failed by: the team's, a role's or an agent's.
        turns: its env steps.
        question: that was answered; see `Question`.
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

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """The same again."""
        curve = tuple(_own(CurvePoint, each) for each in data["curve"])
        pivots = tuple(
            _own(
                Pivot,
                each
                | {name: _own(CurvePoint, each[name]) for name in ("before", "after")}
                | {"tried": tuple(_own(AlternativeAction, one) for one in each["tried"])},
            )
            for each in data["pivots"]
        )
        found: Self = _own(cls, {**data, "curve": curve, "pivots": pivots})
        return found


@dataclass(frozen=True, slots=True)
class Pivots(PlainData):
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
        return PlainData.to_json(self) | {
            "failed": dict(zip(("failed", "episodes"), self.failed, strict=True)),
            "steps": sum(each.steps for each in self.episodes),
        }

    def rows(self) -> list[list[str]]:
        """A heading and a row for each pivot, as texts."""
        rows = [["episode", "turn", "success before", "after", "agents", "loss"]]
        for each in self.episodes:
            for one in each.pivots:
                shares = [f"{point.share:.0%}" for point in (one.before, one.after)]
                agents = ", ".join(one.agents) or "-"
                rows.append([str(each.episode), str(one.turn), *shares, agents, one.loss])
        return rows

    def __str__(self) -> str:
        return "\n".join(text_lines(rows)) if len(rows := self.rows()) > 1 else self._none_text()

    def _repr_html_(self) -> str:
        if len(rows := self.rows()) == 1:
            return html_text(self._none_text())
        return html_table(rows, caption=f"Pivots of {self.run}")

    def _none_text(self) -> str:
        failed, episodes = self.failed
        return f"No pivot in {self.run}: {failed} of {episodes} episodes failed"


def _own(kind: type[Any], data: Mapping[str, Any]) -> Any:
    """Frozen data from plain data, which may hold more."""
    return kind(**{name: frozen(data[name]) for name in kind.__slots__})
