"""Rendering."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.faults import faulty
from tests.faults.rovers import SIZE, Rovers
from tests.faults.traders import Traders


@faulty("GK801")
class RefusesAnsi(Rovers):
    """A mode is declared that the constructor refuses.

    Declares text, and has pictures only.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Rovers.metadata,
        "render_modes": ["rgb_array", "ansi"],
    }

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"there is no mode {render_mode!r}")


@faulty("GK802")
class FloatFrame(Rovers):
    """Frames are floats in [0, 1].

    A picture as matplotlib likes it.
    """

    def render(self) -> Any:
        """Scaled to 1."""
        frame = super().render()
        return None if frame is None else frame / 255.0


@faulty("GK802")
class NoFrame(Traders):
    """render() draws, and forgets to return what it drew.

    Shows its picture to nobody.
    """

    def render(self) -> Any:
        """Draws in vain."""
        super().render()


@faulty("GK802")
class NoSuchPicture(Rovers):
    """A mode of its own is listed, and render() knows nothing of it.

    The map is to come.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        **Rovers.metadata,
        "render_modes": ["rgb_array", "map"],
    }

    def render(self) -> Any:
        """The picture, or what isn't written yet."""
        if self.render_mode == "map":
            raise NotImplementedError(self.render_mode)
        return super().render()


@faulty("GK803")
class ShrinkingFrame(Rovers):
    """The picture has a column for each live rover, and so becomes narrower.

    A bar for each battery.
    """

    def render(self) -> Any:
        """As wide as there are rovers left."""
        if self.render_mode is None:
            return None
        frame = np.zeros((32, 8 * max(len(self.agents), 1), 3), np.uint8)
        for place, agent in enumerate(self.agents):
            frame[32 - max(self.battery[agent], 0) :, 8 * place : 8 * place + 6] = 200
        return frame


@faulty("GK804")
class OneCanvas(Rovers):
    """Every frame is the same array, drawn over.

    Saves an allocation.
    """

    canvas: Any = None

    def render(self) -> Any:
        """Draws over what it gave before."""
        frame = super().render()
        if frame is None or self.canvas is None:
            self.canvas = frame
            return frame
        self.canvas[...] = frame
        return self.canvas


@faulty("GK804")
class SharedGround(Traders):
    """The frame is the background itself as long as nothing stands on it.

    Keeps one picture for each number of rounds, and hands it out.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.pictures = [np.full((8, 8, 3), 20 * k, np.uint8) for k in range(self.rounds + 1)]

    def render(self) -> Any:
        """The picture of this round, not a copy of it."""
        return None if self.render_mode is None else self.pictures[self.round]


@faulty("GK805")
class DrawnShade(Rovers):
    """render() draws its colours from the generator of the wind.

    Nicer pictures.
    """

    def render(self) -> Any:
        """With some noise."""
        frame = super().render()
        if frame is not None:
            frame[0, 0] = self.rng.integers(256)
        return frame


@faulty("GK806")
class SlowerForViewers(Rovers):
    """With pictures, batteries last longer.

    Videos should show something.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Charges a little more where somebody looks on."""
        super().reset(seed, options)
        if self.render_mode is not None:
            self.battery = {agent: self.battery[agent] + 5 for agent in self.agents}
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}

    def observation(self, agent: str) -> Any:
        """Within the space, however full the battery is."""
        return super().observation(agent).clip(0, 1)


@faulty("GK807")
class ModeUntold(Rovers):
    """The mode that was asked for is kept under another name.

    Renders, and doesn't say how.
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=None)
        self.mode = render_mode

    def render(self) -> Any:
        """As the mode says."""
        self.render_mode, told = self.mode, self.render_mode
        frame = super().render()
        self.render_mode = told
        return frame


@faulty("GK808")
class AFrameBehind(Rovers):
    """render() hands out the frame that was drawn at the call before.

    Two buffers, swapped too late.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Both buffers are empty."""
        self.back: Any = None
        return super().reset(seed, options)

    def render(self) -> Any:
        """What was drawn before."""
        frame = super().render()
        shown, self.back = self.back, frame
        return frame if shown is None else shown


@faulty("GK808")
class FrameOfLastEpisode(Rovers):
    """Frames are kept by the tick, and outlive the reset.

    Draws after steps only.
    """

    frame: Any = None

    def step(self, actions: dict[str, Any]) -> Any:
        """Something is to be drawn."""
        out = super().step(actions)
        self.frame = None
        return out

    def render(self) -> Any:
        """Draws where a step was made since."""
        if self.frame is None:
            self.frame = super().render()
        return None if self.frame is None else self.frame.copy()


# What is kept doesn't move.
@faulty("GK808", also=("GK809",))
class KeptFrame(Rovers):
    """The first frame of an episode is drawn, and shown until its end.

    Draws once.
    """

    frame: Any = None

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Forgets the frame."""
        self.frame = None
        return super().reset(seed, options)

    def render(self) -> Any:
        """A copy of the frame that was drawn first."""
        if self.frame is None:
            self.frame = super().render()
        return None if self.frame is None else self.frame.copy()


@faulty("GK809")
class StillPicture(Rovers):
    """The picture shows where the rovers were at the reset.

    Draws the places of the start.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Notes the places."""
        out = super().reset(seed, options)
        self.start = [tuple(cell) for cell in self.cells.values()]
        return out

    def render(self) -> Any:
        """A pixel for each place."""
        if self.render_mode is None:
            return None
        frame = np.zeros((SIZE, SIZE, 3), np.uint8)
        for row, column in self.start:
            frame[row, column] = 220
        return frame
