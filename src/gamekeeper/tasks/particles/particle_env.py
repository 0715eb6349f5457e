"""One world of particles as a ParallelEnv: its pictures, and a contract that fits its arguments."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final, TypedDict

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import KernelTicks
from gamekeeper.tasks.drawing import INK, PAPER, Color, Pictured, text_of

SIDE: Final = 350
"""Side of a picture in pixels."""
REACH: Final = 0.9
"""Part of the picture that the farthest body may be away from the middle."""
BRIGHT: Final = 200
"""The brightest that a colour of pixels is."""
COLUMNS, ROWS = 41, 21
"""Letters of a picture in text."""


class ParticleArguments(TypedDict, total=False):
    """Arguments of the rules that several particle worlds share."""

    max_cycles: int
    continuous_actions: bool
    curriculum: bool
    curriculum_stage: int
    terminate_on_success: bool
    num_agent_neighbors: int | None
    num_landmark_neighbors: int | None


class ParticleTicks(Pictured, KernelTicks):
    """An environment over a kernel with the fields of `particles.bodies`.

    Args:
        radii: of agents, then of marks, in units of the plane.
        colors: likewise; `tint` may change them.
        render_mode: `ansi`, `rgb_array` or None.
        dynamic_rescaling: discs shrink in a picture as the world in it grows.
        debug: the rules run as plain Python.
    """

    snapshot_without = (*KernelTicks.snapshot_without, "colors", "contract", "policies", "radii")

    def __init__(
        self,
        kernel: Kernel,
        *,
        radii: list[float],
        colors: list[Color],
        render_mode: str | None,
        dynamic_rescaling: bool,
        debug: bool,
    ) -> None:
        super().__init__(kernel, render_mode=render_mode, debug=debug)
        self.radii, self.colors, self.dynamic_rescaling = radii, colors, dynamic_rescaling
        self.first_range = 1.0
        self.contract = fitted(type(self), kernel)

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Keeps the range of the first state, for pictures."""
        super().start(rng, options)
        self.first_range = self.camera_range()

    def places(self) -> NDArray[np.float64]:
        """Places of agents, then of marks, [bodies, 2]."""
        s = self.memory.records
        x, y = (np.concatenate([s[axis][0], s[f"mark_{axis}"][0]]) for axis in "xy")
        return np.stack([x, y], axis=1)

    def camera_range(self) -> float:
        """Distance of the farthest body from the middle, along an axis."""
        return max(float(np.abs(self.places()).max()), 1e-9)

    def tint(self) -> list[Color]:
        """Colours of agents and marks now."""
        return self.colors

    def notes(self) -> list[str]:
        """Lines under a picture in text."""
        return []

    def letters(self) -> str:
        """Plane around the middle: agents by the first letter of their names, marks as o."""
        points = self.places() / self.camera_range() * REACH
        lines = [["."] * COLUMNS for _ in range(ROWS)]
        letters = [agent[0].upper() for agent in self.possible_agents]
        letters += ["o"] * (len(points) - len(letters))
        for (x, y), letter in reversed(list(zip(points.tolist(), letters, strict=True))):
            column, row = round((x + 1) / 2 * (COLUMNS - 1)), round((1 - y) / 2 * (ROWS - 1))
            lines[row][column] = letter
        return text_of(lines, *self.notes())

    def pixels(self) -> NDArray[np.uint8]:
        """Discs with a border, marks under agents, [SIDE, SIDE, 3], red first."""
        points = self.places() / self.camera_range() * REACH
        scale = REACH * self.first_range / self.camera_range() if self.dynamic_rescaling else 1.0
        radii = [radius * scale for radius in self.radii]
        pixels: NDArray[np.uint8] = np.full((SIDE, SIDE, 3), PAPER, np.uint8)
        axis = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
        border = 2 / SIDE
        for (x, y), radius, color in reversed(list(zip(points, radii, self.tint(), strict=True))):
            far = np.sqrt((axis[None, :] - x) ** 2 + (axis[:, None] + y) ** 2)
            pixels[far <= radius + border] = INK
            pixels[far <= radius] = color
        return pixels


@cache
def _written(name: str) -> Contract:
    return Contract.load(Path(__file__).parent / name)


def fitted(kind: type[KernelTicks], kernel: Kernel) -> Contract:
    """Returns the contract beside the task, with the noops and horizon of its arguments."""
    written = _written(str(kind.contract))
    roles = dict(written.roles)
    for name, role in roles.items():
        agent = next(a for a in kernel.agents if a.startswith(name))
        space = kernel.action_of(agent)
        if isinstance(space, Box) and role.noop not in (None, "none"):
            roles[name] = replace(role, noop=(0.0,) * int(space.shape[0]))
    schedule = replace(written.schedule, horizon=kernel.horizon)
    return replace(written, roles=roles, schedule=schedule)


def shade(color: NDArray[np.float64]) -> Color:
    """Returns a colour in parts of 1 as one of pixels, as bright as mpe2 draws it."""
    red, green, blue = (np.clip(color, 0.0, 1.0) * BRIGHT).astype(int).tolist()
    return red, green, blue


def spoken(word: Any) -> str:
    """Returns a word as a letter, or as numbers; a line if nothing was said."""
    if not word.any():
        return "_"
    if np.count_nonzero(word) == 1 and word.max() == 1.0:
        return chr(ord("A") + int(word.argmax()))
    return " ".join(f"{part:.2f}" for part in word)
