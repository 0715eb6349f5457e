"""`two_robot_line` written by hand, as a `TickEnv`; its rules R1 to R5 stand in the task itself."""

from pathlib import Path
from typing import Any, Final, Unpack

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper import tasks
from gamekeeper.errors import SpecError
from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.knobs import LABELS, Disturbances, KnobArguments, Knobs

DOWN, STAY, UP = range(3)
MEETING: Final = 1.0
"""What each robot is paid when they meet, in reward units."""
AGENTS: Final = ("picker", "carrier")
KNOBS: Final = tuple(name for name in LABELS if name != "occlusion")
"""A robot sees its own cell alone, so there is nothing to hide from it."""


class TwoRobotLine(TickEnv):
    """Each robot sees its own cell, [1] int64 in 0 to n - 1; its info tells the true `position`.

    Args:
        n: cells of the line, 2 or more.
        horizon: ticks after which both are truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        **knobs: see `envs/knobs.py`, without `occlusion`; all are off. A held-out layout starts
            the robots in two other cells of the line.
    Raises:
        SpecError: the line is too short, or a knob is out of its range.
    """

    metadata = {  # noqa: RUF012  # PettingZoo declares it so
        "name": "two_robot_line_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 4,
        "is_parallelizable": True,
    }
    contract = Path(tasks.__file__).parent / "two_robot_line.toml"

    def __init__(
        self,
        *,
        n: int = 5,
        horizon: int | None = None,
        render_mode: str | None = None,
        **knobs: Unpack[KnobArguments],
    ) -> None:
        super().__init__(render_mode=render_mode, horizon=horizon)
        if type(n) is not int or n < 2:
            raise SpecError(
                "the line is too short for two robots",
                where="n",
                expected="a whole number of cells, 2 or more",
                actual=repr(n),
            )
        self.n = n
        self.possible_agents = list(AGENTS)
        space = Box(0, n - 1, (1,), np.int64)
        self.observation_spaces = dict.fromkeys(AGENTS, space)
        self.action_spaces = {agent: Discrete(3) for agent in AGENTS}
        self.state_space = Box(0, n - 1, (2,), np.int64)
        settings = Knobs(knobs, agents=AGENTS, offered=KNOBS)
        self.is_sound = settings.is_ideal
        self.disturbances = Disturbances(
            settings,
            bounds=dict.fromkeys(AGENTS, (space.low, space.high)),
            things=dict.fromkeys(AGENTS, ()),
            noop=STAY,
            neighbours={DOWN: (STAY, UP), UP: (STAY, DOWN)},
        )

    # -- state

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """Puts the robots at the two ends (R1)."""
        self.cells = {"picker": 0, "carrier": self.n - 1}
        self.disturbances.begin(rng)
        if self.disturbances.is_held_out:
            layout = self.disturbances.layout_rng()
            first = layout.integers(self.n)
            other = (first + layout.integers(1, self.n)) % self.n
            self.cells = {"picker": first, "carrier": other}

    def state(self) -> NDArray[np.int64]:
        """The cells of picker and carrier, [2] int64."""
        return np.array([self.cells[agent] for agent in AGENTS], np.int64)

    # -- a step

    def tick(self, actions: dict[str, int]) -> None:
        """Moves both robots, then looks whether they met (R2 to R4)."""
        moves = actions if self.is_sound else self._disturbed(actions)
        for agent, move in moves.items():
            cell = self.cells[agent]
            self.cells[agent] = min(max(cell + move - 1, 0), self.n - 1)
            if not self.is_sound and self.cells[agent] != cell:
                self.disturbances.moved(agent)
        if self.cells["picker"] == self.cells["carrier"]:
            for agent in actions:
                self.add_reward(agent, MEETING, term="meeting")
                self.terminate(agent, "met")

    def _disturbed(self, actions: dict[str, int]) -> dict[str, int]:
        """What the actions come to under the knobs."""
        knobs = self.disturbances
        for agent in actions:
            knobs.remember(agent, self._seen)
        return {agent: knobs.played(agent, action) for agent, action in actions.items()}

    # -- what agents see

    def observe(self, agent: str) -> NDArray[np.int64]:
        """The robot's own cell, [1] int64."""
        if self.is_sound:
            return np.array([self.cells[agent]], np.int64)
        return self.disturbances.shown(agent, self._seen)

    def info(self, agent: str) -> dict[str, int]:
        """The robot's true cell."""
        return {"position": self.cells[agent]}

    def _seen(self, agent: str) -> NDArray[np.int64]:
        """The robot's own idea of its cell, before anything disturbs what it sees."""
        drift = sum(self.disturbances.drift[agent])  # on a line both axes are one
        return np.array([min(max(self.cells[agent] + drift, 0), self.n - 1)], np.int64)
