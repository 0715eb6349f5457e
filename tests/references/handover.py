"""`handover` written by hand, as a `TurnEnv`; its rules R1 to R12 stand in the task itself."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Unpack

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper import tasks
from gamekeeper.errors import SpecError
from gamekeeper.interface.turn_env import TurnEnv
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.handover.handover_rules import (
    GRASP,
    OTHER,
    REACH,
    RELEASE,
    RETRACT,
    SLOT,
    TRAY,
    WAIT,
)
from gamekeeper.tasks.knobs import Disturbances, KnobArguments, Knobs

GIVER, RECEIVER = AGENTS = ("giver_0", "receiver_0")
ACTIONS: Final = 5
CARRYING: Final = 2
"""Units of time that a move with a part takes."""
DELIVERY: Final = 1.0
HANDOVER: Final = 0.2
EFFORT: Final = -0.01
FAULT: Final = -0.1
LOSS: Final = -1.0
"""What each event pays, in reward units."""
SLIPS: Final = {RETRACT: (REACH,), REACH: (RETRACT,), GRASP: (RELEASE,), RELEASE: (GRASP,)}
"""What an action turns out as where an actuator slips: its opposite."""


@dataclass(slots=True)
class Arm:
    """An arm as it is.

    Args:
        extension: cells from home to the hand.
        part: the number of the part in its hand; None: empty.
        ready: when it can act again, in units of time.
    """

    extension: int = 0
    part: int | None = None
    ready: int = 0


class Handover(TurnEnv):
    """Parts go from the tray by giver, slot and receiver to the bin; see the rules above.

    Args:
        reach: cells of each arm's own, 1 or more.
        shared: cells that both can reach, 1 or more; 2 or more for held-out layouts.
        parts: how many arrive in an episode.
        tray: how many the tray holds.
        gap: mean units of time between two arrivals.
        horizon: ticks after which all are truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        **knobs: see `envs/knobs.py`; all are off. A held-out layout has its slot in another cell
            of the shared space.
    Raises:
        SpecError: a number or a knob is out of its range.
    """

    metadata = {  # noqa: RUF012  # PettingZoo declares it so
        "name": "handover_v0",
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "is_parallelizable": False,  # who acts next depends on the state
    }
    contract = Path(tasks.__file__).parent / "handover" / "handover.toml"

    def __init__(
        self,
        *,
        reach: int = 2,
        shared: int = 3,
        parts: int = 4,
        tray: int = 2,
        gap: int = 16,
        horizon: int | None = None,
        render_mode: str | None = None,
        **knobs: Unpack[KnobArguments],
    ) -> None:
        super().__init__(render_mode=render_mode, horizon=horizon)
        self.reach, self.shared, self.parts, self.tray_size, self.gap = (
            reach,
            shared,
            parts,
            tray,
            gap,
        )
        settings = Knobs(knobs, agents=AGENTS)
        self.is_sound = settings.is_ideal
        sizes = {"reach": reach, "shared": shared, "parts": parts, "tray": tray, "gap": gap}
        least = {"shared": 2 if settings.held_out else 1}
        for name, size in sizes.items():
            if type(size) is not int or size < least.get(name, 1):
                raise SpecError(
                    "the task can't have that size",
                    where=name,
                    expected=f"a whole number, {least.get(name, 1)} or more",
                    actual=repr(size),
                )
        self.cells, self.furthest = 2 * reach + shared, reach + shared - 1
        self.possible_agents = list(AGENTS)
        far, full = self.furthest, tray + 1
        high = np.array([far, 1, far + 1, 2, 2, full, far, reach - 1, parts], np.int64)
        space = Box(np.zeros_like(high), high, dtype=np.int64)
        self.observation_spaces = dict.fromkeys(AGENTS, space)
        self.action_spaces = {agent: Discrete(ACTIONS) for agent in AGENTS}
        arm = [far, 1, CARRYING]
        most = np.array([*arm, *arm, 1, tray, parts, self.cells - 1, 2 * gap], np.int64)
        self.state_space = Box(np.zeros_like(most), most, dtype=np.int64)
        self.disturbances = Disturbances(
            settings,
            bounds=dict.fromkeys(AGENTS, (space.low, space.high)),
            things=dict.fromkeys(AGENTS, ((OTHER, SLOT), (SLOT, TRAY), (TRAY, TRAY + 1))),
            noop=WAIT,
            neighbours=SLIPS,
        )

    # -- state

    def start(self, rng: Stream, options: dict[str, Any]) -> None:
        """Both hands at home and empty, the parts still to come (R1, R2)."""
        self.arms = {agent: Arm() for agent in AGENTS}
        self.tray: list[int] = []
        self.slot: int | None = None
        self.delivered, self.clock = 0, 0
        self.handed: set[int] = set()
        time = rng.integers(1, self.gap + 1)
        self.arrivals = [time]
        for _ in range(self.parts - 1):
            time += rng.integers(1, 2 * self.gap)
            self.arrivals.append(time)
        self.arrivals.reverse()  # the next one at the end
        self.disturbances.begin(rng)
        self.slot_cell = self.reach + self.shared // 2
        if self.disturbances.is_held_out:
            cells = range(self.reach, self.reach + self.shared)
            others = [cell for cell in cells if cell != self.slot_cell]
            self.slot_cell = self.disturbances.layout_rng().choice(others)

    def state(self) -> NDArray[np.int64]:
        """All that decides what comes, [11] int64.

        Of giver, then receiver: extension, whether it holds a part, units until it is ready. Then
        parts in the slot, in the tray, not yet delivered; the slot's cell; units until the next
        arrival, 0 where none is to come.
        """
        numbers = []
        for agent in AGENTS:
            arm = self.arms[agent]
            numbers += [arm.extension, arm.part is not None, arm.ready - self.clock]
        numbers += [self.slot is not None, len(self.tray), self.parts - self.delivered]
        coming = self.arrivals[-1] - self.clock if self.arrivals else 0
        return np.array([*numbers, self.slot_cell, max(coming, 0)], np.int64)

    # -- turns

    def next_agent(self, agent: str) -> str:
        """Who is ready first; of two, who is in the shared space; else the giver (R4)."""
        giver, receiver = self.arms[GIVER], self.arms[RECEIVER]
        if giver.ready == receiver.ready:
            return RECEIVER if self.is_inside(RECEIVER) else GIVER
        return GIVER if giver.ready < receiver.ready else RECEIVER

    def act(self, agent: str, action: int) -> None:
        """One turn of an arm (R3 to R7, R10, R11)."""
        arm = self.arms[agent]
        done = action
        if not self.is_sound:
            self.disturbances.remember(agent, self._seen)
            done = self.disturbances.played(agent, action)
        is_carrying = arm.part is not None and done in (RETRACT, REACH)
        arm.ready += CARRYING if is_carrying else 1
        if done in (RETRACT, REACH):
            self._move(agent, arm, 1 if done == REACH else -1)
        elif done == GRASP and arm.part is None:
            self._grasp(agent, arm)
        elif done == RELEASE and arm.part is not None:
            self._release(agent, arm)
        self._go_on()
        if self.delivered == self.parts:
            self._finish("done")

    def mask(self, agent: str) -> NDArray[np.int8]:
        """What the arm may do, [5] int8 (R8)."""
        arm, lies = self.arms[agent], self._lying(agent)
        is_entering = arm.extension == self.reach - 1 and self.is_inside(_other(agent))
        return np.array(
            [
                arm.extension > 0,
                arm.extension < self.furthest and not is_entering,
                arm.part is None and lies,
                arm.part is not None,
                True,
            ],
            np.int8,
        )

    def illegal(self, agent: str, action: Any) -> int:
        """Who does what is masked out pays for it, and does it all the same (R9).

        Raises:
            ActionError: it is no action at all.
        """
        if not self.action_space(agent).contains(action):
            super().illegal(agent, action)
        self.add_reward(agent, FAULT, term="fault")
        return int(action)

    def is_inside(self, agent: str) -> bool:
        """The arm's hand is in the shared space."""
        return self.arms[agent].extension >= self.reach

    def _move(self, agent: str, arm: Arm, by: int) -> None:
        """Moves a hand by a cell; into the other arm it doesn't come (R5, R9, R11)."""
        to = arm.extension + by
        if not 0 <= to <= self.furthest:
            return
        if by > 0 and to == self.reach and self.is_inside(_other(agent)):
            self._lose("collision")
            return
        arm.extension = to
        self.add_reward(agent, EFFORT, term="effort")
        if not self.is_sound:
            self.disturbances.moved(agent)
            if to == 0:
                self.disturbances.located(agent)  # a hand at its end stop is at home

    def _grasp(self, agent: str, arm: Arm) -> None:
        """Takes what lies under an empty hand (R6)."""
        if arm.extension == self._slot_at(agent):
            arm.part, self.slot = self.slot, None
        elif agent == GIVER and arm.extension == 0 and self.tray:
            arm.part = self.tray.pop(0)

    def _release(self, agent: str, arm: Arm) -> None:
        """Lets go of a part: it lies, is delivered, or is dropped (R3, R7)."""
        part, arm.part = arm.part, None
        assert part is not None  # asked by the caller
        if arm.extension == self._slot_at(agent) and self.slot is None:
            self.slot = part
            if part not in self.handed:
                self.handed.add(part)
                self.add_reward(agent, HANDOVER, term="handover")
        elif arm.extension == 0 and agent == RECEIVER:
            self.delivered += 1
            for each in AGENTS:
                self.add_reward(each, DELIVERY, term="delivery")
        elif arm.extension == 0 and len(self.tray) < self.tray_size:
            self.tray.append(part)
        else:
            self._lose("dropped")

    def _go_on(self) -> None:
        """Time goes on until an arm is ready, and parts arrive meanwhile (R2, R11)."""
        self.clock = min(self.arms[GIVER].ready, self.arms[RECEIVER].ready)
        while self.arrivals and self.arrivals[-1] <= self.clock:
            self.arrivals.pop()
            if len(self.tray) == self.tray_size:
                self._lose("overflow")
            else:
                self.tray.append(self.parts - len(self.arrivals))

    def _lose(self, reason: str) -> None:
        """A part or an arm is damaged; one loss is enough to end the episode (R11)."""
        if not self.endings:
            for agent in AGENTS:
                self.add_reward(agent, LOSS, term="loss")
        self._finish(reason)

    def _finish(self, reason: str) -> None:
        for agent in AGENTS:
            self.terminate(agent, reason)

    # -- what agents see

    def observe(self, agent: str) -> NDArray[np.int64]:
        """What an arm is told, [9] int64; 0 stands for what it doesn't see (knob `occlusion`).

        Its own extension; whether it holds a part; 1 + the other's extension; the other's hand (1
        empty, 2 full); the slot (1 empty, 2 full); 1 + parts in the tray; the slot's extension; the
        last extension outside the shared space; parts not yet delivered.
        """
        if self.is_sound:
            return self._seen(agent)
        return self.disturbances.shown(agent, self._seen)

    def info(self, agent: str) -> dict[str, int]:
        """The time, and how many parts are not yet delivered."""
        return {"clock": self.clock, "undelivered": self.parts - self.delivered}

    def _seen(self, agent: str) -> NDArray[np.int64]:
        arm, other = self.arms[agent], self.arms[_other(agent)]
        believed = arm.extension
        if not self.is_sound:
            drifted = believed + sum(self.disturbances.drift[agent])  # on a line both axes are one
            believed = min(max(drifted, 0), self.furthest)
        numbers = [believed, arm.part is not None]
        numbers += [1 + other.extension, 1 + (other.part is not None)]
        numbers += [1 + (self.slot is not None), 1 + len(self.tray), self._slot_at(agent)]
        return np.array([*numbers, self.reach - 1, self.parts - self.delivered], np.int64)

    def _slot_at(self, agent: str) -> int:
        """The extension at which an arm's hand is over the slot."""
        return self.slot_cell if agent == GIVER else self.cells - 1 - self.slot_cell

    def _lying(self, agent: str) -> bool:
        """Whether a part lies under the hand, where the arm may take it."""
        extension = self.arms[agent].extension
        if extension == self._slot_at(agent):
            return self.slot is not None
        return agent == GIVER and extension == 0 and bool(self.tray)


def _other(agent: str) -> str:
    """The other arm."""
    return RECEIVER if agent == GIVER else GIVER
