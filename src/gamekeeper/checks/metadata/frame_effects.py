"""Checks of rendering: it changes nothing, and shows the present turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.render_facts import (
    BuiltMode,
    FilmedPlay,
    FirstFrame,
    SecondFrame,
    Shot,
)
from gamekeeper.checks.metadata.frame_values import course_lines, film_proof, nothing_to_film
from gamekeeper.checks.paired_plays import counterfactual_cases
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.contract import Contract

RENDERING_LINES = (
    "assert course(make(), film=True) == course(make(), film=False), 'render() changed the game'"
)


@check(
    "GK805",
    needs=("render",),
    severity=HIGH,
    fix="draw from the game's state without changing it; what is random in a picture needs a "
    "generator of its own",
    applies=nothing_to_film,
)
def rendering_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """render() doesn't change the game, nor draw from its generator: a filmed play goes like an unfilmed one.

    Otherwise a recorded run can't be compared with one that was trained without a camera. The same
    actions from the same seed are played in the same mode, rendered at every turn and never.

    Bad:
        def render(self):
            shade = self.rng.integers(256)

    Good:
        def render(self):
            shade = self.picture_rng.integers(256)
    """  # noqa: E501  # the claim is one line
    for counterfactual in evidence.counterfactuals("render"):
        if counterfactual.change["change"] == "Rendered":
            proof = Reproducer(
                course_lines(evidence.api) + RENDERING_LINES,
                plays=False,
                options=_options(evidence, counterfactual.change),
                compares=True,
            )
            yield from counterfactual_cases(counterfactual, "the play without a camera", proof)


def _options(evidence: ProbeEvidence, change: object) -> dict[str, str]:
    mode = change["mode"]  # type: ignore[index]  # plain data of a change
    for fact in evidence.facts(BuiltMode):
        if fact.value.mode == mode:
            return dict(fact.value.options)
    return {"render_mode": mode}


MODE_LINES = (
    "assert course(make(), film=False) == course(plain(), film=False), 'the mode is another game'"
)


@check(
    "GK806",
    needs=("render",),
    severity=HIGH,
    fix="let render_mode decide about pictures alone",
    applies=nothing_to_film,
)
def mode_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The render mode doesn't change the game: equal seeds and actions give the same play in every mode.

    A policy that was trained without pictures would otherwise be shown, and judged, in another game.

    Bad:
        if self.render_mode is not None:
            self.rng = np.random.default_rng(0)   # nicer videos

    Good:
        self.rng = np.random.default_rng(seed)
    """  # noqa: E501  # the claim is one line
    for counterfactual in evidence.counterfactuals("render"):
        if counterfactual.change["change"] == "RenderMode":
            options = {"render_mode": counterfactual.change["mode"]}
            proof = Reproducer(
                course_lines(evidence.api) + MODE_LINES, plays=False, options=options, compares=True
            )
            yield from counterfactual_cases(counterfactual, "the play in the usual mode", proof)


@check(
    "GK807",
    needs=("render",),
    severity=LOW,
    fix="self.render_mode = render_mode",
    applies=nothing_to_film,
)
def mode_is_told(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """env.render_mode is the mode that was asked for.

    Wrappers and recorders read it to know what render() returns.

    Bad:
        def __init__(self, render_mode=None):
            self.mode = render_mode

    Good:
        def __init__(self, render_mode=None):
            self.render_mode = render_mode
    """
    for fact in evidence.facts(BuiltMode):
        seen = fact.value
        if seen.taken and seen.failed is None:
            mode = seen.mode
            proof = Reproducer(
                f"mode = getattr(make(), 'render_mode', None)\nassert mode == {mode!r}, mode",
                plays=False,
                options=seen.options,
            )
            yield Case(fact.where, seen.shown == mode, mode, seen.shown, proof=proof)


LATE = (
    "env = make()\nenv.reset(seed=SEED)\nfor action in ACTIONS:\n{step}"
    "assert np.array_equal(frames[-1], env.render()), 'an older frame is shown'"
)
AGAIN = (
    "env.reset(seed=SEED)\n"
    "assert np.array_equal(frames[0], env.render()), 'a frame of the episode before is shown'"
)


@check(
    "GK808",
    needs=("render",),
    severity=MEDIUM,
    fix="draw when render() is called, or forget what was drawn in step() and in reset()",
    applies=nothing_to_film,
)
def frames_show_now(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A frame shows the game as it stands, not an older moment that was drawn and kept.

    A frame counts as old where an instance that was never rendered before shows another at the very
    same moment, and it equals the first one of its play, or what such an instance shows a turn
    earlier, or at the turn since which the film has shown the same; or where, after a second reset,
    it equals the last one of the episode before. So trails and animations are no fault.

    Bad:
        if self.frame is None:
            self.frame = self.draw()
        return self.frame

    Good:
        return self.draw()
    """
    step = "    env.step(action)\n"
    step = step if evidence.api == "parallel" else f"    env.last()\n{step}"
    films = {_key(fact): fact.value.shots for fact in evidence.facts(FilmedPlay)}
    fresh = {
        (*_key(fact), fact.value.turn): fact.value.digest for fact in evidence.facts(FirstFrame)
    }
    taken: list[Fact[FirstFrame] | Fact[SecondFrame]] = [
        *evidence.facts(FirstFrame),
        *evidence.facts(SecondFrame),
    ]
    for fact in sorted(taken, key=lambda each: each.where.play):
        shots, digest = films.get(_key(fact), []), fact.value.digest
        turn = fact.value.turn if isinstance(fact.value, FirstFrame) else 0
        shot = _shown(shots, turn)
        if shot is None or digest is None:
            continue
        if isinstance(fact.value, FirstFrame):
            earlier = (fresh.get((*_key(fact), t)) for t in (turn - 1, _since(shots, turn)))
            is_old = shot in (shots[0].digest, *earlier)
            where, seen = replace(fact.where, turn=turn, field="late"), "an earlier frame"
        else:
            is_old = digest == shots[-1].digest
            where, seen = replace(fact.where, field="again"), "the last frame of the episode before"
        is_ok = not (is_old and shot != digest)
        lines = LATE.format(step=step) if isinstance(fact.value, FirstFrame) else AGAIN
        proof = film_proof(evidence.api, fact.value.options, lines)
        told = "a frame of this moment"
        yield Case(where, is_ok, told, told if is_ok else seen, proof=proof)


def _shown(shots: Sequence[Shot], turn: int) -> str | None:
    """The digest of a film's frame at this turn."""
    return next((shot.digest for shot in shots if shot.turn == turn), None)


def _since(shots: Sequence[Shot], turn: int) -> int:
    """The first of the turns in a row, this one the last, at which the film shows the same."""
    while turn and _shown(shots, turn - 1) == _shown(shots, turn):
        turn -= 1
    return turn


def _key(fact: Fact[FilmedPlay] | Fact[FirstFrame] | Fact[SecondFrame]) -> tuple[int, str]:
    return fact.where.play, fact.value.mode
