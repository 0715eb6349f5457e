"""Illegal actions: out of the space, forbidden by the mask, missing, unknown, None, NaN.

And legal ones that random play seldom or never comes to: the corners of a space, a plain int.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.audit.lab import Called, Lab, Saw
from gamekeeper.core.divergence import compare
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import Turn
from gamekeeper.game.casting.mask import reader
from gamekeeper.run.episode import Play, Played

SHARE: Final = 1.0
MOST_TURNS: Final = 4
"""Legal turns before it; one of them is chosen."""
STRANGER: Final = "nobody_7"
RARE: Final = frozenset({"low", "high", "plain", "narrow"})
"""Cases that are legal."""


def plays(lab: Lab) -> Iterator[Play]:
    """Three short ones."""
    return lab.plays(3, most_turns=MOST_TURNS)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """What became of each kind of illegal action, on a fresh play, and of the environment then.

    Facts:
        `illegal`: `case` (outside, below, masked, none, nan, missing, stranger), `action` as handed
            to step, `raised` or None, `again`: what a reset and the legal play after it raised, or
            None; for a masked one also `reward`, `legal_reward`, `is_over` for the agent.
        `rare`: the same of a legal action, `case` (low, high, plain, narrow); only without masks.
    """
    env = lab.env()
    played = lab.play(play, env, state=False)
    if played.failed is not None or not played.play.actions:
        return
    sham = lab.play(played.play, env, state=False)
    is_alike = compare(played.trace, sham.trace).divergence is None and sham.failed is None
    turns = list(played.trace.turns)
    for case in _cases(lab, played, turns):
        done = _tried(lab, env, played, case)
        if done is None:
            return
        again = lab.play(played.play, env, state=False).failed
        if again is not None:
            env = lab.env()
            if again.call != "reset" and not is_alike:
                again = None  # the same actions aren't always legal: nothing can be said here
        said = None if again is None else f"{again.call} raised {again.kind}: {again.text}"
        value = {**done, "case": case.name, "action": case.actions, "again": said}
        name = "rare" if case.name in RARE else "illegal"
        yield lab.fact(name, value, turn=case.turn, agent=case.agent, field=case.name)


@dataclass(frozen=True, slots=True)
class _Case:
    """One illegal action in place of what was done at a turn.

    Attributes:
        actions: of the turn, as they are handed over.
        agent: whose action is illegal.
        legal: what it was paid for the legal one.
    """

    name: str
    turn: int
    agent: Any
    actions: Mapping[Any, Any]
    legal: float | None


def _cases(lab: Lab, played: Played, turns: list[Turn]) -> Iterator[_Case]:
    """The illegal actions for this play, each at the last turn that was acted on."""
    actions = played.play.actions or ()
    moves = [
        (place, agent)
        for place, paper in enumerate(actions)
        for agent, action in paper.items()
        if action is not None
    ]
    if not moves:
        return
    place, agent = moves[-1]
    paper = actions[place]
    paid = turns[place].rewards.get(agent_name(agent))
    spec = lab.agents.get(agent_name(agent))
    space = None if spec is None else spec.action_space
    strange: list[tuple[str, Any]] = [("none", None)]
    strange += [] if space is None else _outside(space)
    if space is not None and not turns[place].masks:
        strange += _rare(space, paper[agent])
    for name, action in strange:
        yield _Case(name, place, agent, {**paper, agent: action}, paid)
    if lab.api == "parallel":
        rest = {each: action for each, action in paper.items() if each != agent}
        yield _Case("missing", place, agent, rest, paid)
        yield _Case("stranger", place, agent, {**paper, STRANGER: paper[agent]}, paid)
    yield from _masked(lab, played, turns)


def _masked(lab: Lab, played: Played, turns: list[Turn]) -> Iterator[_Case]:
    """An action that a mask forbids, at the last turn at which one of a Discrete space does."""
    actions = played.play.actions or ()
    for place in reversed(range(len(actions))):
        turn = turns[place]
        for agent in actions[place]:
            spec = lab.agents.get(agent_name(agent))
            space = None if spec is None else spec.action_space
            mask: Any = reader(lab.contract.mask_of(agent_name(agent)))(
                turn.observations.get(agent_name(agent)), turn.infos.get(agent_name(agent))
            )
            if not isinstance(space, spaces.Discrete) or np.shape(mask) != (int(space.n),):
                continue
            closed = np.flatnonzero(~np.asarray(mask).astype(bool))
            if closed.size and agent_name(agent) not in turn.ended:
                action = int(space.start) + int(closed[0])
                paid = turn.rewards.get(agent_name(agent))
                yield _Case("masked", place, agent, {**actions[place], agent: action}, paid)
                return


def _rare(space: spaces.Space[Any], action: Any) -> list[tuple[str, Any]]:
    """Actions of the space that random play seldom comes to, by the name of the case."""
    if isinstance(space, spaces.Discrete):
        low, high = int(space.start), int(space.start) + int(space.n) - 1
        dtype = space.dtype.type
        found: list[tuple[str, Any]] = [("low", dtype(low)), ("high", dtype(high))]
        found += [("plain", int(action)), ("narrow", np.int32(action))]
        return [(name, each) for name, each in found if space.contains(each)]
    if isinstance(space, spaces.Box) and space.is_bounded():
        return [("low", space.low.copy()), ("high", space.high.copy())]
    return []


def _outside(space: spaces.Space[Any]) -> list[tuple[str, Any]]:
    """Values that aren't of the space, by the name of the case."""
    if isinstance(space, spaces.Discrete):
        start, end = int(space.start), int(space.start) + int(space.n)
        return [("outside", end), ("below", start - 1)]
    if isinstance(space, spaces.MultiDiscrete):
        return [("outside", np.asarray(space.start + space.nvec).astype(np.int64))]
    if isinstance(space, spaces.MultiBinary):
        return [("outside", np.full(space.shape, 2, np.int64))]
    if isinstance(space, spaces.Box) and np.dtype(space.dtype).kind == "f":
        found = [("nan", np.full(space.shape, np.nan, space.dtype))]
        if np.isfinite(space.high).all():
            far = np.asarray(space.high + (space.high - space.low) + 1).astype(space.dtype)
            found.append(("outside", far))
        return found
    return []


def _tried(lab: Lab, env: Any, played: Played, case: _Case) -> dict[str, Any] | None:
    """What the illegal step came to; None where the legal play before it went otherwise."""
    play = played.play
    options = {} if play.options is None else {"options": dict(play.options)}
    if lab.call("reset", env.reset, seed=play.seed, **options).failed is not None:
        return None
    for actions in (play.actions or ())[: case.turn]:
        if lab.step(env, _handed(lab, dict(actions))).failed is not None:
            return None
    with warnings.catch_warnings():  # of NaN that was handed in: no news to anybody
        warnings.simplefilter("ignore")
        done = lab.step(env, _handed(lab, dict(case.actions)))
    failed = done.failed
    return {
        "raised": None if failed is None else f"{failed.kind}: {failed.text}",
        "reward": _paid(lab, env, done, case.agent),
        "legal_reward": case.legal,
        "is_over": failed is None and _is_over(lab, env, done, case.agent),
    }


def _handed(lab: Lab, actions: dict[Any, Any]) -> Any:
    return actions if lab.api == "parallel" else next(iter(actions.values()), None)


def _paid(lab: Lab, env: Any, done: Called, agent: Any) -> float | None:
    try:
        paid = done.value[1] if lab.api == "parallel" else env.rewards
        return float(paid[agent])
    except Exception:  # foreign code: it may keep no books, or none of this agent any more
        return None


def _is_over(lab: Lab, env: Any, done: Called, agent: Any) -> bool:
    try:
        flags = done.value[2:4] if lab.api == "parallel" else (env.terminations, env.truncations)
        return agent not in env.agents or any(bool(each.get(agent)) for each in flags)
    except Exception:  # foreign code: it may keep no books
        return False
