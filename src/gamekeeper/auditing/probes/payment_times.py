"""Probe of unusual rewards: the tick whose actions decide them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Final

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.moves import cut
from gamekeeper.auditing.probes.replaced_actions import (
    last_acts,
    other,
    others,
    own_name,
    redrawn,
    short_plays,
)
from gamekeeper.checks.effects import changed_numbers
from gamekeeper.checks.facts.episode_facts import PaymentTime
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.interface.generators import generators, is_same_state, state_of
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult, StepHook
from gamekeeper.rollouts.interventions.action_substitutes import ReplacedAction
from gamekeeper.rollouts.process_randomness import held

EVENTS: Final = 3
"""Rewards of one episode that are looked into."""
UNUSUAL: Final = 0.6
"""Part of the largest distance from an agent's median reward that makes another unusual too."""
RARE: Final = 0.34
"""Part of an agent's rewards that may be unusual."""


@probe("payment_times", share=0.0, on_top=0.3, plays=short_plays, tries=4)
def payment_times(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Other actions in a tick with an unusual reward, and in the tick before it.

    A reward is looked into that lies far from what its agent gets in most steps. If no
    agent's alternative in its own tick changes it, alternatives of the tick before are tried. One
    that makes the environment draw more or fewer random numbers decides nothing, nor does any where
    other draws in its own tick change the payment.

    Facts:
        `PaymentTime`.
    """
    env = session.env()
    base = session.play(play, env, state=False)
    begun = session.meter.steps
    for turn, agent, amount in _unusual(base.episode):
        if session.meter.steps - begun > session.ration // 2:
            return
        value = _timed(session, env, base, turn, agent, amount)
        if value is not None:
            yield session.fact(value, turn=turn.index, agent=agent, field="rewards")


def _unusual(episode: Episode) -> Iterator[tuple[Turn, str, float]]:
    """Steps that paid an agent far more or less than most, one agent for each, a few of them."""
    paying = [turn for turn in episode.turns if turn.order]
    found: dict[int, tuple[Turn, str, float]] = {}
    for agent in sorted({name for turn in paying for name in turn.rewards}):
        amounts = [turn.rewards.get(agent, 0.0) for turn in paying]
        usual = median(amounts)
        far = UNUSUAL * max(abs(each - usual) for each in amounts)
        events = [t for t, each in zip(paying, amounts, strict=True) if abs(each - usual) >= far]
        if far == 0 or len(events) > RARE * len(amounts):
            continue
        for turn in events:
            if turn.index > 0 and not turn.ended:
                found.setdefault(turn.index, (turn, agent, turn.rewards.get(agent, 0.0) - usual))
    yield from [found[index] for index in sorted(found)][:EVENTS]  # early ones: soon played again


@dataclass(frozen=True, slots=True)
class _Replay:
    """Turns of a rerun by number, and where all random generators stood at its end."""

    turns: dict[int, Turn]
    drawn: Sequence[Any]

    def reward(self, turn: int, agent: str) -> float:
        return self.turns[turn].rewards.get(agent, 0.0) if turn in self.turns else 0.0

    def observed(self, agent: str, after: int) -> Any:
        """First observation of the agent after the step; None where there is none."""
        seen = (each.observations.get(agent) for at, each in self.turns.items() if at > after)
        return next((each for each in seen if each is not None), None)


def _replayed(
    session: ProbeSession,
    env: Any,
    plan: EpisodePlan,
    change: ReplacedAction | None = None,
    watch: StepHook | None = None,
) -> _Replay | None:
    """The episode once more, with one action replaced; None where it failed."""
    with held():
        played = session.play(plan, env, change=change, watch=watch, hold=False, state=False)
        drawn = [state_of(each) for each in generators(env)]
    if played.failed is not None:
        return None
    return _Replay({turn.index: turn for turn in played.episode.turns}, drawn)


def _timed(
    session: ProbeSession, env: Any, base: EpisodeResult, turn: Turn, payee: str, amount: float
) -> PaymentTime | None:
    """The tick that decided a payment, as far as it can be told."""
    paid, enough = turn.index, abs(amount) / 2
    ahead = 1 if session.api == "parallel" else len(session.agents) + 1
    plan = cut(base.play, paid + ahead)
    one = _replayed(session, env, plan)
    if one is None or one.reward(paid, payee) != turn.rewards.get(payee, 0.0):
        return None
    own = last_acts(base.episode, paid)
    tried: list[tuple[int, str, Any]] = []
    for agent, then, action, two in _alternatives(session, env, base, plan, own):
        tried.append((then, agent, action))
        if abs(two.reward(paid, payee) - one.reward(paid, payee)) >= enough:
            return PaymentTime(payee, amount, tuple(tried), is_on_time=True)
    if not tried:
        return None
    before = {
        agent: found[agent]
        for agent, then in own.items()
        if agent in (found := last_acts(base.episode, then.index - 1))
    }
    for agent, then, action, two in _alternatives(session, env, base, plan, before):
        is_moved = abs(two.reward(paid, payee) - one.reward(paid, payee)) >= enough
        at_once = any(
            abs(two.reward(at, name) - one.reward(at, name)) >= enough
            for at in range(then, paid)
            if at in one.turns and at in two.turns
            for name in {*one.turns[at].rewards, *two.turns[at].rewards}
        )
        if is_moved and not at_once and _drew_alike(one, two):
            three = _replayed(session, env, plan, watch=redrawn(paid))
            if three is None or abs(three.reward(paid, payee) - one.reward(paid, payee)) >= enough:
                return PaymentTime(payee, amount, tuple(tried), is_on_time=three is not None)
            shown, after = (
                changed_numbers(*(each.observed(payee, at) for each in (one, two)))
                for at in (then, paid)
            )
            return PaymentTime(
                payee, amount, tuple(tried), decided=(then, agent, action), shown=shown, after=after
            )
    return PaymentTime(payee, amount, tuple(tried))


def _alternatives(
    session: ProbeSession, env: Any, base: EpisodeResult, plan: EpisodePlan, acts: dict[str, Turn]
) -> Iterator[tuple[str, int, Any, _Replay]]:
    """Reruns with another action of each agent, as long as the same agents act."""
    for agent, then in acts.items():
        one = other(session, agent, then.actions[agent], then.masks.get(agent), then.index)
        for action in others(session, agent, then) or [one[1]] * one[0]:
            change = ReplacedAction(then.index, own_name(base, agent), action)
            two = _replayed(session, env, plan, change)
            orders = [] if two is None else [turn.order for turn in two.turns.values()]
            same = [turn.order for turn in base.episode.turns[: len(orders)]]
            if two is not None and orders[:-1] == same[:-1]:
                yield agent, then.index, action, two


def _drew_alike(one: _Replay, two: _Replay) -> bool:
    """Tells whether both drew as many random numbers from the same generators."""
    return len(one.drawn) == len(two.drawn) and all(
        is_same_state(*each) for each in zip(one.drawn, two.drawn, strict=True)
    )
