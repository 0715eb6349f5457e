"""Whether agents that have ended can still act in a Parallel environment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.audit.literal import literal
from gamekeeper.core.canon import to_json
from gamekeeper.core.proof import Proof
from gamekeeper.run.episode import Actions, Play, Played

SHARE: Final = 1.0
API: Final = "parallel"
PLAYS: Final = 3
BEYOND: Final = 10
"""Turns after somebody's end in which an action of theirs may show."""


def plays(lab: Lab) -> Iterator[Play]:
    """A few, long enough for somebody to end before the others."""
    yield from lab.plays(PLAYS, runs=3)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """A play in which somebody ends, played on with actions of those who have.

    Facts:
        `ended_acts`: {"agents", "raised": kind or None, "turn": the first at which what is given
            differs by what they did, or by their acting at all, or None}; None for both: it made
            no difference.
    """
    env = lab.env()
    played = lab.play(play, env, state=False)
    yield played.trace
    extra = _extra(played)
    if extra is None:
        return
    cut = _cut(played, extra)
    first, other = ({agent: acts[way] for agent, acts in extra.items()} for way in (0, 1))
    courses = []
    for way in ({}, {}, first, other):
        course, raised = _course(lab, env, cut, way)
        if raised is not None:
            if not way:
                return  # nor can it be played without them
            refused = {"agents": list(extra), "raised": raised, "turn": None}
            yield lab.fact("ended_acts", refused, field="ended_acts")
            return
        courses.append(course)
    if courses[0] != courses[1]:
        return  # it isn't the same game twice: nothing can be blamed on the actions
    turn = next((t for t, given in enumerate(zip(*courses, strict=False)) if len({*given}) > 1),
                None)  # fmt: skip
    value: dict[str, Any] = {"agents": list(extra), "raised": None, "turn": turn}
    end = len(cut.actions or ()) if turn is None else turn
    yield lab.fact("ended_acts", value, turn=end, field="ended_acts", proof=_proof(extra))


def _extra(played: Played) -> dict[Any, tuple[Any, Any]] | None:
    """Two actions of their own for those who ended first, if not with the play itself."""
    turns = played.play.actions or ()
    ends = {agent: turn for turn, actions in enumerate(turns) for agent in actions}
    first = min(ends.values(), default=len(turns))
    found: dict[Any, tuple[Any, Any]] = {}
    for agent in ends:
        own = {to_json(actions[agent]): actions[agent] for actions in turns if agent in actions}
        if ends[agent] == first < len(turns) - 1 and len(own) > 1:
            found[agent] = tuple(own.values())[:2]
    return found or None


def _cut(played: Played, extra: Mapping[Any, Any]) -> Play:
    """The play until some turns after they had ended."""
    turns = played.play.actions or ()
    end = max(turn for turn, actions in enumerate(turns) if extra.keys() & actions.keys())
    return replace(played.play, actions=turns[: end + 1 + BEYOND])


def _course(
    lab: Lab, env: Any, play: Play, extra: Mapping[Any, Any]
) -> tuple[list[str], str | None]:
    """What each call gives, as text, where those who ended act too; and what raised."""
    reset = lab.call("reset", env.reset, seed=play.seed)
    lab.meter.count()
    given = [to_json(reset.value)]
    for actions in play.actions or ():
        called = lab.step(env, _with(play, extra, actions, len(given) - 1))
        if called.failed is not None:
            return given, called.failed.kind
        given.append(to_json(called.value[:4] if isinstance(called.value, tuple) else None))
    return given, None


def _with(play: Play, extra: Mapping[Any, Any], actions: Actions, turn: int) -> dict[Any, Any]:
    """The actions of a turn, and of those who have acted before and don't any more."""
    turns = play.actions or ()
    later = {agent for each in turns[turn:] for agent in each}
    earlier = {agent for each in turns[:turn] for agent in each}
    return {**actions, **{a: extra[a] for a in extra if a in earlier and a not in later}}


def _proof(extra: Mapping[Any, tuple[Any, Any]]) -> Proof:
    once, other = ({agent: acts[way] for agent, acts in extra.items()} for way in (0, 1))
    lines = f"""\
def course(gone):
    \"\"\"What a play gives in which those who have ended act too.\"\"\"
    env = make()
    given = [env.reset(seed=SEED)[0]]
    for turn, actions in enumerate(ACTIONS):
        later = {{agent for each in ACTIONS[turn:] for agent in each}}
        earlier = {{agent for each in ACTIONS[:turn] for agent in each}}
        more = {{a: gone[a] for a in gone if a in earlier and a not in later}}
        given.append(env.step({{**actions, **more}})[:4])
    return given

for gone in ({literal(once)}, {literal(other)}):
    np.testing.assert_equal(course(gone), course({{}}))"""
    return Proof(lines, plays=False)
