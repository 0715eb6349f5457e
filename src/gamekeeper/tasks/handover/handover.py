"""Two arms hand parts over in a space that holds one of them; who is ready first acts next.

Place and roster
    R1. The arms stand at the ends of a line. Each has `reach` cells of its own; between them lie
        `shared` cells that both can reach, and in the middle of these (of an even number, right of
        it) the slot. An arm's extension is how many cells its hand is from home.
    R2. Parts arrive at the tray, `giver_0`'s home, in all `parts`: the first at time 1 to `gap`,
        each further one 1 to 2 `gap` - 1 units after the one before (`gap` on average). All times
        are drawn as the episode begins, so nothing an arm does changes them.
    R3. `receiver_0`'s home is the bin. A part in the bin is delivered, and every arm is paid
        DELIVERY ("delivery").
Turns
    R4. A turn takes an arm one unit of time, a move with a part CARRYING units. The arm that is
        ready first acts next; of two, the one in the shared space, so that it can clear it; else
        the giver.
    R5. Action 0 retracts by a cell, 1 reaches a cell further, 2 grasps, 3 releases, 4 waits. Each
        move made costs EFFORT ("effort").
    R6. An empty hand grasps what lies under it, in the tray (the part that came first) or in the
        slot.
    R7. A part is released into the tray, the slot or the bin where there is room; anywhere else it
        is dropped. The first time that a part comes to lie in the slot, who put it there is paid
        HANDOVER ("handover").
What is forbidden
    R8. Masked out are: to reach into the shared space while the other arm is in it, to move past
        the ends, to grasp with a full hand or where nothing lies, to release with an empty hand.
    R9. Who chooses what is masked out pays FAULT ("fault"), and does it all the same: to reach in
        on the other is a collision, all else does nothing.
Ends
    R10. All parts delivered: all are terminated ("done").
    R11. A collision ("collision"), a dropped part ("dropped"), or a part that arrives at a full
        tray (`tray` parts) and falls off ("overflow"): every arm is paid LOSS ("loss"), and all
        are terminated.
    R12. After `horizon` ticks (HORIZON, 240, unless given) all are truncated ("horizon"). A
        tick is over when the turn comes to an arm that already had one in it.

An episode is solved where it ends "done". Source: our own; space that only one arm may be in at a
time, and motions that take their time, are those of robot cells with an interlocked exchange area.
The rules for the kernel, and what each event pays, stand in `handover_rules`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Unpack

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_env import MaskedTurns
from gamekeeper.randomness.stream import Stream
from gamekeeper.tasks.arguments import check_whole
from gamekeeper.tasks.disturbances import DisturbedTurns
from gamekeeper.tasks.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    PAPER,
    STONE,
    WOOD,
    Canvas,
    Pictured,
    metadata_of,
)
from gamekeeper.tasks.handover import handover_rules as rules
from gamekeeper.tasks.handover.handover_rules import (
    GRASP,
    OTHER,
    REACH,
    RELEASE,
    RETRACT,
    SLOT,
    TRAY,
    WAIT,
    greedy,
    lazy,
    reference,
)
from gamekeeper.tasks.knobs import KnobArguments, Knobs

HANDS: Final = {"giver_0": (">", "G", BLUE), "receiver_0": ("<", "R", ORANGE)}
"""By agent: an empty hand, a full one, and the colour of the arm."""


GIVER, RECEIVER = AGENTS = ("giver_0", "receiver_0")
SLIPS: Final = {RETRACT: (REACH,), REACH: (RETRACT,), GRASP: (RELEASE,), RELEASE: (GRASP,)}
"""Opposite of each action, as which it turns out where an actuator slips."""


def handover_kernel(
    *,
    reach: int = 2,
    shared: int = 3,
    parts: int = 4,
    tray: int = 2,
    gap: int = 16,
    horizon: int | None = None,
) -> Kernel:
    """The rules for these sizes; R12's horizon where none is given.

    Raises:
        SpecError: a number is out of its range.
    """
    check_sizes({"reach": reach, "shared": shared, "parts": parts, "tray": tray, "gap": gap})
    far, full, cells = reach + shared - 1, tray + 1, 2 * reach + shared
    high = np.array([far, 1, far + 1, 2, 2, full, far, reach - 1, parts], np.int64)
    arm = [far, 1, rules.CARRYING]
    most = np.array([*arm, *arm, 1, tray, parts, cells - 1, 2 * gap], np.int64)
    return Kernel(
        name="handover_v0",
        agents=AGENTS,
        observation_space=Box(np.zeros_like(high), high, dtype=np.int64),
        action_space=Discrete(rules.ACTIONS),
        state=[
            ("extension", "i8", (2,)),
            ("holds", "i8", (2,)),
            ("ready", "i8", (2,)),
            ("clock", "i8"),
            ("slot", "i8"),
            ("lying", "i8"),
            ("delivered", "i8"),
            ("arrived", "i8"),
            ("instead", "i8"),
            ("tray", "i8", (tray,)),
            ("arrivals", "i8", (parts,)),
            ("handed", "i1", (parts,)),
        ],
        tables=np.array([(reach, shared, parts, tray, gap, reach + shared // 2)], rules.SIZES),
        reset=rules.reset,
        act=rules.act,
        observe=rules.observe,
        mask=rules.mask,
        plays_illegal=True,
        inform=rules.inform,
        info=[("clock", "i8"), ("undelivered", "i8")],
        overview=rules.overview,
        state_space=Box(np.zeros_like(most), most, dtype=np.int64),
        terms=rules.TERMS,
        endings=rules.ENDINGS,
        horizon=rules.HORIZON if horizon is None else horizon,
    )


def check_sizes(sizes: Mapping[str, Any], *, shared: int = 1) -> None:
    """Requires whole numbers, 1 or more; of the shared space, `shared` or more.

    Raises:
        SpecError: one isn't; names it.
    """
    for name, size in sizes.items():
        check_whole(name, size, shared if name == "shared" else 1)


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm as it is.

    Args:
        extension: cells from home to the hand.
        part: the number of the part in its hand; None: empty.
        ready: when it can act again, in units of time.
    """

    extension: int
    part: int | None
    ready: int


class Handover(Pictured, DisturbedTurns, MaskedTurns):
    """Parts go from the tray by giver, slot and receiver to the bin; see the rules above.

    An arm is shown [9] int64, 0 standing for what it doesn't see (knob `occlusion`): its own
    extension; whether it holds a part; 1 + the other's extension; the other's hand (1 empty, 2
    full); the slot (1 empty, 2 full); 1 + parts in the tray; the slot's extension; the last
    extension outside the shared space; parts not yet delivered. Its info has the time (`clock`) and
    how many parts are `undelivered`. `state()` is all that decides what comes, [11] int64: of
    giver, then receiver, extension, whether it holds a part, units until it is ready; then parts in
    the slot, in the tray, not yet delivered; the slot's cell; units until the next arrival, 0 where
    none is to come.

    Args:
        reach: cells of each arm's own, 1 or more.
        shared: cells that both can reach, 1 or more; 2 or more for held-out layouts.
        parts: how many arrive in an episode.
        tray: how many the tray holds.
        gap: mean units of time between two arrivals.
        horizon: ticks after which all are truncated; None: the contract's.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python.
        **knobs: see `tasks/knobs.py`; all are off. A held-out layout has its slot in another cell
            of the shared space.
    Raises:
        SpecError: a number or a knob is out of its range.
    """

    metadata = metadata_of(
        "handover_v0", fps=8, is_parallelizable=False
    )  # who acts next depends on the state
    contract = "handover.toml"
    policies = {"reference": reference, "greedy": greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

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
        debug: bool = False,
        **knobs: Unpack[KnobArguments],
    ) -> None:
        settings = Knobs(knobs, agents=AGENTS)
        sizes = {"reach": reach, "shared": shared, "parts": parts, "tray": tray, "gap": gap}
        check_sizes(sizes, shared=2 if settings.held_out else 1)
        kernel = handover_kernel(**sizes, horizon=horizon)
        super().__init__(kernel, render_mode=render_mode, debug=debug)
        self.reach, self.shared, self.gap = reach, shared, gap
        self.parts, self.tray_size = parts, tray
        self.cells, self.furthest = 2 * reach + shared, reach + shared - 1
        self.disturb(
            settings,
            things=((OTHER, SLOT), (SLOT, TRAY), (TRAY, TRAY + 1)),
            noop=WAIT,
            neighbours=SLIPS,
        )

    # -- what there is to see

    @property
    def arms(self) -> dict[str, Arm]:
        """The arms as they are now."""
        record = self.memory.records[0]
        columns = (record[name].tolist() for name in ("extension", "holds", "ready"))
        arms = [Arm(at, part or None, ready) for at, part, ready in zip(*columns, strict=True)]
        return dict(zip(AGENTS, arms, strict=True))

    @property
    def tray(self) -> list[int]:
        """The numbers of the parts in the tray, the one that came first in front."""
        record = self.memory.records[0]
        parts: list[int] = record["tray"][: record["lying"]].tolist()
        return parts

    @property
    def slot(self) -> int | None:
        """The number of the part in the slot."""
        return int(self.memory.records["slot"][0]) or None

    @property
    def slot_cell(self) -> int:
        """The cell in which the slot is, counted from the tray."""
        return int(self.tables["slot_cell"][0])

    @property
    def delivered(self) -> int:
        """Parts in the bin."""
        return int(self.memory.records["delivered"][0])

    @property
    def clock(self) -> int:
        """The time, in units."""
        return int(self.memory.records["clock"][0])

    @property
    def arrivals(self) -> list[int]:
        """When the parts come that haven't yet."""
        record = self.memory.records[0]
        times: list[int] = record["arrivals"][record["arrived"] :].tolist()
        return times

    def is_inside(self, agent: str) -> bool:
        """The arm's hand is in the shared space."""
        return self.arms[agent].extension >= self.reach

    # -- knobs

    def whereabouts(self) -> list[int]:
        """Extension of the arms."""
        extensions: list[int] = self.memory.records["extension"][0].tolist()
        return extensions

    def held_out(self, rng: Stream) -> NDArray[Any]:
        """The slot in another cell of the shared space than its middle."""
        tables = self.kernel.tables.copy()
        cells = range(self.reach, self.reach + self.shared)
        tables["slot_cell"] = rng.choice([c for c in cells if c != tables["slot_cell"][0]])
        return np.asarray(tables)

    def finds_itself(self, agent: str) -> bool:
        """A hand at its end stop is at home."""
        return self.whereabouts()[self.number_of[agent]] == 0

    def carried_out(self, chosen: int, done: int) -> int:
        """A fault is what was chosen (R9); `instead` says what was done."""
        self.memory.records["instead"] = 1 + done
        return chosen

    def believed(self, agent: str) -> NDArray[np.int64]:
        """Observation of an arm, with its own estimate of its extension."""
        assert self.disturbances is not None  # asked under knobs alone
        seen = super().believed(agent)
        drifted = seen[0] + sum(self.disturbances.drift[agent])  # on a line both axes are one
        seen[0] = min(max(drifted, 0), self.furthest)
        return seen

    # -- pictures

    def letters(self) -> str:
        """`1 >.[.o.].< 2/4`: parts on the tray, the line, parts in the bin.

        Hands are `>` and `<`, full `G` and `R`; the slot is `_`, with a part `o`, where no hand is
        over it; the shared space stands in brackets.
        """
        letters = ["."] * self.cells
        letters[self.slot_cell] = "_" if self.slot is None else "o"
        for agent, cell in self._hands().items():
            empty, full, _ = HANDS[agent]
            letters[cell] = empty if self.arms[agent].part is None else full
        letters.insert(self.reach + self.shared, "]")
        letters.insert(self.reach, "[")
        return f"{len(self.tray)} {''.join(letters)} {self.delivered}/{self.parts}"

    def pixels(self) -> NDArray[np.uint8]:
        """The arms from both sides, the slot between them, levels of tray and bin at the ends.

        Returns:
            [72, 24 * (cells + 2), 3] uint8.
        """
        canvas = Canvas(self.cells + 2, 3)
        canvas.rectangle(1 + self.reach, 0, self.shared, 3, STONE)
        canvas.fill(1 + self.slot_cell, 1, PAPER, inset=0.05)
        if self.slot is not None:
            canvas.fill(1 + self.slot_cell, 1, WOOD, inset=0.2)
        canvas.bar(0, 1, len(self.tray) / self.tray_size, WOOD)
        canvas.bar(self.cells + 1, 1, self.delivered / self.parts, GREEN)
        for agent, cell in self._hands().items():
            color, length = HANDS[agent][2], self.arms[agent].extension + 0.5
            start = 1.0 if agent == GIVER else self.cells + 1 - length
            canvas.rectangle(start, 1.4, length, 0.2, color)
            canvas.disc(cell + 1, 1, color)
            if self.arms[agent].part is not None:
                canvas.fill(cell + 1, 1, WOOD, inset=0.3)
        return canvas.pixels

    def _hands(self) -> dict[str, int]:
        left, right = self.whereabouts()
        return {GIVER: left, RECEIVER: self.cells - 1 - right}
