"""Calls that only look are made more often: does the game go another way?"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.run.changes.extra_calls import CALLS, ExtraCalls
from gamekeeper.run.episode import Play

SHARE: Final = 0.8
ONLY_AEC: Final = ("observe", "last")


def plays(lab: Lab) -> Iterator[Play]:
    """Two plays, each as it is, with a sham, and with the calls."""
    return lab.plays(2, runs=3, most_turns=200)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Plays the same actions with calls in between, all kinds at once.

    Where the play goes another way, each kind is tried alone to tell which it was.

    Twins:
        with the change `ExtraCalls`: all kinds that the environment offers, or one of them.
    Facts:
        `offered`: the kinds of calls that were made, a list.
    """
    base = lab.play(play, state=False)
    env = lab.env()
    sham = lab.play(base.play, env, state=False)
    kinds = _offered(lab, env, play)
    yield lab.fact("offered", list(kinds))
    twin = lab.twin(base, sham, ExtraCalls(kinds), state=False)
    if twin.noise is not None:  # it differs by itself
        return
    yield twin
    if twin.divergence is not None:
        for kind in kinds:
            yield lab.twin(base, sham, ExtraCalls((kind,)), state=False)


def _offered(lab: Lab, env: Any, play: Play) -> tuple[str, ...]:
    """The kinds of calls that this environment answers after a reset; it isn't played on."""
    if lab.call("reset", env.reset, seed=play.seed).failed is not None:
        return ()
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for kind, call in CALLS.items():
            if (kind in ONLY_AEC and lab.api != "aec") or (kind == "render" and _on_screen(env)):
                continue
            if lab.call(kind, call, env).failed is None:
                found.append(kind)
    return tuple(found)


def _on_screen(env: Any) -> bool:
    """Whether rendering would open a window."""
    return getattr(env, "render_mode", None) == "human"
