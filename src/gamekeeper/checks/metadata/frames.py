"""Checks of render modes, of their frames, and of what rendering changes."""

from collections.abc import Mapping
from dataclasses import replace
from textwrap import indent
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, LOW, MEDIUM, Case, Cases, check
from gamekeeper.checks.facts.render_facts import (
    BuiltMode,
    ChangedFrames,
    FirstFrame,
    RenderedEpisode,
    SecondFrame,
    Shot,
    WrittenFrames,
)
from gamekeeper.checks.facts.surface_facts import Metadata
from gamekeeper.checks.paired_episodes import counterfactual_cases
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import (
    frames_have_one_shape,
    frames_have_their_form,
    frames_stay,
    written_frames_are_gone,
)
from gamekeeper.checks.reproducers import frames_move as moving_frames
from gamekeeper.contract import Contract


def nothing_to_film(contract: Contract, evidence: ProbeEvidence) -> str | None:
    """Reason why there are no frames to judge; None where there are, or where none was tried."""
    modes = [fact.value for fact in evidence.facts(BuiltMode)]
    if not evidence.looks.get("render") or any(mode.taken for mode in modes):
        return None
    if modes:
        return "its factory takes no render_mode"
    return "it declares no render mode but perhaps 'human', which needs a screen"


def film_proof(api: str, options: Mapping[str, Any], lines: str) -> Reproducer:
    """A proof that renders at every turn of the episode into `frames`, and ends with `lines`."""
    play = (
        "env = make()\nenv.reset(seed=SEED)\nframes = [env.render()]\n"
        f"for action in ACTIONS:\n{_step(api)}    frames.append(env.render())\n"
    )
    return Reproducer(play + lines, plays=False, options=options)


def course_lines(api: str) -> str:
    """Lines of a function `played(env, render)`: all that an episode gives, filmed or not."""
    if api == "parallel":
        step, after = "told.append(env.step(action))", ""
    else:
        step = "told.append(env.last())\n    env.step(action)"
        after = "if render:\n    env.render()\ntold += [env.last()] if env.agents else []\n"
    body = (
        "told = [env.reset(seed=SEED)]\n"
        f"for action in ACTIONS:\n    if render:\n        env.render()\n    {step}\n"
        f"{after}return repr(told)\n"
    )
    head = "np.set_printoptions(threshold=10**9, precision=17)\n"
    return f"{head}def played(env, render):\n{indent(body, '    ')}"


def _step(api: str) -> str:
    return (
        "    env.step(action)\n" if api == "parallel" else "    env.last()\n    env.step(action)\n"
    )


HUMAN_LINES = """\
for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_RUNTIME_DIR"):  # nothing is shown
    os.environ.pop(name, None)
os.environ["SDL_VIDEODRIVER"] = "dummy"
env = make()
env.reset(seed=SEED)
env.render()"""


@check("GK801", MEDIUM, "render", applies=nothing_to_film)
def modes_can_be_built(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every render mode that the metadata declares can be built, and none is left unimplemented.

    Readers choose a mode from `metadata["render_modes"]`; tools that record videos do so unasked.
    Of "human", which needs a screen, only a NotImplementedError counts, in a process that has none
    (on Linux). A mode whose screen or package is missing here isn't judged.

    Source: PettingZoo's `render_test`, which renders in each of them.

    Bad:
        metadata = {"render_modes": ["rgb_array", "ansi"]}

        def __init__(self, render_mode=None):
            assert render_mode in (None, "rgb_array")

    Good:
        metadata = {"render_modes": ["rgb_array"]}

    Fix: build the environment in every mode of metadata['render_modes'], or take out those that it
    doesn't have
    """
    for fact in evidence.facts(BuiltMode):
        seen = fact.value
        if seen.taken and not seen.is_missing:
            failed = seen.failed
            expected = f"an environment in mode {seen.mode!r}"
            proof = Reproducer("make()", plays=False, options=seen.options)
            if seen.mode == "human":
                proof = replace(proof, lines=HUMAN_LINES, imports=("os",))
            yield Case(fact.where, failed is None, expected, failed or "an environment", proof)


PROMISED: Final = {
    "rgb_array": "a numpy.ndarray of uint8, [height, width, 3]",
    "ansi": "a str",
    "rgb_array_list": "a list of numpy.ndarrays of uint8, [height, width, 3]",
    "ansi_list": "a list of str",
}


@check("GK802", MEDIUM, "render", "metadata", applies=nothing_to_film)
def frames_are_as_promised(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """render() returns what its mode promises: uint8 [height, width, 3] for "rgb_array", a str for "ansi".

    Floats, None, a transposed or an empty picture, or an exception stop whoever writes a video, or
    give a black one. Of a mode that PettingZoo doesn't name only an exception counts. What it does
    once the episode is over isn't judged, nor a mode in use that isn't in the list of
    `metadata["render_modes"]`: GK822 says so.

    Source: PettingZoo's `render_test`; `AECEnv.render`.

    Bad:
        return frame / 255.0

    Good:
        return frame.astype(np.uint8)

    Fix: return uint8 in [0, 255] of shape [height, width, 3] in mode 'rgb_array' ((frame *
    255).astype(np.uint8) for floats in [0, 1]), a str in mode 'ansi'
    """  # noqa: E501  # the claim is one line
    lists = [fact.value.fields.get("render_modes") for fact in evidence.facts(Metadata)]
    listed = [mode for modes in lists if isinstance(modes, list | tuple) for mode in modes]
    for fact in evidence.facts(RenderedEpisode):
        mode = fact.value.mode
        if listed and mode not in listed:
            continue
        proof = reproducer_of(frames_have_their_form, options=fact.value.options, mode=mode)
        for shot in fact.value.shots:
            failed = shot.failed
            if failed is not None and (shot.over or shot.is_missing):
                continue
            if shot.over and shot.kind == "NoneType":
                continue
            where = replace(fact.where, turn=shot.turn, field="render")
            seen = f"it raised {failed}" if failed else _words(shot)
            promised = PROMISED.get(mode, "no exception")
            yield Case(where, _is_right(mode, shot), promised, seen, proof=proof)


def _is_right(mode: str, shot: Shot) -> bool:
    if shot.failed is not None or mode not in PROMISED:
        return shot.failed is None
    if mode == "ansi":
        return bool(shot.kind == "str")
    if mode.endswith("_list") and shot.kind != "list":
        return False
    if mode == "ansi_list":
        return True
    pictures = shot.frames
    right = all(d == "uint8" and len(s) == 3 and s[2] == 3 and 0 not in s for d, s in pictures)
    is_array = len(pictures) == 1 and shot.kind not in ("list", "tuple")
    return right and (mode == "rgb_array_list" or is_array)


def _words(shot: Shot) -> str:
    pictures = [f"{dtype}, {shape}" for dtype, shape in shot.frames[:1]]
    return " of ".join([f"a {shot.kind}", *pictures])


@check(
    "GK803",
    MEDIUM,
    "render",
    applies=nothing_to_film,
    looks_at="two pictures (rgb_array) of one episode",
)
def frames_keep_their_shape(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """All frames of an episode have one shape.

    A video has one size: writers refuse the first frame of another, or the whole video is lost.

    Bad:
        frame = np.zeros((8, 8 * len(self.agents), 3), np.uint8)

    Good:
        frame = np.zeros((8, 8 * len(self.possible_agents), 3), np.uint8)

    Fix: draw on a canvas of one size, whoever is still alive
    """
    for fact in evidence.facts(RenderedEpisode):
        if fact.value.mode != "rgb_array":
            continue
        proof = reproducer_of(frames_have_one_shape, options=fact.value.options)
        pictures = [shot for shot in fact.value.shots if len(shot.frames) == 1]
        for shot in pictures[1:]:
            first, shape = pictures[0].frames[0][1], shot.frames[0][1]
            yield Case(
                replace(fact.where, turn=shot.turn), shape == first, first, shape, proof=proof
            )


@check(
    "GK804",
    MEDIUM,
    "render",
    applies=nothing_to_film,
    looks_at="frames that could change later, such as pictures (rgb_array)",
)
def frames_stay_as_they_were(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A frame is its reader's own: it doesn't change later, and writing into it shows in no other.

    Frames that are collected for a video would otherwise all show the last moment, and a caption
    that is drawn into one stays in all that follow.

    Bad:
        self.canvas[...] = 0
        ...
        return self.canvas

    Good:
        return self.canvas.copy()

    Fix: return a new array from every render(): self.canvas.copy()
    """
    for fact in evidence.facts(ChangedFrames):
        count, turns = fact.value.count, fact.value.turns
        if count > 1:
            where = replace(fact.where, turn=turns[0] + 1 if turns else None, field="render")
            expected = "every frame as it was handed out"
            seen = f"{len(turns)} of {count} frames changed later"
            proof = reproducer_of(frames_stay, options=fact.value.options)
            yield Case(where, not turns, expected, seen, proof)
    for written in evidence.facts(WrittenFrames):
        count, turns = written.value.count, written.value.turns
        if count:
            where = replace(written.where, turn=turns[0] if turns else None, field="frame")
            seen = f"what was written into {len(turns)} of {count} frames stands in the next"
            proof = reproducer_of(written_frames_are_gone, options=written.value.options)
            yield Case(where, not turns, "the next frame as it would have been", seen, proof)


LEAST_MOVES: Final = 8
"""Turns at which observations changed, before a still picture says anything."""


@check(
    "GK809",
    LOW,
    "render",
    confidence=0.9,
    applies=nothing_to_film,
    looks_at="a film of several frames while observations change",
)
def frames_move(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Frames follow the state: while observations change over an episode, they change too.

    A video of it shows nothing. Only plays in which an agent's observation changed at eight turns
    or more are looked at; a single other frame in any play is enough.

    Bad:
        def render(self):
            return self.first_frame.copy()

    Good:
        def render(self):
            return self.draw(self.cells)

    Fix: draw the state that step() has changed
    """
    films: dict[str, list[tuple[Fact[RenderedEpisode], int]]] = {}
    for fact in evidence.facts(RenderedEpisode):
        shots = [shot.digest for shot in fact.value.shots if shot.digest is not None]
        if len(shots) > LEAST_MOVES and fact.value.moves >= LEAST_MOVES:
            films.setdefault(fact.value.mode, []).append((fact, len(set(shots))))
    for looks in films.values():
        is_ok = any(different > 1 for _, different in looks)
        fact, different = looks[0]
        where = replace(fact.where, turn=None, field="frames")
        seen = f"{different} different frame"
        proof = reproducer_of(moving_frames, options=fact.value.options)
        yield Case(where, is_ok, "frames that change as the game moves", seen, proof)


RENDERING_LINES = (
    "assert played(make(), render=True) == played(make(), render=False), "
    "'render() changed the game'"
)


@check("GK805", HIGH, "render", applies=nothing_to_film)
def rendering_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """render() doesn't change the episode, nor draw from its generator.

    Otherwise a recorded run can't be compared with one that was trained without a camera. The same
    actions from the same seed are played in the same mode, rendered at every turn and never.

    Bad:
        def render(self):
            shade = self.rng.integers(256)

    Good:
        def render(self):
            shade = self.picture_rng.integers(256)

    Fix: draw the picture from the state without changing it; what is random in a picture needs a
    generator of its own
    """  # the claim is one line
    for counterfactual in evidence.counterfactuals("render"):
        if counterfactual.change["change"] == "Rendered":
            proof = Reproducer(
                course_lines(evidence.api) + RENDERING_LINES,
                plays=False,
                options=_options(evidence, counterfactual.change["mode"]),
                compares=True,
            )
            yield from counterfactual_cases(counterfactual, "the episode without a camera", proof)


def _options(evidence: ProbeEvidence, mode: str) -> dict[str, str]:
    for fact in evidence.facts(BuiltMode):
        if fact.value.mode == mode:
            return dict(fact.value.options)
    return {"render_mode": mode}


MODE_LINES = (
    "assert played(make(), render=False) == played(plain(), render=False), "
    "'the mode is another game'"
)


@check("GK806", HIGH, "render", applies=nothing_to_film)
def mode_changes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The render mode doesn't change the episode: the same seed and actions give the same one.

    A policy that was trained without pictures would otherwise be shown, and judged, in another game.

    Bad:
        if self.render_mode is not None:
            self.rng = np.random.default_rng(0)   # nicer videos

    Good:
        self.rng = np.random.default_rng(seed)

    Fix: let render_mode decide about pictures alone
    """  # noqa: E501  # the claim is one line
    for counterfactual in evidence.counterfactuals("render"):
        if counterfactual.change["change"] == "RenderMode":
            options = {"render_mode": counterfactual.change["mode"]}
            proof = Reproducer(
                course_lines(evidence.api) + MODE_LINES, plays=False, options=options, compares=True
            )
            yield from counterfactual_cases(counterfactual, "the episode in the usual mode", proof)


@check("GK807", LOW, "render", applies=nothing_to_film)
def mode_is_told(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """env.render_mode is the mode that was asked for.

    Wrappers and recorders read it to know what render() returns.

    Bad:
        def __init__(self, render_mode=None):
            self.mode = render_mode

    Good:
        def __init__(self, render_mode=None):
            self.render_mode = render_mode

    Fix: self.render_mode = render_mode
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


@check("GK808", MEDIUM, "render", applies=nothing_to_film)
def frames_show_now(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A frame shows the current state, not an older one.

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

    Fix: draw when render() is called, or forget what was drawn in step() and in reset()
    """
    films = {_key(fact): fact.value for fact in evidence.facts(RenderedEpisode)}
    fresh = {
        (*_key(fact), fact.value.turn): fact.value.digest for fact in evidence.facts(FirstFrame)
    }
    first, second = evidence.facts(FirstFrame), evidence.facts(SecondFrame)
    taken: list[Fact[FirstFrame] | Fact[SecondFrame]] = [*first, *second]
    for fact in sorted(taken, key=lambda each: each.where.play):
        rendered, digest = films.get(_key(fact)), fact.value.digest
        turn = fact.value.turn if isinstance(fact.value, FirstFrame) else 0
        shot = None if rendered is None else rendered.shown(turn)
        if rendered is None or shot is None or digest is None:
            continue
        if isinstance(fact.value, FirstFrame):
            earlier = (fresh.get((*_key(fact), t)) for t in (turn - 1, rendered.since(turn)))
            is_old, lines = shot in (rendered.shots[0].digest, *earlier), LATE
            where, seen = replace(fact.where, turn=turn, field="late"), "an earlier frame"
        else:
            is_old, lines = digest == rendered.shots[-1].digest, AGAIN
            where, seen = replace(fact.where, field="again"), "the last frame of the episode before"
        is_ok = not (is_old and shot != digest)
        lines = lines.format(step=_step(evidence.api))
        proof = film_proof(evidence.api, fact.value.options, lines)
        told = "a frame of this moment"
        yield Case(where, is_ok, told, told if is_ok else seen, proof=proof)


def _key(fact: Fact[RenderedEpisode] | Fact[FirstFrame] | Fact[SecondFrame]) -> tuple[int, str]:
    return fact.where.play, fact.value.mode
