"""Probe of calls that only look, made more often."""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from gamekeeper.auditing.probe import probe
from gamekeeper.auditing.probe_session import ProbeSession, Saw
from gamekeeper.checks.facts.handed_facts import OfferedCalls, RepeatedLast
from gamekeeper.checks.probe_evidence import ProbeCounterfactual
from gamekeeper.episodes.episode import Episode
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult
from gamekeeper.rollouts.intervention import Intervention
from gamekeeper.rollouts.interventions.environment_calls import CALLS, ExtraCalls
from gamekeeper.rollouts.snapshots import is_same, snapshot

ONLY_AEC: Final = ("observe", "last")
RESETS: Final = 12
"""Resets without a seed that must agree before one of them is compared with another episode."""


@probe(
    "extra_calls", share=1.0, plays=lambda session: session.long_plays(6, runs=7, most_turns=200)
)
def extra_calls(session: ProbeSession, play: EpisodePlan) -> Iterator[Saw]:
    """Calls that should only read, made more often: does the episode change?

    Plays the same actions with calls in between, all kinds at once.

    Where the episode goes another way, each kind is tried alone to tell which it was.

    Counterfactuals:
        with the change `ExtraCalls`: all kinds that the environment offers, or one of them; and the
            same with `next` in the change: what the next reset in that instance, without a seed,
            came to. A draw is seen there that the rest of the episode doesn't show.
    Facts:
        `OfferedCalls`, `RepeatedLast`.
    """
    base = session.play(play, state=False)
    if play.actions is None:  # policies ask for spaces, a scripted play doesn't
        base = session.play(base.play, state=False)
    env = session.env()
    unchanged_rerun = session.play(base.play, env, state=False)
    kinds = _offered(session, env, play)
    yield session.fact(OfferedCalls(list(kinds)))
    if session.api == "aec":
        yield _asked_twice(session, base.play)
    counterfactual = session.counterfactual(base, unchanged_rerun, ExtraCalls(kinds), state=False)
    if (
        counterfactual.noise is not None or base.failed is not None
    ):  # it differs, or breaks off, by itself
        return
    yield counterfactual
    if counterfactual.divergence is not None:
        for kind in kinds:
            yield session.counterfactual(base, unchanged_rerun, ExtraCalls((kind,)), state=False)
        return
    if _resets_differ(session, base.play):
        return
    beside = _next(session, base, None), _next(session, base, None)
    after = _next_counterfactual(session, base, beside, kinds)
    if after.noise is not None:  # resets without a seed differ by themselves
        return
    yield after
    if after.divergence is not None:
        for kind in kinds:
            yield _next_counterfactual(session, base, beside, (kind,))


def _resets_differ(session: ProbeSession, play: EpisodePlan) -> bool:
    """Tells whether resets without a seed draw from the system, so that each is another.

    Where few openings are possible, two of them agree by chance: several are compared.
    """
    openings: list[Episode] = []
    for _ in range(RESETS):
        env = session.env()
        session.play(replace(play, actions=()), env, state=False)
        openings.append(session.play(EpisodePlan(seed=None, actions=()), env, state=False).episode)
    return any(session.divergence(openings[0], other) is not None for other in openings[1:])


def _next(session: ProbeSession, base: EpisodeResult, change: Intervention | None) -> Episode:
    """Episode after a reset without a seed, in an instance that played one before."""
    env = session.env()
    session.play(base.play, env, change=change, state=False)
    return session.play(EpisodePlan(seed=None, actions=()), env, state=False).episode


def _next_counterfactual(
    session: ProbeSession,
    base: EpisodeResult,
    beside: tuple[Episode, Episode],
    kinds: tuple[str, ...],
) -> ProbeCounterfactual:
    change = ExtraCalls(kinds)
    about = {**change.to_json(), "next": len(base.play.actions or ())}
    return session.beside(*beside, _next(session, base, change), about)


def _asked_twice(session: ProbeSession, play: EpisodePlan) -> Saw:
    """Tells whether `last()` gives the same reward and flags when it is called again."""
    looks, told, at = 0, None, None

    def watch(turn: int, env: Any, out: Any) -> None:
        nonlocal looks, told, at
        if told is not None or not env.agents:
            return
        both = [session.call("last", env.last).value for _ in range(2)]
        if all(isinstance(each, tuple) and len(each) == 5 for each in both):
            looks += 1
            first, second = ([snapshot(item) for item in each[1:4]] for each in both)
            if not is_same(second, first):
                told, at = (first, second), turn

    session.play(play, watch=watch, state=False)
    return session.fact(RepeatedLast(looks=looks, told=told), turn=at, field="twice")


def _offered(session: ProbeSession, env: Any, play: EpisodePlan) -> tuple[str, ...]:
    """The kinds of calls that this environment answers after a reset; it isn't played on."""
    if session.call("reset", env.reset, seed=play.seed).failed is not None:
        return ()
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for kind, call in CALLS.items():
            opens_window = kind == "render" and getattr(env, "render_mode", None) == "human"
            if (kind in ONLY_AEC and session.api != "aec") or opens_window:
                continue
            if session.call(kind, call, env).failed is None:
                found.append(kind)
    return tuple(found)
