"""Search for the turns that lost a failed episode: a coarse grid, then bisection in each fall."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.pivot_result import (
    AlternativeAction,
    CurvePoint,
    EpisodePivots,
    Loss,
    Pivot,
)
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.interface.joint_policy import JointPolicy
from gamekeeper.interface.policy import REFERENCE
from gamekeeper.rollouts.continuations import Continuations
from gamekeeper.rollouts.interventions.legal_actions import LegalActions, legal_actions_of
from gamekeeper.runs.recording import joint_policy_of
from gamekeeper.statistics.significance import fisher_exact, holm, wilson

SPANS: Final = 8
"""Spans of the coarse grid."""
FIRST: Final = 24
"""Continuations from each turn of the grid."""
MOST: Final = 100
"""Most continuations from a turn, while bisecting and, of their own, to confirm a fall."""
LEAST_FALL: Final = 0.15
"""Falls of success within a span that are looked into."""
ENOUGH: Final = 9.0
"""Continuations from a turn times the square of the fall: it stands at 3 standard errors."""
FEW: Final = 12
"""Continuations of an action, to choose the best one of each agent."""
CONFIRM: Final = 60
"""Continuations of that one, and of the recorded actions."""
PART: Final = 0.5
"""Part of the fall that an action has to win back."""
CERTAIN: Final = 3
"""Continuations from a turn of the grid that show whether draws matter, and of a last action."""
P: Final = 0.05

CURVE, BEFORE, AFTER, ACTIONS, CHECKED = range(5)
"""Purposes of continuations: each has draws of its own."""


@dataclass(slots=True)
class PivotSearch:
    """Looks for the pivots of one episode.

    Attributes:
        is_success: tells if an outcome is one.
        reference: the environment's own reference policy, if it has one.
    """

    play: Continuations
    is_success: Callable[[Outcome], bool]
    reference: JointPolicy | None
    episode: int
    scope: str
    seed: int = 0
    counts: dict[int, tuple[int, int]] = field(default_factory=dict)
    not_tried: list[str] = field(default_factory=list)

    def run(self) -> EpisodePivots:
        """The answer."""
        blank = EpisodePivots(self.episode, self.scope, self.play.turns, "falls")
        if not self.play.turns:
            return blank
        if self._is_certain():
            found = replace(
                blank, question="last action", pivots=self._last_action(), curve=self._curve()
            )
        else:
            candidates = self._candidates()
            found = replace(blank, pivots=self._confirmed(candidates), curve=self._curve())
        if self.play.is_spent and not self.not_tried:
            self._miss("more continuations")
        return replace(
            found,
            steps=self.play.steps,
            by_copies=self.play.by_copies,
            not_tried=tuple(self.not_tried),
        )

    # -- the curve

    def _grid(self) -> list[int]:
        return sorted({round(k * self.play.turns / SPANS) for k in range(SPANS + 1)})

    def _is_certain(self) -> bool:
        """Tells whether continuations from all over the episode do and end as the recording.

        Where something draws, many more of them have to fail, as far as half of the budget goes.
        """
        grid = self._grid()[:-1]
        for turn in grid:
            if not self.play.is_settled(turn, self._numbers(CHECKED, turn, range(CERTAIN))):
                return False
        for turn in grid if self.play.draws else ():
            if self.play.steps < self.play.budget / 2:
                self._ask(turn, FIRST)
        return not any(hits for hits, _ in self.counts.values())

    def _candidates(self) -> list[int]:
        """Turns at which the curve seems to fall, by bisecting the largest falls first."""
        grid = self._grid()
        for turn in grid:
            self._ask(turn, FIRST)
        spans, found = list(pairwise(grid)), []
        while spans:
            left, right = spans.pop(max(range(len(spans)), key=lambda k: self._fall(*spans[k])))
            fall = self._fall(left, right)
            if fall < LEAST_FALL:
                break
            if self.play.is_spent:
                self._miss(f"falls between turns {left} and {right}")
                continue
            wanted = int(min(max(ENOUGH / fall**2, FIRST), MOST))
            if min(self._looks(left), self._looks(right)) < wanted:
                self._ask(left, wanted)
                self._ask(right, wanted)
                spans.append((left, right))  # the fall may be gone, now that more is known
                continue
            if right == left + 1:
                found.append(left)
                continue
            middle = (left + right) // 2
            self._ask(middle, wanted)
            spans += [(left, middle), (middle, right)]
        return found

    def _ask(self, turn: int, wanted: int) -> None:
        """Plays continuations from a turn until there are so many; at the end success is lost."""
        hits, n = self.counts.get(turn, (0, 0))
        if turn == self.play.turns:
            self.counts[turn] = (0, max(wanted, n))
            return
        if n < wanted:
            more, looks = self._successes(CURVE, turn, range(n, wanted))
            self.counts[turn] = (hits + more, n + looks)

    def _share(self, turn: int) -> float:
        hits, n = self.counts.get(turn, (0, 0))
        return hits / n if n else 0.0

    def _looks(self, turn: int) -> int:
        return self.counts.get(turn, (0, 0))[1]

    def _fall(self, left: int, right: int) -> float:
        return self._share(left) - self._share(right)

    def _curve(self) -> tuple[CurvePoint, ...]:
        known = {turn: count for turn, count in sorted(self.counts.items()) if count[1]}
        return tuple(self._point(turn, *count, looks=len(known)) for turn, count in known.items())

    def _point(self, turn: int, hits: int, n: int, *, looks: int) -> CurvePoint:
        if turn == self.play.turns:  # known: the recorded end
            return CurvePoint(turn, 0, n, 0.0, 0.0)
        share = wilson(hits, n, level=1 - P / max(looks, 1))  # Bonferroni: all points at once
        return CurvePoint(turn, hits, n, share.low, share.high)

    # -- the pivots

    def _confirmed(self, candidates: list[int]) -> tuple[Pivot, ...]:
        """Candidates whose fall stands on continuations of its own, the largest first."""
        looks = 2 * len(candidates)
        rows = []
        for turn in candidates:
            before = self._successes(BEFORE, turn, range(MOST))
            after = (0, MOST)
            if turn + 1 < self.play.turns:
                after = self._successes(AFTER, turn + 1, range(MOST))
            if before[1] < MOST or after[1] < MOST:
                self._miss(f"confirming the fall at turn {turn}")
                continue
            p = fisher_exact(*before, *after) if before[0] > after[0] else 1.0
            rows.append((turn, before, after, p))
        corrected = holm([row[3] for row in rows]) if rows else ()
        pivots = [
            Pivot(
                turn,
                self._point(turn, *before, looks=looks),
                self._point(turn + 1, *after, looks=looks),
                p,
            )
            for (turn, before, after, _), p in zip(rows, corrected, strict=True)
            if p < P
        ]
        pivots.sort(key=lambda pivot: -pivot.fall)
        return tuple(map(self._with_agents, pivots))

    def _with_agents(self, pivot: Pivot) -> Pivot:
        """The pivot with the actions that would have kept the success."""
        turn = pivot.turn
        if self.play.is_spent:
            self._miss(f"other actions at turn {turn}")
            return pivot
        screened: dict[str, list[tuple[int, int, ActionOption]]] = {}
        for place, option in enumerate(self._options(turn)):
            hits, n = self._tried(turn, option, place, range(FEW))
            screened.setdefault(agent_name(option.agent), []).append((hits, n, option))
        base = self._tried(turn, None, -1, range(CONFIRM))
        tried: list[AlternativeAction] = []
        for number, rows in enumerate(screened.values()):
            best = max(rows, key=lambda row: row[0] / max(row[1], 1))
            tried += [_tried_action(o, h, n) for h, n, o in rows if o is not best[2]]
            place = 1_000 + number
            hits, n = self._tried(turn, best[2], place, range(CONFIRM))
            p = fisher_exact(hits, n, *base) if n and base[1] else 1.0
            tried.append(replace(_tried_action(best[2], hits, n), p=p))
        if self.play.is_spent:
            self._miss(f"some of the other actions at turn {turn}")
        return self._judged(pivot, tried, base)

    def _judged(self, pivot: Pivot, tried: list[AlternativeAction], base: tuple[int, int]) -> Pivot:
        """The pivot with the agents whose best action wins back enough of the fall."""
        known = [each for each in tried if each.p is not None]
        corrected = dict(zip(map(id, known), holm([e.p or 0.0 for e in known]), strict=True))
        # From `before` to `held` the recorded actions cost success, with draws made anew; from
        # `held` to `after` this turn's own draws do.
        held = base[0] / base[1] if base[1] else pivot.after.share
        wanted = held + PART * (pivot.before.share - held)
        rows = []
        for each in tried:
            p = corrected.get(id(each))
            keeps = p is not None and p < P and each.share >= wanted >= held + LEAST_FALL * PART
            rows.append(replace(each, p=p, keeps=keeps))
        rows.sort(key=lambda each: (not each.keeps, -each.share))
        again = {each.agent: each.share for each in rows if each.source == DRAWN}
        able = dict.fromkeys(each.agent for each in rows if each.keeps)
        agents = tuple(sorted(able, key=lambda agent: -again.get(agent, 0.0)))
        loss: Loss = "action" if agents else "several"
        by_draws, by_actions = held - pivot.after.share, pivot.before.share - held
        if by_draws > by_actions and base[1]:
            loss = "draws"
        elif not agents and (not known or self.play.is_spent):
            loss = "not tried"
        return replace(pivot, loss=loss, agents=agents, tried=tuple(rows))

    def _tried(
        self, turn: int, option: ActionOption | None, place: int, which: range
    ) -> tuple[int, int]:
        """Successes with an action in place of the recorded one; of None with all as recorded."""
        held = dict(self.play.base.actions[turn])
        if option is not None and option.source == DRAWN:
            del held[option.agent]
        elif option is not None:
            held[option.agent] = option.action
        return self._successes(ACTIONS, turn, which, place=place, held=held)

    # -- the last action, where every continuation fails

    def _last_action(self) -> tuple[Pivot, ...]:
        """The last turn from which another action of one agent succeeds."""
        for turn in reversed(range(self.play.turns)):
            if self.play.is_spent:
                self._miss(f"turns 0 to {turn}")
                return ()
            tried = []
            for place, option in enumerate(self._options(turn)):
                if option.source == DRAWN:
                    continue
                count = range(CERTAIN if self.play.draws else 1)
                hits, n = self._tried(turn, option, place, count)
                tried.append(replace(_tried_action(option, hits, n), keeps=hits == n > 0))
            agents = tuple(dict.fromkeys(each.agent for each in tried if each.keeps))
            if agents:
                tried.sort(key=lambda each: not each.keeps)
                before, after = (CurvePoint(t, 0, 1, 0.0, 0.0) for t in (turn, turn + 1))
                return (Pivot(turn, before, after, 0.0, "action", agents, tuple(tried)),)
        return ()

    # -- continuations

    def _options(self, turn: int) -> Iterator[ActionOption]:
        """Yields the actions in place of each recorded one of a turn."""
        base, inputs = self.play.base, self.play.inputs(turn)
        for place, (agent, action) in enumerate(base.actions[turn].items()):
            if action is None or agent not in inputs:  # an ended agent's
                continue
            yield ActionOption(agent, DRAWN)
            legal_actions = legal_actions_of(base.contract, base.env, agent)
            rng = np.random.default_rng([13, self.seed, turn, place])
            if legal_actions is not None:
                legal_actions.take(*inputs[agent])
                yield from _others(legal_actions, agent, action, rng)
            space = None if legal_actions is None else legal_actions.space
            is_short = isinstance(space, Discrete) and int(space.n) <= MOST_LEGAL
            if self.reference is not None and not is_short:
                yield ActionOption(agent, REFERENCE, self.reference.act(agent, *inputs[agent]))

    def _successes(
        self,
        purpose: int,
        turn: int,
        which: range,
        *,
        place: int = 0,
        held: Mapping[Any, Any] | None = None,
    ) -> tuple[int, int]:
        """Successes, and continuations that were played."""
        numbers = self._numbers(purpose, turn, which, place=place)
        outcomes = self.play.play(turn, numbers, held=held)
        return sum(map(self.is_success, outcomes)), len(outcomes)

    def _numbers(self, purpose: int, turn: int, which: range, *, place: int = 0) -> list[int]:
        # Words of one key are a sequence: asking for more keeps those that were played.
        key = [self.seed, self.episode, purpose, turn, place + 1]
        words = np.random.SeedSequence(key).generate_state(which.stop)
        return [int(word) >> 1 for word in words[which.start :]]

    def _miss(self, what: str) -> None:
        self.not_tried.append(f"{what}: the budget is spent")


def _tried_action(option: ActionOption, hits: int, n: int) -> AlternativeAction:
    text = None if option.source == DRAWN else to_json(option.action)
    return AlternativeAction(agent_name(option.agent), text, option.source, hits, n)


# -- other actions of the agents at a turn

DRAWN: Final = "policy"
LEGAL: Final = "legal"
SAMPLE: Final = "sample"
MOST_LEGAL: Final = 12
"""Legal actions of an agent that are tried; of more as many are drawn."""
SAMPLES: Final = 4
"""Samples of a space that isn't Discrete."""


@dataclass(frozen=True, slots=True)
class ActionOption:
    """An action of one agent in place of its recorded one.

    Attributes:
        agent: as the environment knows it.
        source: `policy`: whatever its policy chooses; `legal`, `sample` or `reference`.
        action: the action; None for its policy's.
    """

    agent: Any
    source: str
    action: Any = None


def reference_of(env: Any, contract: Contract) -> JointPolicy | None:
    """The environment's own reference policy, if it has one."""
    own = getattr(env.unwrapped, "policies", None)
    if not isinstance(own, Mapping) or REFERENCE not in own:
        return None
    return joint_policy_of(REFERENCE, env, contract)


def _others(
    legal_actions: LegalActions, agent: Any, recorded: Any, rng: np.random.Generator
) -> Iterator[ActionOption]:
    space = legal_actions.space
    if isinstance(space, Discrete):
        every = range(int(space.start), int(space.start + space.n))
        legal = [each for each in every if each != int(recorded) and legal_actions.allows(each)]
        if len(legal) > MOST_LEGAL:
            legal = sorted(rng.choice(legal, MOST_LEGAL, replace=False).tolist())
        yield from (ActionOption(agent, LEGAL, space.dtype.type(each)) for each in legal)
        return
    own = copy.deepcopy(space)
    own.seed(int(rng.integers(1 << 31)))
    drawn = [own.sample() for _ in range(SAMPLES)]
    yield from (ActionOption(agent, SAMPLE, each) for each in drawn if legal_actions.allows(each))
