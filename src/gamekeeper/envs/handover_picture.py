"""Pictures of `handover`: what there is to see, and no rules."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.envs.drawing import BLUE, GREEN, ORANGE, PAPER, STONE, WOOD, Canvas

if TYPE_CHECKING:
    from gamekeeper.envs.handover import Handover

HANDS: Final = {"giver_0": (">", "G", BLUE), "receiver_0": ("<", "R", ORANGE)}
"""By agent: an empty hand, a full one, and the colour of the arm."""


def text_of(env: Handover) -> str:
    """`1 >.[.o.].< 2/4`: parts on the tray, the line, parts in the bin.

    Hands are `>` and `<`, full `G` and `R`; the slot is `_`, with a part `o`, where no hand is over
    it; the shared space stands in brackets.
    """
    letters = ["."] * env.cells
    letters[env.slot_cell] = "_" if env.slot is None else "o"
    for agent, cell in _cells(env).items():
        empty, full, _ = HANDS[agent]
        letters[cell] = empty if env.arms[agent].part is None else full
    letters.insert(env.reach + env.shared, "]")
    letters.insert(env.reach, "[")
    return f"{len(env.tray)} {''.join(letters)} {env.delivered}/{env.parts}"


def pixels_of(env: Handover) -> NDArray[np.uint8]:
    """The arms from both sides, the slot between them, levels of tray and bin at the ends.

    Returns:
        [72, 24 * (cells + 2), 3] uint8.
    """
    canvas = Canvas(env.cells + 2, 3)
    canvas.rectangle(1 + env.reach, 0, env.shared, 3, STONE)
    canvas.fill(1 + env.slot_cell, 1, PAPER, inset=0.05)
    if env.slot is not None:
        canvas.fill(1 + env.slot_cell, 1, WOOD, inset=0.2)
    canvas.bar(0, 1, len(env.tray) / env.tray_size, WOOD)
    canvas.bar(env.cells + 1, 1, env.delivered / env.parts, GREEN)
    for agent, cell in _cells(env).items():
        color, length = HANDS[agent][2], env.arms[agent].extension + 0.5
        start = 1.0 if agent == "giver_0" else env.cells + 1 - length
        canvas.rectangle(start, 1.4, length, 0.2, color)
        canvas.disc(cell + 1, 1, color)
        if env.arms[agent].part is not None:
            canvas.fill(cell + 1, 1, WOOD, inset=0.3)
    return canvas.pixels


def _cells(env: Handover) -> dict[str, int]:
    """The cell of each hand."""
    from_right = env.arms["receiver_0"].extension
    return {"giver_0": env.arms["giver_0"].extension, "receiver_0": env.cells - 1 - from_right}
