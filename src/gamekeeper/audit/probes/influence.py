"""One action replaced at one turn by another legal one, everybody else's as they were.

What differs from a rerun with nothing changed is that action's doing, though it may work through
the random stream. Later actions stand on paper, so no policy carries an effect on.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import Turn
from gamekeeper.run.changes.replaced_action import ReplacedAction
from gamekeeper.run.episode import Play

SHARE: Final = 3.0
LENGTHS: Final = (8, 14, 24, 40)
"""Turns of the plays, over and over: short ones are cheap, in long ones the middle is seen."""
MOST_PLAYS: Final = 40
TRIALS: Final = 8
"""Replaced actions in one play."""
LAGS: Final = 2
"""Ticks (AEC: rounds) after the crossing that are looked at where no mask forbids it."""
MOST_LATER: Final = 12
TRIES: Final = 8


def plays(lab: Lab) -> Iterator[Play]:
    """Plays of several lengths; in AEC environments as many rounds."""
    scale = max(len(lab.agents), 1) if lab.api == "aec" else 1
    for k in range(MOST_PLAYS):
        turns = min(LENGTHS[k % len(LENGTHS)] * min(scale, 8), max(lab.ration // 8, 8))
        yield Play(seed=lab.seed + k, stream=k, most_turns=turns)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """A twin for each replaced action, cut a few turns after it; their sham is one and the same."""
    env = lab.env()
    base = lab.play(play, env, state=False)
    spots = [turn for turn in base.trace.turns if _movers(turn)]
    if not spots:
        return
    sham = lab.play(base.play, env, state=False)
    step = max(len(spots) // TRIALS, 1)
    offset = play.stream % step
    for place, turn in enumerate(spots[offset::step][: TRIALS + 1]):
        movers = _movers(turn)
        agent = movers[(place + play.stream) % len(movers)]
        mask = turn.masks.get(agent)
        found, action = _other(lab, agent, turn.actions[agent], mask, turn.index)
        if not found:
            continue
        later = 0 if turn.masks else _later(lab)
        # in AEC what comes of the last crossing is only seen by whoever is asked next
        cut = (base.play.actions or ())[: turn.index + 1 + later + (lab.api == "aec")]
        trial = replace(base, play=replace(base.play, actions=cut, most_turns=len(cut)))
        change = ReplacedAction(turn.index, _own(base, agent), action)
        twin = lab.twin(trial, sham, change, env, state=False)
        yield replace(twin, change={**twin.change, "agent": agent, "later": later})


def _later(lab: Lab) -> int:
    return LAGS if lab.api == "parallel" else min(LAGS * len(lab.agents), MOST_LATER)


def _movers(turn: Turn) -> list[str]:
    """Those who acted and were alive."""
    return [agent for agent in turn.order if turn.actions.get(agent) is not None]


def _own(base: Any, name: str) -> Any:
    """The agent as the environment calls it."""
    known = (agent for each in base.play.actions or () for agent in each)
    return next((agent for agent in known if agent_name(agent) == name), name)


def _other(lab: Lab, agent: str, action: Any, mask: Any, turn: int) -> tuple[bool, Any]:
    """Another legal action, if one is found."""
    spec = lab.agents.get(agent)
    space = None if spec is None else spec.action_space
    rng = np.random.default_rng([13, turn])
    if isinstance(space, Discrete):
        choices = np.arange(int(space.n))
        if mask is not None:
            flags = np.asarray(mask).ravel()
            choices = choices[flags.astype(bool)] if flags.shape == choices.shape else choices[:0]
        choices = choices[choices + int(space.start) != int(action)]
        if not len(choices):
            return False, None
        return True, space.dtype.type(int(rng.choice(choices)) + int(space.start))
    if space is None or mask is not None:
        return False, None
    own = lab.call("deepcopy", copy.deepcopy, space)
    if own.failed is not None:
        return False, None
    own.value.seed(int(rng.integers(1 << 31)))
    for _ in range(TRIES):
        drawn = own.value.sample()
        if repr(drawn) != repr(action):
            return True, drawn
    return False, None
