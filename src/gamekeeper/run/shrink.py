"""Shrinking: the shortest play that still shows something.

Source: Zeller & Hildebrandt 2002, "Simplifying and isolating failure-inducing input" (ddmin), with
turns as the pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from gamekeeper.run.episode import Actions, Play

Still = Callable[[Play], bool]
"""Whether a play shows it too; one that can't be played doesn't."""


def shrink(
    play: Play,
    still: Still,
    *,
    turns: int | None = None,
    plain: Mapping[Any, Any] | None = None,
) -> Play:
    """The shortest play found that `still` shows it; the play itself where nothing shorter does.

    First the tail goes, then turns in between, then actions become plain ones. `still` is asked as
    long as it answers; whoever has had enough answers no.

    Args:
        play: has its actions on paper and shows it.
        turns: it is known to show after so many.
        plain: a simple action for each agent.
    """
    if play.actions is None:
        return play
    if turns is not None and turns < len(play.actions):
        cut = _with(play, play.actions[:turns])
        play = cut if still(cut) else play
    play = _without_turns(play, still)
    return _plainer(play, still, plain or {})


def _with(play: Play, actions: tuple[Actions, ...]) -> Play:
    return replace(play, actions=actions, most_turns=max(len(actions), 1))


def _without_turns(play: Play, still: Still) -> Play:
    """Leaves out runs of turns, long ones first."""
    actions = play.actions or ()
    size = max(len(actions) // 2, 1) if actions else 0
    while size:
        start = 0
        while start < len(actions):
            shorter = actions[:start] + actions[start + size :]
            if still(_with(play, shorter)):
                actions = shorter
            else:
                start += size
        size //= 2
    return _with(play, actions)


def _plainer(play: Play, still: Still, plain: Mapping[Any, Any]) -> Play:
    """Plain actions in place of drawn ones: everywhere at once, else turn by turn."""
    actions = list(play.actions or ())
    simple = [_plain_turn(each, plain) for each in actions]
    whole = _with(play, tuple(simple))
    if len(simple) and still(whole):
        return whole
    for place, each in enumerate(simple):
        tried = [*actions[:place], each, *actions[place + 1 :]]
        if still(_with(play, tuple(tried))):
            actions = tried
    return _with(play, tuple(actions))


def _plain_turn(actions: Actions, plain: Mapping[Any, Any]) -> Actions:
    return {
        agent: action if action is None else plain.get(agent, action)
        for agent, action in actions.items()
    }
