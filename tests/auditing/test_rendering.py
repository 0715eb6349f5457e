"""Edge cases of rendering and metadata that the matrix doesn't show."""

import asyncio
import os
from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.human_mode import SCREENS
from gamekeeper.auditing.result import AuditResult
from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


def audited(spec: Any, *select: str) -> AuditResult:
    """A small audit of these checks."""
    return audit_here(spec, select=select, budget=200)


class FramesRaise(Rovers):
    """Can't draw a rover that is gone, nor anything once all are."""

    def render(self) -> Any:
        if not self.agents:
            raise RuntimeError("the window is closed")
        return super().render()


class NeedsScreen(Rovers):
    """Can't be built where there is no screen."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        if render_mode is not None:
            raise RuntimeError("cannot connect to display None")


class Human(Rovers):
    """Says that it has a window."""

    metadata = {**Rovers.metadata, "render_modes": ["human"]}  # noqa: RUF012  # as PettingZoo has it

    def render(self) -> Any:
        """Shows something, and gives nothing."""
        return


class HumanRefused(Human):
    """Its constructor knows no window."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        if render_mode == "human":
            raise NotImplementedError("to come")


class HumanLeftOut(Human):
    """It has none."""

    def render(self) -> Any:
        """Is to come."""
        raise NotImplementedError("to come")


class HumanNeedsScreen(Human):
    """Has a window where there is a screen."""

    def render(self) -> Any:
        """Looks for it."""
        raise RuntimeError("; ".join(os.environ.get(name, "no screen") for name in SCREENS))


class HumanOfLibrary(Human):
    """Draws by a library that can do nothing without a screen."""

    def render(self) -> Any:
        """Asks for it."""
        asyncio.AbstractEventLoop().stop()  # raises NotImplementedError there


class Listed(Traders):
    """Gives the frames since the last call."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Traders.metadata,
        "render_modes": ["rgb_array_list"],
    }

    def render(self) -> Any:
        frame = super().render()
        return None if frame is None else [frame]


class Transposed(Rovers):
    """Channels first."""

    def render(self) -> Any:
        frame = super().render()
        return None if frame is None else np.moveaxis(frame, -1, 0).copy()


class ReadOnly(Rovers):
    """Frames nobody may write into, each an array of its own."""

    def render(self) -> Any:
        frame = super().render()
        if frame is not None:
            frame.flags.writeable = False
        return frame


class Trails(Rovers):
    """Draws onto what was drawn before, and hands out copies."""

    canvas: Any = None

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.canvas = None
        return super().reset(seed, options)

    def render(self) -> Any:
        frame = super().render()
        if frame is not None:
            self.canvas = frame if self.canvas is None else np.maximum(self.canvas, frame)
            frame = self.canvas.copy()
        return frame


def no_modes() -> Rovers:
    """A factory that takes no mode."""
    return Rovers()


def test_frames_after_the_end_may_be_refused() -> None:
    """What render() does once the episode is over isn't judged."""
    assert audited(FramesRaise, "GK802").of("GK802").outcome == "passed"


def test_modes_without_a_screen_are_no_fault() -> None:
    """Where a screen is missing, nothing could be seen."""
    assert audited(NeedsScreen, "GK801").of("GK801").outcome == "not_exercised"


def test_modes_that_no_argument_chooses_are_not_applicable() -> None:
    """A factory that takes no render_mode has nothing to be filmed."""
    found = audited(no_modes, "GK80")
    assert {"not_applicable"} == {verdict.outcome for verdict in found.verdicts}


def test_modes_of_a_silent_environment_are_not_applicable() -> None:
    """Without declared modes nothing is promised."""
    assert audited(Tokens, "GK802").of("GK802").outcome == "not_applicable"


def test_frames_may_come_in_lists() -> None:
    """The mode rgb_array_list promises a list of frames."""
    assert audited(Listed, "GK802").of("GK802").outcome == "passed"


def test_frames_with_channels_first_are_broken() -> None:
    """[3, height, width] is no picture."""
    assert audited(Transposed, "GK802").of("GK802").outcome == "failed"


@pytest.mark.parametrize("kind", [ReadOnly, Trails])
def test_frames_of_unusual_habits_are_legal(kind: type[Rovers]) -> None:
    """Frames may be closed to writing, and may show where somebody was."""
    assert audited(kind, "GK80").failed == ()


def test_rendering_of_an_object_is_filmed_in_its_own_mode() -> None:
    """Where only an object is there, its own mode is looked at."""
    found = audited(Rovers(render_mode="rgb_array"), "GK80")
    assert {"GK802", "GK804", "GK805"} <= {v.id for v in found.verdicts if v.outcome == "passed"}


def test_a_mode_that_metadata_does_not_list_promises_nothing() -> None:
    """A class that takes any mode is told that the one in use isn't listed, and nothing else."""

    class OnScreen(Rovers):
        metadata = {**Rovers.metadata, "render_modes": ["human"]}  # noqa: RUF012  # as Gymnasium's

        def render(self) -> Any:
            raise AttributeError("window")

    found = audited(OnScreen(render_mode="rgb_array"), "GK8")
    assert found.of("GK822").outcome == "failed"
    assert found.of("GK802").outcome == "not_exercised"


def test_rendering_leaves_the_surroundings_as_they_were() -> None:
    """The driver without a screen is set for the films alone."""
    before = dict(os.environ)
    audited(Rovers, "GK802")
    assert before == dict(os.environ)


def test_metadata_of_another_kind_is_named() -> None:
    """Metadata that is no dictionary has no name, and stops no check."""

    class Nonconforming(Rovers):
        metadata = None  # type: ignore[assignment]

    found = audited(Nonconforming, "GK82")
    assert found.of("GK821").outcome == "failed"
    assert [verdict.id for verdict in found.verdicts if verdict.outcome == "error"] == []


@pytest.mark.parametrize("rate", [0, -1, "10", True, float("nan")])
def test_metadata_rates_that_are_none_are_broken(rate: Any) -> None:
    """A rate is a number above 0."""

    class Rated(Rovers):
        metadata = {**Rovers.metadata, "render_fps": rate}  # noqa: RUF012  # as PettingZoo has it

    assert audited(Rated, "GK823").of("GK823").outcome == "failed"


@pytest.mark.parametrize(
    ("game", "actual"),
    [
        ("Human", None),
        ("HumanNeedsScreen", None),
        ("HumanOfLibrary", None),
        ("HumanRefused", "NotImplementedError: to come"),
        ("HumanLeftOut", "NotImplementedError: to come"),
    ],
)
def test_window_that_is_not_implemented_is_told(game: str, actual: str | None) -> None:
    """By the environment's own line alone; what else is raised without a screen tells nothing."""
    found = audited(f"{__name__}:{game}", "GK801")
    assert [each.findings[0].actual for each in found.failed] == ([actual] if actual else [])
