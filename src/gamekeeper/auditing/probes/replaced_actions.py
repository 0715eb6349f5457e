"""Probes of replaced actions: what else an agent could have done."""

import copy
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, islice
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.moves import cut, legal, other_action
from gamekeeper.checks.effects import by_turn
from gamekeeper.checks.facts.episode_facts import LateEffect, MoverTrial, Payment
from gamekeeper.checks.probe_evidence import ProbeCounterfactual
from gamekeeper.checks.rounds import movers
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn
from gamekeeper.episodes.layout import agent_name
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult, StepHook
from gamekeeper.rollouts.interventions.action_substitutes import ReplacedAction
from gamekeeper.rollouts.process_randomness import reseed

LENGTHS: Final = (8, 14, 24, 40)
"""Turns of the episodes, over and over: short ones are cheap, in long ones the middle is seen."""
INFLUENCE_MOST_PLAYS: Final = 40
TRIALS: Final = 8
"""Replaced actions in one episode."""
LAGS: Final = 2
"""Ticks (AEC: rounds) after the step that are looked at, as far as masks allow the actions."""
MOST_LATER: Final = 12


def _influence_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Plays of several lengths; in AEC environments as many rounds."""
    scale = max(len(session.agents), 1) if session.api == "aec" else 1
    lengths = islice(cycle(LENGTHS), INFLUENCE_MOST_PLAYS)
    return session.plays_of(
        min(each * min(scale, 8), max(session.ration // 8, 8)) for each in lengths
    )


@probe("influence", share=3.0, plays=_influence_plays, tries=8)
def influence(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """One action at one turn replaced by another legal one, all others as recorded.

    What differs from a rerun with nothing changed is that action's doing, though it may work
    through the random stream. Later actions are scripted, so no policy carries an effect on.

    A counterfactual for each replaced action, cut a few turns after it; their unchanged rerun is
    one and the same. The first that moves a late reward alone is played again under other random
    draws.

    Facts:
        `LateEffect`.
    """
    env = session.env()
    base = session.play(play, env, state=False)
    spots = [turn for turn in base.episode.turns if movers(turn)]
    if not spots:
        return
    unchanged_rerun = session.play(base.play, env, state=False)
    if session.divergence(base.episode, unchanged_rerun.episode) is not None:
        session.unlike[:] = session.unlike or [base.play]
    step = max(len(spots) // TRIALS, 1)
    offset, is_late = play.stream % step, False
    for place, turn in enumerate(spots[offset::step][: TRIALS + 1]):
        acted = movers(turn)
        agent = acted[(place + play.stream) % len(acted)]
        mask = turn.masks.get(agent)
        found, action = other(session, agent, turn.actions[agent], mask, turn.index)
        if not found:
            continue
        later = LAGS if session.api == "parallel" else min(LAGS * len(session.agents), MOST_LATER)
        # in AEC what comes of the last step is only seen by whoever is asked next
        trial = replace(base, play=cut(base.play, turn.index + 1 + later + (session.api == "aec")))
        change = ReplacedAction(turn.index, own_name(base, agent), action)
        counterfactual = session.counterfactual(trial, unchanged_rerun, change, env, state=False)
        late = None if is_late else _late_step(counterfactual, turn.index, agent)
        if late is not None:
            is_late = True
            is_drawn = _is_drawn(session, env, trial.play, counterfactual, change, late)
            yield session.fact(LateEffect(late, is_drawn), turn=late)
        legal_for = _legal_for(session, counterfactual.episode, turn.index, later)
        yield replace(
            counterfactual, change={**counterfactual.change, "agent": agent, "later": legal_for}
        )


def _late_step(counterfactual: ProbeCounterfactual, start: int, agent: str) -> int | None:
    """The first step that pays differently, if its agent's next turn isn't after it."""
    has_acted = False
    pairs = zip(counterfactual.base.turns, counterfactual.episode.turns, strict=False)
    for one, two in islice(pairs, start, None):
        has_acted = has_acted or (one.index > start and agent in movers(one))
        if not (one.order and two.order):
            return None
        if dict(one.rewards) != dict(two.rewards):
            return one.index if has_acted else None
    return None


def _is_drawn(
    session: ProbeSession,
    env: Any,
    plan: EpisodePlan,
    recorded: ProbeCounterfactual,
    change: ReplacedAction,
    step: int,
) -> bool:
    """Tells whether the action is worth something else under other draws in the step that pays."""
    one, two = (
        session.play(cut(plan, step + 1), env, change=each, watch=redrawn(step), state=False)
        for each in (None, change)
    )
    episodes = (recorded.base, recorded.episode, one.episode, two.episode)
    paid = [by_turn(each, step, step + 1) for each in episodes]
    if not all(paid):
        return False
    rewards = [dict(turns[step].rewards) for turns in paid]
    names = sorted({name for each in rewards for name in each})
    table = np.array([[each.get(name, 0.0) for name in names] for each in rewards])
    return not np.allclose(table[1] - table[0], table[3] - table[2])


def redrawn(step: int) -> StepHook:
    """Gives every generator another future before a step."""

    def watch(turn: int, env: Any, out: Any) -> None:
        if turn == step:
            reseed(env, 1)

    return watch


def _legal_for(session: ProbeSession, episode: Episode, start: int, later: int) -> int:
    """Turns after `start` up to which masks allow what the script holds, `later` at most."""
    for turn in episode.turns:
        if start < turn.index <= start + later:
            for agent, mask in turn.masks.items():
                space, action = session.space_of(agent), turn.actions.get(agent)
                if action is None or not isinstance(space, Discrete):
                    continue
                if int(action) not in legal(space, mask):
                    return turn.index - start - 1
    return later


def other(session: ProbeSession, agent: str, action: Any, mask: Any, turn: int) -> tuple[bool, Any]:
    """Another legal action, if one is found."""
    space = session.space_of(agent)
    rng = np.random.default_rng([13, turn])
    if isinstance(space, Discrete):
        return other_action(space, mask, action, rng)
    if space is None or mask is not None:
        return False, None
    own = session.call("deepcopy", copy.deepcopy, space)
    if own.failed is not None:
        return False, None
    own.value.seed(int(rng.integers(1 << 31)))
    return other_action(own.value, None, action, rng)


TURNS: Final = 16
"""Rounds of an episode: each alternative plays it again up to the payment."""
MOST_PLAYS: Final = 24
EVENTS: Final = 2
"""Payments of one episode that are looked into, of each term and sign."""
ALTERNATIVES: Final = 6


def individual_terms(contract: Contract) -> tuple[str, ...]:
    """The declared terms that are paid to the agent that earned them."""
    return tuple(
        name
        for name, term in contract.rewards.items()
        if term.kind == "individual" and term.payee == ("earner",)
    )


def paid(contract: Contract, turn: Turn, agent: str, term: str) -> float:
    """Reward of the step to the agent for that term; a single term is the whole reward."""
    if turn.terms:
        return turn.terms.get(agent, {}).get(term, 0.0)
    return turn.rewards.get(agent, 0.0) if len(contract.rewards) == 1 else 0.0


def short_plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Plays of few rounds."""
    scale = max(len(session.agents), 1) if session.api == "aec" else 1
    return session.plays_of([TURNS * scale] * MOST_PLAYS)


@probe(
    "alternatives",
    share=1.0,
    plays=lambda session: short_plays(session) if individual_terms(session.contract) else iter(()),
)
def alternatives(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Other actions of each agent at the turn that paid a declared individual term.

    Only where the contract declares a term that is paid to its earner; else it costs nothing.

    A fact for each payment that was looked into.

    Facts:
        `Payment`.
    """
    env = session.env()
    base = session.play(play, env, state=False)
    begun = session.meter.steps
    looked: dict[tuple[str, bool], int] = {}
    for turn in base.episode.turns:
        for term in individual_terms(session.contract):
            for agent in turn.agents:
                amount = paid(session.contract, turn, agent, term)
                key = term, amount > 0
                if amount == 0 or looked.get(key, 0) >= EVENTS:
                    continue
                if session.meter.steps - begun > session.ration:
                    return
                looked[key] = looked.get(key, 0) + 1
                found = _alternatives_movers(session, env, base, turn, agent, term, amount)
                value = Payment(term=term, agent=agent, amount=amount, movers=found)
                yield session.fact(value, turn=turn.index, agent=agent, field="rewards")


def _alternatives_movers(
    session: ProbeSession,
    env: Any,
    base: EpisodeResult,
    turn: Turn,
    payee: str,
    term: str,
    amount: float,
) -> dict[str, MoverTrial]:
    """By agent, whether something else that it could have done makes the payment smaller."""
    found: dict[str, MoverTrial] = {}
    short = cut(base.play, turn.index + 1)
    for agent, then in last_acts(base.episode, turn.index).items():
        tried, instead = 0, None
        for action in others(session, agent, then):
            change = ReplacedAction(then.index, own_name(base, agent), action)
            counterfactual = session.play(short, env, change=change, state=False)
            if counterfactual.failed is not None:
                continue
            tried += 1
            after = next((t for t in counterfactual.episode.turns if t.index == turn.index), None)
            now = 0.0 if after is None else paid(session.contract, after, payee, term)
            if abs(now) < abs(amount) and instead is None:
                instead = action
        found[agent] = MoverTrial(then.index, tried, instead)
    return found


def last_acts(episode: Episode, turn: int) -> dict[str, Turn]:
    """The last turn at which each agent acted, no later than `turn`."""
    found: dict[str, Turn] = {}
    for each in episode.turns:
        if each.index > turn:
            break
        found.update(dict.fromkeys(movers(each), each))
    return found


def others(session: ProbeSession, agent: str, turn: Turn) -> list[Any]:
    """Other legal actions of the agent at that turn, a few; none where they aren't Discrete."""
    space = session.space_of(agent)
    if not isinstance(space, Discrete):
        return []
    own = int(turn.actions[agent])
    others = (each for each in legal(space, turn.masks.get(agent)) if each != own)
    return [space.dtype.type(each) for each in islice(others, ALTERNATIVES)]


def own_name(base: EpisodeResult, name: str) -> Any:
    """The agent as the environment calls it."""
    known = (agent for each in base.play.actions or () for agent in each)
    return next((agent for agent in known if agent_name(agent) == name), name)
