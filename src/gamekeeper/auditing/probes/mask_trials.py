"""Probe of action masks: every action tried at a turn, beside the masks of others and of later."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.auditing.branches import value_digest
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.auditing.probes.replaced_actions import own_name
from gamekeeper.checks.facts.action_facts import MaskTrial
from gamekeeper.checks.spaces.misleading_masks import step_outcome
from gamekeeper.episodes.episode import Turn
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.process_randomness import held

ROUNDS: Final = 12
MOST_PLAYS: Final = 24
TRIALS: Final = 8
"""Turns of one episode."""
MOST_ACTIONS: Final = 12
"""Actions tried at one turn, half of them forbidden ones where there are more."""
MOST_LATER: Final = 5
"""Turns after it whose masks are laid beside its own."""


def _plays(session: ProbeSession) -> Iterator[EpisodePlan]:
    """Plays of few rounds, as long as something was tried in the one before."""
    scale = min(max(len(session.agents), 1), 4) if session.api == "aec" else 1
    for play in session.plays_of([ROUNDS * scale] * MOST_PLAYS):
        begun = session.meter.steps
        yield play
        if session.meter.steps - begun <= play.most_turns + 1:
            return


@probe("mask_trials", share=0.0, on_top=0.3, plays=_plays, tries=4)
def mask_trials(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Every action of an agent with a mask at some turns, each in its own episode.

    Outcomes are compared by what the step gives. Beside the mask stand those of other agents at
    this turn, of the turns after it, and the inverted one.

    Facts:
        `MaskTrial`.
    """
    base = session.play(play, session.env(), state=False)
    spots = [
        (turn, agent, flags)
        for turn in base.episode.turns
        for agent in turn.order
        if (flags := _flags(session, turn, agent)) is not None and not flags.all()
    ]
    step = max(len(spots) // TRIALS, 1)
    for turn, agent, flags in spots[play.stream % step :: step][:TRIALS]:
        value = _tried(session, base, turn, agent, flags)
        if value is not None:
            yield session.fact(value, turn=turn.index, agent=agent, field="mask")


def _flags(session: ProbeSession, turn: Turn, agent: str) -> Any:
    """The mask of an agent as bools; None where it has none, or of no Discrete space."""
    space, mask = session.space_of(agent), turn.masks.get(agent)
    if mask is None or not isinstance(space, Discrete) or turn.actions.get(agent) is None:
        return None
    flags = np.asarray(mask)
    return flags.astype(bool) if flags.shape == (int(space.n),) else None


def _tried(
    session: ProbeSession, base: EpisodeResult, turn: Turn, agent: str, flags: Any
) -> MaskTrial | None:
    """The trial at one turn; None where equal plays aren't alike."""
    space, name = session.space_of(agent), own_name(base, agent)
    places = _places(flags, np.random.default_rng([7, turn.index]))
    actions = tuple(space.dtype.type(int(space.start) + place) for place in places)
    digests = [_outcome(session, base, turn.index, name, each) for each in actions]
    again = _outcome(session, base, turn.index, name, actions[0])
    if again != digests[0]:
        return None
    kinds = {digest: number for number, digest in enumerate(dict.fromkeys(digests))}
    return MaskTrial(
        agent=name,
        actions=actions,
        given=tuple(bool(flags[place]) for place in places),
        classes=tuple(-1 if each is None else kinds[each] for each in digests),
        others={
            source: tuple(bool(other[place]) for place in places)
            for source, other in _others(session, base, turn, agent, flags)
        },
    )


def _places(flags: Any, rng: np.random.Generator) -> list[int]:
    """The actions to try, in order."""
    if len(flags) <= MOST_ACTIONS:
        return list(range(len(flags)))
    half = MOST_ACTIONS // 2
    kinds = (np.flatnonzero(flags), np.flatnonzero(~flags))
    drawn = [rng.choice(kind, min(half, len(kind)), replace=False) for kind in kinds]
    return sorted(int(place) for kind in drawn for place in kind)


def _outcome(
    session: ProbeSession, base: EpisodeResult, turn: int, agent: Any, action: Any
) -> bytes | None:
    """Digest of a step with this action; None where it raised."""
    plan = base.play
    handed = [session.handed(dict(each)) for each in (plan.actions or ())[: turn + 1]]
    session.meter.count(turn + 2)
    with held():
        call = session.call(
            "step", step_outcome, session.env, plan.seed, handed, turn, agent, action
        )
    return None if call.value is None else value_digest(call.value)


def _others(
    session: ProbeSession, base: EpisodeResult, turn: Turn, agent: str, flags: Any
) -> Iterator[tuple[str, Any]]:
    """Yields other masks of as many actions, each with words for its source."""
    yield "the inverted mask", ~flags
    names = list(session.agents)
    for name in turn.masks if session.api == "parallel" else ():
        other = _flags(session, turn, name)
        if name != agent and agent in names and other is not None and len(other) == len(flags):
            ahead = (names.index(name) - names.index(agent)) % len(names)
            yield f"the mask of the agent {ahead} places on in possible_agents", other
    later = min(MOST_LATER, len(names) + 1) if session.api == "aec" else 1
    turns = {each.index: each for each in base.episode.turns}
    for lag in range(1, later + 1):
        then = turns.get(turn.index + lag)
        order = () if then is None else then.order if session.api == "aec" else (agent,)
        for name in order:
            other = None if then is None else _flags(session, then, name)
            if other is not None and len(other) == len(flags):
                yield f"the mask of {lag} turn{'s' * (lag > 1)} later", other
