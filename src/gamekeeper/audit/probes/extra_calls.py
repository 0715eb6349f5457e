"""Calls that only look are made more often: does the game go another way?"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.audit.lab import Lab, Saw
from gamekeeper.core.gathered import Twin
from gamekeeper.core.trace import Trace
from gamekeeper.run.change import Change
from gamekeeper.run.changes.extra_calls import CALLS, ExtraCalls
from gamekeeper.run.episode import Play, Played
from gamekeeper.run.handed import is_same, snapshot

SHARE: Final = 1.0
ONLY_AEC: Final = ("observe", "last")


def plays(lab: Lab) -> Iterator[Play]:
    """Long ones, each as it is, with a sham, and with the calls; all of that once more."""
    return lab.long_plays(3, runs=7, most_turns=200)


def look(lab: Lab, play: Play) -> Iterator[Saw]:
    """Plays the same actions with calls in between, all kinds at once.

    Where the play goes another way, each kind is tried alone to tell which it was.

    Twins:
        with the change `ExtraCalls`: all kinds that the environment offers, or one of them; and the
            same with `next` in the change: what the next reset in that instance, without a seed,
            came to. A draw is seen there that the rest of the play doesn't show.
    Facts:
        `offered`: the kinds of calls that were made, a list.
        `twice`: (AEC) `last()` was called twice at each turn: `looks`, and `told`: None, or reward
            and flags by both calls at the first turn at which they differed.
    """
    base = lab.play(play, state=False)
    if play.actions is None:  # policies ask for spaces, a play on paper doesn't
        base = lab.play(base.play, state=False)
    env = lab.env()
    sham = lab.play(base.play, env, state=False)
    kinds = _offered(lab, env, play)
    yield lab.fact("offered", list(kinds))
    if lab.api == "aec":
        yield _asked_twice(lab, base.play)
    twin = lab.twin(base, sham, ExtraCalls(kinds), state=False)
    if twin.noise is not None or base.failed is not None:  # it differs, or breaks off, by itself
        return
    yield twin
    if twin.divergence is not None:
        for kind in kinds:
            yield lab.twin(base, sham, ExtraCalls((kind,)), state=False)
        return
    beside = _next(lab, base, None), _next(lab, base, None)
    after = _next_twin(lab, base, beside, kinds)
    if after.noise is not None:  # resets without a seed differ by themselves
        return
    yield after
    if after.divergence is not None:
        for kind in kinds:
            yield _next_twin(lab, base, beside, (kind,))


def _next(lab: Lab, base: Played, change: Change | None) -> Trace:
    """What a reset without a seed comes to, in an instance in which the play was played."""
    env = lab.env()
    lab.play(base.play, env, change=change, state=False)
    return lab.play(Play(seed=None, actions=()), env, state=False).trace


def _next_twin(lab: Lab, base: Played, beside: tuple[Trace, Trace], kinds: tuple[str, ...]) -> Twin:
    change = ExtraCalls(kinds)
    about = {**change.to_json(), "next": len(base.play.actions or ())}
    volatile = tuple(lab.contract.volatile_infos())
    return Twin(*beside, _next(lab, base, change), about, volatile)


def _asked_twice(lab: Lab, play: Play) -> Saw:
    """Whether `last()` tells the same reward and flags when it is called again."""
    looks, told, at = 0, None, None

    def watch(turn: int, env: Any, out: Any) -> None:
        nonlocal looks, told, at
        if told is not None or not env.agents:
            return
        both = [lab.call("last", env.last).value for _ in range(2)]
        if all(isinstance(each, tuple) and len(each) == 5 for each in both):
            looks += 1
            first, second = ([snapshot(item) for item in each[1:4]] for each in both)
            if not is_same(second, first):
                told, at = (first, second), turn

    lab.play(play, watch=watch, state=False)
    return lab.fact("twice", {"looks": looks, "told": told}, turn=at, field="twice")


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
