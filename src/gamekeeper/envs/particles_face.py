"""One world of particles as a ParallelEnv: its pictures, and a contract that fits its arguments."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from gamekeeper.core.contract import Contract
from gamekeeper.envs.drawing import INK, PAPER, Color
from gamekeeper.game.contract_file import load_contract
from gamekeeper.kernels.faces import KernelTicks
from gamekeeper.kernels.kernel import Kernel

SIDE: Final = 350
"""Side of a picture in pixels."""
REACH: Final = 0.9
"""Part of the picture that the farthest body may be away from the middle."""
BRIGHT: Final = 200
"""The brightest that a colour of pixels is."""
COLUMNS, ROWS = 41, 21
"""Letters of a picture in text."""


class ParticleTicks(KernelTicks):
    """A face of a kernel with the fields of `particles.bodies`.

    Args:
        kernel: whose rules.
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
        """Keeps how far the first state reaches, for pictures."""
        super().start(rng, options)
        self.first_range = self.camera_range()

    def places(self) -> NDArray[np.float64]:
        """Where agents are, then marks, [bodies, 2]."""
        s = self.bench.records
        x, y = (np.concatenate([s[axis][0], s[f"mark_{axis}"][0]]) for axis in "xy")
        return np.stack([x, y], axis=1)

    def camera_range(self) -> float:
        """How far from the middle the farthest body is, along an axis."""
        return max(float(np.abs(self.places()).max()), 1e-9)

    def tint(self) -> list[Color]:
        """The colours of agents and marks now."""
        return self.colors

    def notes(self) -> list[str]:
        """What stands under a picture in text."""
        return []

    def render(self) -> str | NDArray[np.uint8] | None:
        """The plane around the middle as text, or as a picture of [SIDE, SIDE, 3]."""
        if self.render_mode is None:
            return None
        points = self.places() / self.camera_range() * REACH
        if self.render_mode == "ansi":
            return "\n".join([*lettered(points, self.possible_agents), *self.notes()])
        scale = REACH * self.first_range / self.camera_range() if self.dynamic_rescaling else 1.0
        return drawn(points, [radius * scale for radius in self.radii], self.tint())


def lettered(points: NDArray[np.float64], agents: list[str]) -> list[str]:
    """Lines of letters: agents by the first letter of their names, marks as o.

    Args:
        points: [bodies, 2] in [-1, 1], agents first.
        agents: their names.
    """
    lines = [["."] * COLUMNS for _ in range(ROWS)]
    letters = [agent[0].upper() for agent in agents] + ["o"] * (len(points) - len(agents))
    for (x, y), letter in reversed(list(zip(points.tolist(), letters, strict=True))):
        column, row = round((x + 1) / 2 * (COLUMNS - 1)), round((1 - y) / 2 * (ROWS - 1))
        lines[row][column] = letter
    return ["".join(line) for line in lines]


def drawn(
    points: NDArray[np.float64], radii: list[float], colors: list[Color]
) -> NDArray[np.uint8]:
    """Discs with a border, marks under agents, [SIDE, SIDE, 3], red first.

    Args:
        points: [bodies, 2] in [-1, 1].
        radii: in the same units.
        colors: of each body.
    """
    pixels: NDArray[np.uint8] = np.full((SIDE, SIDE, 3), PAPER, np.uint8)
    axis = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    border = 2 / SIDE
    for (x, y), radius, color in reversed(list(zip(points, radii, colors, strict=True))):
        far = np.sqrt((axis[None, :] - x) ** 2 + (axis[:, None] + y) ** 2)
        pixels[far <= radius + border] = INK
        pixels[far <= radius] = color
    return pixels


@cache
def _written(name: str) -> Contract:
    return load_contract(Path(__file__).parent / name)


def fitted(kind: type[KernelTicks], kernel: Kernel) -> Contract:
    """The contract beside the task, with the noops and the horizon that its arguments make.

    Args:
        kind: the class of the task, which names the contract.
        kernel: its rules.
    """
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
    """A colour in parts of 1 as one of pixels, as bright as mpe2 draws it."""
    red, green, blue = (np.clip(color, 0.0, 1.0) * BRIGHT).astype(int).tolist()
    return red, green, blue


def spoken(word: Any) -> str:
    """A word as a letter, or as numbers; nothing: a line."""
    if not word.any():
        return "_"
    if np.count_nonzero(word) == 1 and word.max() == 1.0:
        return chr(ord("A") + int(word.argmax()))
    return " ".join(f"{part:.2f}" for part in word)
