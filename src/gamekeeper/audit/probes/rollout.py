"""Rollouts from several seeds with random legal actions, long enough to see endings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.audit.probes.state import form_of, space_of
from gamekeeper.core.layout import agent_name
from gamekeeper.core.trace import Trace
from gamekeeper.run.episode import Play

SHARE: Final = 6.0
PLAYS: Final = 8
"""Episodes at least, however long."""
SHORT_PLAYS: Final = 16
"""Further episodes, where the first ones ended early and left steps to spend."""


def plays(lab: Lab) -> Iterator[Play]:
    """First a few that may be long, then more while there are steps left."""
    turns = max(lab.ration // PLAYS, 20)
    for k in range(PLAYS + SHORT_PLAYS):
        yield Play(seed=lab.seed + k, stream=k, most_turns=turns)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """The trace, and what raised.

    Facts:
        `raised`: a call raised; `Failed` as a dictionary.
        `selected`: (AEC) whom `agent_selection` named before each turn and after the last, with
            whether it stood in `agents`: a list of [name, bool].
        `agents`: the roster after the reset and after each crossing, a list of lists.
        `over`: whether the episode ended by itself.
        `states`: `answers`: of the arrays that state() gave, the first of each form (dtype, shape,
            whether within its space, with NaN); as in the facts of the probe `state`.
    """
    rosters: list[list[str]] = []
    selected: list[tuple[str | None, bool]] = []

    def watch(turn: int, env: Any, out: Any) -> None:
        agents = env.agents
        rosters.append([agent_name(agent) for agent in agents])
        if lab.api == "aec" and agents:
            chosen = getattr(env, "agent_selection", None)
            selected.append((None if chosen is None else agent_name(chosen), chosen in agents))

    env = lab.env()
    played = lab.play(play, env, watch=watch)
    yield played.trace
    yield from _states(lab, space_of(lab, env), played.trace)
    yield lab.fact("agents", rosters, field="agents")
    yield lab.fact("over", played.is_over)
    if lab.api == "aec":
        yield lab.fact("selected", selected, field="agent_selection")
    if played.failed is not None:
        failed = played.failed
        value = {"call": failed.call, "kind": failed.kind, "text": failed.text}
        yield lab.fact(
            "raised", {**value, "traceback": failed.traceback}, turn=failed.turn, field="raised"
        )


def _states(lab: Lab, space: Space[Any] | None, trace: Trace) -> Iterator[Saw]:
    """The forms of state() in a play; rare ones are met in long plays alone."""
    forms: dict[str, dict[str, Any]] = {}
    for turn in trace.turns if trace.states is not None else ():
        if isinstance(turn.state, np.ndarray):
            form = form_of(turn.state, space)
            forms.setdefault(str(form), {"turn": turn.index, "failed": None, **form})
    if forms:
        yield lab.fact("states", {"answers": list(forms.values())}, field="state")
