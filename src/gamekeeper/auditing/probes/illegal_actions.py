"""Probes of actions that are illegal, rare, or come from agents that have ended."""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.auditing.branches import value_digest
from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import Called, ProbeSession, Saw
from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.facts.action_facts import EndedActions, TriedAction
from gamekeeper.checks.literal import literal
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.divergence import compare
from gamekeeper.episodes.episode import Turn
from gamekeeper.episodes.layout import agent_name
from gamekeeper.interface.action_mask import reader
from gamekeeper.rollouts.episode_loop import Actions, EpisodePlan, EpisodeResult

MOST_TURNS: Final = 4
"""Legal turns before it; one of them is chosen."""
STRANGER: Final = "nobody_{}"
"""With the first number that no agent is called by."""
RARE: Final = frozenset({"low", "high", "plain", "narrow"})
"""Cases that are legal."""


@probe("illegal", share=1.0, plays=lambda session: session.plays(3, most_turns=MOST_TURNS))
def illegal(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Illegal actions: out of the space, forbidden by the mask, missing, unknown, None, NaN.

    And legal ones that random play seldom or never comes to: the corners of a space, a plain int.

    What became of each kind of illegal action, on a fresh episode, and of the environment then.

    Facts:
        `TriedAction`.
        `rare`: the same of a legal action, `case` (low, high, plain, narrow); only without masks.
    """
    env = session.env()
    played = session.play(play, env, state=False)
    if played.failed is not None or not played.play.actions:
        return
    unchanged_rerun = session.play(played.play, env, state=False)
    differs = compare(played.episode, unchanged_rerun.episode).divergence
    is_alike = differs is None and unchanged_rerun.failed is None
    turns = list(played.episode.turns)
    for case in _cases(session, played, turns):
        done = _tried(session, env, played, case)
        if done is None:
            return
        again = session.play(played.play, env, state=False).failed
        if again is not None:
            env = session.env()
            if again.call != "reset" and not is_alike:
                again = None  # the same actions aren't always legal: nothing can be said here
        said = None if again is None else f"{again.call} raised {again.said}"
        value = TriedAction(
            **done, is_legal=case.name in RARE, case=case.name, action=case.actions, again=said
        )
        yield session.fact(value, turn=case.turn, agent=case.agent, field=case.name)


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


def _cases(session: ProbeSession, played: EpisodeResult, turns: list[Turn]) -> Iterator[_Case]:
    """The illegal actions for this episode, each at the last turn that was acted on."""
    actions = played.play.actions or ()
    moves = [
        (place, agent)
        for place, script in enumerate(actions)
        for agent, action in script.items()
        if action is not None
    ]
    if not moves:
        return
    place, agent = moves[-1]
    script = actions[place]
    paid = turns[place].rewards.get(agent_name(agent))
    space = session.space_of(agent)
    strange: list[tuple[str, Any]] = [("none", None)]
    strange += [] if space is None else _outside(space)
    if space is not None and not turns[place].masks:
        strange += _rare(space, script[agent])
    for name, action in strange:
        yield _Case(name, place, agent, {**script, agent: action}, paid)
    if session.api == "parallel":
        rest = {each: action for each, action in script.items() if each != agent}
        yield _Case("missing", place, agent, rest, paid)
        known = {agent_name(each) for turn in actions for each in turn} | session.agents.keys()
        stranger = next(name for name in map(STRANGER.format, count()) if name not in known)
        yield _Case("stranger", place, agent, {**script, stranger: script[agent]}, paid)
    yield from _masked(session, played, turns)


def _masked(session: ProbeSession, played: EpisodeResult, turns: list[Turn]) -> Iterator[_Case]:
    """An action that a mask forbids, at the last turn at which one of a Discrete space does."""
    actions = played.play.actions or ()
    for place in reversed(range(len(actions))):
        turn = turns[place]
        for agent in actions[place]:
            space = session.space_of(agent)
            mask: Any = reader(session.contract.mask_of(agent_name(agent)))(
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
        found.append(("plain", int(action)))
        if abs(int(action)) <= np.iinfo(np.int32).max:
            found.append(("narrow", np.int32(action)))
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
            with np.errstate(over="ignore"):  # infinity is outside too
                far = np.asarray(space.high + (space.high - space.low) + 1).astype(space.dtype)
            found.append(("outside", far))
        return found
    return []


def _tried(
    session: ProbeSession, env: Any, played: EpisodeResult, case: _Case
) -> dict[str, Any] | None:
    """Result of the illegal step; None where the legal actions before it went otherwise."""
    play = played.play
    if session.reset(env, play).failed is not None:
        return None
    for actions in (play.actions or ())[: case.turn]:
        if session.step(env, session.handed(dict(actions))).failed is not None:
            return None
    with warnings.catch_warnings():  # of NaN that was handed in: no news to anybody
        warnings.simplefilter("ignore")
        done = session.step(env, session.handed(dict(case.actions)))
    return {
        "raised": done.said,
        "reward": _paid(session, env, done, case.agent),
        "legal_reward": case.legal,
        "is_over": done.failed is None and _is_over(session, env, done, case.agent),
    }


def _paid(session: ProbeSession, env: Any, done: Called, agent: Any) -> float | None:
    try:
        paid = done.value[1] if session.api == "parallel" else env.rewards
        return float(paid[agent])
    except Exception:  # foreign code: it may keep no books, or none of this agent any more
        return None


def _is_over(session: ProbeSession, env: Any, done: Called, agent: Any) -> bool:
    try:
        flags = (
            done.value[2:4] if session.api == "parallel" else (env.terminations, env.truncations)
        )
        return agent not in env.agents or any(bool(each.get(agent)) for each in flags)
    except Exception:  # foreign code: it may keep no books
        return False


PLAYS: Final = 3
BEYOND: Final = 10
"""Turns after somebody's end in which an action of theirs may show."""


@probe("ended", share=1.0, plays=lambda session: session.plays(PLAYS, runs=3), api="parallel")
def ended(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Actions of agents that have ended in a Parallel environment: do they change anything?

    An episode in which somebody ends, played on with actions of those who have.

    Facts:
        `EndedActions`.
    """
    env = session.env()
    played = session.play(play, env, state=False)
    yield played.episode
    extra = _extra(played)
    if extra is None:
        return
    cut, both = _cut(played, extra), _ways(extra)
    ways: Any = {}, *both, {}  # the same again last: there shows what use alone changes
    answers = [_answers(session, env, cut, way) for way in ways]
    outcomes, raised = [each for each, _ in answers], [each for _, each in answers]
    if outcomes[0] != outcomes[-1]:  # what state() gives may hold more than the game
        outcomes = [[(text, b"") for text, _ in outcome] for outcome in outcomes]
    if raised[0] or raised[-1] or outcomes[0] != outcomes[-1]:
        return  # it isn't the same game twice: nothing can be blamed on the actions
    if raised[1] or raised[2]:
        yield session.fact(EndedActions(list(extra), None), field="ended_acts")
        return
    turn = next(
        (t for t, given in enumerate(zip(*outcomes, strict=False)) if len({*given}) > 1), None
    )
    end = len(cut.actions or ()) if turn is None else turn
    is_in_state = len({tuple(text for text, _ in outcome) for outcome in outcomes}) == 1
    proof = _proof(extra, with_state=turn is not None and is_in_state)
    yield session.fact(EndedActions(list(extra), turn), turn=end, field="ended_acts", proof=proof)


def _extra(played: EpisodeResult) -> dict[Any, tuple[Any, Any]] | None:
    """Two actions of their own for those who ended first, if not with the episode itself."""
    turns = played.play.actions or ()
    ends = {agent: turn for turn, actions in enumerate(turns) for agent in actions}
    first = min(ends.values(), default=len(turns))
    found: dict[Any, tuple[Any, Any]] = {}
    for agent in ends:
        own = {to_json(actions[agent]): actions[agent] for actions in turns if agent in actions}
        if ends[agent] == first < len(turns) - 1 and len(own) > 1:
            found[agent] = tuple(own.values())[:2]
    return found or None


def _ways(extra: Mapping[Any, tuple[Any, Any]]) -> list[dict[Any, Any]]:
    """The first actions of all of them, and the second ones."""
    return [{agent: acts[way] for agent, acts in extra.items()} for way in (0, 1)]


def _cut(played: EpisodeResult, extra: Mapping[Any, Any]) -> EpisodePlan:
    """The episode until some turns after they had ended."""
    turns = played.play.actions or ()
    end = max(turn for turn, actions in enumerate(turns) if extra.keys() & actions.keys())
    return replace(played.play, actions=turns[: end + 1 + BEYOND])


def _answers(
    session: ProbeSession, env: Any, play: EpisodePlan, extra: Mapping[Any, Any]
) -> tuple[list[tuple[str, bytes]], str | None]:
    """Text of each call where ended agents act too, with the state after it; and the exception."""
    reset = session.call("reset", env.reset, seed=play.seed)
    session.meter.count()
    given = [(to_json(reset.value), b"")]
    for actions in play.actions or ():
        called = session.step(env, _with(play, extra, actions, len(given) - 1))
        if called.failed is not None:
            return given, called.failed.kind
        text = to_json(called.value[:4] if isinstance(called.value, tuple) else None)
        given.append((text, value_digest(session.call("state", lambda: env.state()).value)))
    return given, None


def _with(
    play: EpisodePlan, extra: Mapping[Any, Any], actions: Actions, turn: int
) -> dict[Any, Any]:
    """The actions of a turn, and of those who have acted before and don't any more."""
    turns = play.actions or ()
    later = {agent for each in turns[turn:] for agent in each}
    earlier = {agent for each in turns[:turn] for agent in each}
    return {**actions, **{a: extra[a] for a in extra if a in earlier and a not in later}}


def _proof(extra: Mapping[Any, tuple[Any, Any]], *, with_state: bool) -> Reproducer:
    once, other = _ways(extra)
    state = "        given.append(env.state())\n" if with_state else ""
    lines = f"""\
def answers(gone):
    \"\"\"What an episode gives in which those who have ended act too.\"\"\"
    env = make()
    given = [env.reset(seed=SEED)[0]]
    for turn, actions in enumerate(ACTIONS):
        later = {{agent for each in ACTIONS[turn:] for agent in each}}
        earlier = {{agent for each in ACTIONS[:turn] for agent in each}}
        more = {{a: gone[a] for a in gone if a in earlier and a not in later}}
        given.append(env.step({{**actions, **more}})[:4])
{state}    return given

for gone in ({literal(once)}, {literal(other)}):
    np.testing.assert_equal(answers(gone), answers({{}}))"""
    return Reproducer(lines, plays=False)
