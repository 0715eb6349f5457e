"""Two robots on a line meet: the smallest embodied task, in which both move at once.

    R1. The line has `n` cells, 0 to n - 1. `picker` starts in cell 0, `carrier` in cell n - 1.
    R2. Each tick both move at once: action 0 one cell down, 1 nowhere, 2 one cell up. A robot at
        the end of the line that moves outwards stays where it is.
    R3. Robots that stand in one cell after a tick have met: each is paid MEETING ("meeting") and
        terminated ("met").
    R4. Robots that swap cells pass each other and haven't met.
    R5. After `horizon` ticks (HORIZON, 200, unless given) both are truncated ("horizon").

An episode is solved where the robots meet. An even number of cells is the harder kind: robots that
walk straight at each other pass in the middle.

Source: the textbook's two robots on a line (fragment 10.7.1), with observations that lie in their
spaces, and a time limit: the fragment has none, and robots that stand still never end. Of random
play on five cells one episode in two thousand million reaches the limit.
"""

from collections.abc import Mapping
from typing import Any, Final, Unpack

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import rule
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.arguments import check_whole
from gamekeeper.tasks.disturbances import DisturbedTicks
from gamekeeper.tasks.drawing import BLUE, GREEN, ORANGE, Canvas, Pictured, metadata_of
from gamekeeper.tasks.knobs import LABELS, KnobArguments, Knobs

DOWN, STAY, UP = range(3)
MEETING: Final = 1.0
"""Reward of each robot when they meet."""
AGENTS: Final = ("picker", "carrier")
MEETING_CELL: Final = 2
"""Cell where the reference policy meets: the middle of the textbook's five."""
HORIZON: Final = 200
"""Ticks of an episode, as the contract has them."""
MET: Final = 1
"""The number of the one ending."""
LAYOUT: Final = np.dtype([("last", "i8"), ("picker", "i8"), ("carrier", "i8")])
"""The line's last cell, and the cells where the robots start."""
KNOBS: Final = tuple(name for name in LABELS if name != "occlusion")
"""A robot sees its own cell alone, so there is nothing to hide from it."""


def reference(
    observation: NDArray[np.int64], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Both walk to one cell that they agreed on, and wait there; solves every length of line."""
    cell = int(observation[0])
    return UP if cell < MEETING_CELL else DOWN if cell > MEETING_CELL else STAY


def greedy(
    observation: NDArray[np.int64], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Each walks straight at the other; they meet on an odd number of cells and pass on an even."""
    return UP if agent == "picker" else DOWN


def lazy(
    observation: NDArray[np.int64], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Waits for the other to come."""
    return STAY


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Puts the robots into the layout's cells: at the two ends (R1)."""
    s.cells[0], s.cells[1] = t.picker, t.carrier


@rule
def step(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """Moves both robots; where they met, both have ended (R2 to R4)."""
    for i in range(2):
        s.cells[i] = min(max(s.cells[i] + actions[i] - 1, 0), t.last)
    if s.cells[0] == s.cells[1]:
        for i in range(2):
            rewards[i, 0] = MEETING
            terminated[i] = True
            s.ending[i] = MET


@rule
def observe(s, t, obs):  # type: ignore[no-untyped-def]  # likewise
    """Shows each robot its own cell."""
    for i in range(2):
        obs[i, 0] = s.cells[i]


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """Tells each robot's true cell."""
    for i in range(2):
        infos[i].position = s.cells[i]


@rule
def overview(s, t, state):  # type: ignore[no-untyped-def]  # likewise
    """Shows the cells of picker and carrier."""
    for i in range(2):
        state[i] = s.cells[i]


def two_robot_line_kernel(*, n: int = 5, horizon: int | None = None) -> Kernel:
    """The rules for a line of `n` cells; R5's horizon where none is given.

    Raises:
        SpecError: the line is too short.
    """
    check_whole("n", n, 2)
    return Kernel(
        name="two_robot_line_v0",
        agents=AGENTS,
        observation_space=Box(0, n - 1, (1,), np.int64),
        action_space=Discrete(3),
        state=[("cells", "i8", (2,))],
        tables=np.array([(n - 1, 0, n - 1)], LAYOUT),
        reset=reset,
        step=step,
        observe=observe,
        inform=inform,
        info=[("position", "i8")],
        overview=overview,
        state_space=Box(0, n - 1, (2,), np.int64),
        terms=("meeting",),
        endings=("met",),
        horizon=HORIZON if horizon is None else horizon,
    )


class TwoRobotLine(Pictured, DisturbedTicks):
    """Each robot sees its own cell, [1] int64 in 0 to n - 1; its info tells the true `position`.

    Args:
        n: cells of the line, 2 or more.
        horizon: ticks after which both are truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python.
        **knobs: see `tasks/knobs.py`, without `occlusion`; all are off. A held-out layout starts
            the robots in two other cells of the line.
    Raises:
        SpecError: the line is too short, or a knob is out of its range.
    """

    metadata = metadata_of("two_robot_line_v0", fps=4)
    contract = "two_robot_line.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(
        self,
        *,
        n: int = 5,
        horizon: int | None = None,
        render_mode: str | None = None,
        debug: bool = False,
        **knobs: Unpack[KnobArguments],
    ) -> None:
        kernel = two_robot_line_kernel(n=n, horizon=horizon)
        super().__init__(kernel, render_mode=render_mode, debug=debug)
        self.n = n
        self.disturb(
            Knobs(knobs, agents=AGENTS, offered=KNOBS),
            things=(),
            noop=STAY,
            neighbours={DOWN: (STAY, UP), UP: (STAY, DOWN)},
        )

    # -- knobs

    def whereabouts(self) -> list[int]:
        """The robots' cells."""
        return list(map(int, self.memory.records["cells"][0]))

    def held_out(self, rng: Stream) -> NDArray[Any]:
        """A line on which the robots start in any two cells that differ."""
        first = rng.integers(self.n)
        other = (first + rng.integers(1, self.n)) % self.n
        return np.array([(self.n - 1, first, other)], LAYOUT)

    def believed(self, agent: str) -> NDArray[np.int64]:
        """The robot's own idea of its cell, before anything disturbs what it sees."""
        assert self.disturbances is not None  # asked under knobs alone
        drift = sum(self.disturbances.drift[agent])  # on a line both axes are one
        cell = self.whereabouts()[self.number_of[agent]] + drift
        return np.array([min(max(cell, 0), self.n - 1)], np.int64)

    # -- pictures

    def letters(self) -> str:
        """Line in letters: `p...c`, a star where both robots stand."""
        line = ["."] * self.n
        for agent, cell in zip(AGENTS, self.whereabouts(), strict=True):
            line[cell] = agent[0] if line[cell] == "." else "*"
        return "".join(line)

    def pixels(self) -> NDArray[np.uint8]:
        """Line in cells of 24 pixels, [24, 24 n, 3]."""
        canvas = Canvas(self.n, 1)
        cells = self.whereabouts()
        for cell, color in zip(cells, (BLUE, ORANGE), strict=True):
            canvas.disc(cell, 0, GREEN if cells[0] == cells[1] else color)
        return canvas.pixels
