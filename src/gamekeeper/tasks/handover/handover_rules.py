"""Policies that play `handover`: they know what an arm observes, and nothing else.

None of them looks at the mask: it tells the truth, also where an arm's senses are disturbed.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.kernels import draws
from gamekeeper.kernels.scalar_rules import rule

RETRACT, REACH, GRASP, RELEASE, WAIT = range(5)
OWN, HOLDS, OTHER, OTHER_HOLDS, SLOT, TRAY, SLOT_AT, EDGE, LEFT = range(9)
"""Places of an observation; see `Handover`."""
HIDDEN: Final = 0
EMPTY: Final = 1
"""Number for an empty slot, hand or tray; larger numbers are contents."""
YIELDS: Final = 0.15
"""Probability a turn that a greedy arm backs out of the shared space where it can do nothing."""


def reference(
    observation: NDArray[Any], agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Lets the other go first: an arm waits at the edge until the space is clear and it has work.

    The giver reaches in with a part once the slot is empty, the receiver once something lies in it.
    """
    seen = [int(number) for number in observation]
    return _reference_giver(seen) if agent.startswith("giver") else _reference_receiver(seen)


def greedy(observation: NDArray[Any], agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Reaches in as soon as the space is clear and a part is on its way, and waits in there.

    A receiver that is in before the part keeps the giver out. Where neither can go on, one inside
    backs out by chance (YIELDS).
    """
    seen = [int(number) for number in observation]
    if agent.startswith("giver"):
        return _reference_giver(seen)
    is_coming = seen[SLOT] > EMPTY or seen[TRAY] > EMPTY or seen[OTHER_HOLDS] > EMPTY
    if seen[HOLDS] or not is_coming:
        return _reference_receiver(seen)
    if seen[SLOT] > EMPTY or seen[OWN] <= seen[EDGE]:
        return _on_the_way(seen)
    is_going_back = rng.random() < YIELDS
    return RETRACT if is_going_back else _on_the_way(seen)


def lazy(observation: NDArray[Any], agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Waits, whatever arrives."""
    return WAIT


def _reference_giver(seen: list[int]) -> int:
    """Home, grasp, to the edge, and in once the slot is seen empty."""
    own, at = seen[OWN], seen[SLOT_AT]
    if not seen[HOLDS]:
        if own > 0:
            return RETRACT
        return GRASP if seen[TRAY] > EMPTY else WAIT
    if own < seen[EDGE]:
        return REACH
    if own == seen[EDGE]:
        return REACH if _is_clear(seen) and seen[SLOT] == EMPTY else WAIT
    if own != at:
        return REACH if own < at else RETRACT
    return {EMPTY: RELEASE, HIDDEN: WAIT}.get(seen[SLOT], RETRACT)


def _reference_receiver(seen: list[int]) -> int:
    """To the edge, in once something lies in the slot, and home with it."""
    own = seen[OWN]
    if seen[HOLDS]:
        return RETRACT if own > 0 else RELEASE
    if own >= seen[EDGE] and seen[SLOT] == EMPTY:
        return RETRACT if own > seen[EDGE] else WAIT
    return _on_the_way(seen)


def _on_the_way(seen: list[int]) -> int:
    """An empty hand to the slot, as far as the space is clear, to grasp what is seen there."""
    own, at = seen[OWN], seen[SLOT_AT]
    if own == seen[EDGE] and not _is_clear(seen):
        return WAIT
    if own != at:
        return REACH if own < at else RETRACT
    return GRASP if seen[SLOT] > EMPTY else WAIT


def _is_clear(seen: list[int]) -> bool:
    """The other arm is seen, and outside the shared space."""
    return HIDDEN < seen[OTHER] <= seen[EDGE] + 1


ACTIONS: Final = 5
CARRYING: Final = 2
"""Units of time that a move with a part takes."""
DELIVERY: Final = 1.0
HANDOVER: Final = 0.2
EFFORT: Final = -0.01
FAULT: Final = -0.1
LOSS: Final = -1.0
"""Reward of each event, in reward units."""
TERMS: Final = ("fault", "effort", "handover", "delivery", "loss")
"""In the order in which a turn can pay them."""
FAULTS, EFFORTS, HANDOVERS, DELIVERIES, LOSSES = range(5)
ENDINGS: Final = ("done", "collision", "dropped", "overflow")
DONE, COLLISION, DROPPED, OVERFLOW = range(1, 5)
HORIZON: Final = 240
"""Ticks of an episode, as the contract has them."""
SIZES: Final = np.dtype(
    [(name, "i8") for name in ("reach", "shared", "parts", "tray", "gap", "slot_cell")]
)


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Both hands at home and empty, the parts still to come (R1, R2)."""
    time = 1 + draws.integers(s, t.gap)
    s.arrivals[0] = time
    for k in range(1, t.parts):
        time += 1 + draws.integers(s, 2 * t.gap - 1)
        s.arrivals[k] = time


@rule
def act(s, t, agent, action, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """One turn of an arm (R3 to R11)."""
    if not is_legal(s, t, agent, action):
        rewards[agent, FAULTS] = FAULT
    done = action if s.instead == 0 else s.instead - 1
    is_moving = done in (RETRACT, REACH)
    s.ready[agent] += CARRYING if is_moving and s.holds[agent] != 0 else 1
    if is_moving:
        move(s, t, agent, 1 if done == REACH else -1, rewards, terminated)
    elif done == GRASP and s.holds[agent] == 0:
        grasp(s, t, agent)
    elif done == RELEASE and s.holds[agent] != 0:
        release(s, t, agent, rewards, terminated)
    go_on(s, t, rewards, terminated)
    if s.delivered == t.parts:
        finish(s, DONE, terminated)
    s.turn = next_arm(s, t)


@rule
def move(s, t, agent, by, rewards, terminated):  # type: ignore[no-untyped-def]  # likewise
    """Moves a hand by a cell; into the other arm it doesn't come (R5, R9, R11)."""
    to = s.extension[agent] + by
    if to < 0 or to >= t.reach + t.shared:
        return
    if by > 0 and to == t.reach and is_inside(s, t, 1 - agent):
        lose(s, COLLISION, rewards, terminated)
    else:
        s.extension[agent] = to
        rewards[agent, EFFORTS] = EFFORT


@rule
def grasp(s, t, agent):  # type: ignore[no-untyped-def]  # likewise
    """Takes what lies under an empty hand (R6)."""
    if s.extension[agent] == slot_at(t, agent):
        s.holds[agent] = s.slot
        s.slot = 0
    elif agent == 0 and s.extension[0] == 0 and s.lying > 0:
        s.holds[0] = s.tray[0]
        s.lying -= 1
        for k in range(s.lying):
            s.tray[k] = s.tray[k + 1]
        s.tray[s.lying] = 0


@rule
def release(s, t, agent, rewards, terminated):  # type: ignore[no-untyped-def]  # likewise
    """Lets go of a part: it lies, is delivered, or is dropped (R3, R7)."""
    part = s.holds[agent]
    s.holds[agent] = 0
    if s.extension[agent] == slot_at(t, agent) and s.slot == 0:
        s.slot = part
        if s.handed[part - 1] == 0:
            s.handed[part - 1] = 1
            rewards[agent, HANDOVERS] = HANDOVER
    elif s.extension[agent] == 0 and agent == 1:
        s.delivered += 1
        for i in range(2):
            rewards[i, DELIVERIES] = DELIVERY
    elif s.extension[agent] == 0 and s.lying < t.tray:
        s.tray[s.lying] = part
        s.lying += 1
    else:
        lose(s, DROPPED, rewards, terminated)


@rule
def go_on(s, t, rewards, terminated):  # type: ignore[no-untyped-def]  # likewise
    """Time goes on until an arm is ready, and parts arrive meanwhile (R2, R11)."""
    s.clock = min(s.ready[0], s.ready[1])
    while s.arrived < t.parts and s.arrivals[s.arrived] <= s.clock:
        s.arrived += 1
        if s.lying == t.tray:
            lose(s, OVERFLOW, rewards, terminated)
        else:
            s.tray[s.lying] = s.arrived
            s.lying += 1


@rule
def lose(s, reason, rewards, terminated):  # type: ignore[no-untyped-def]  # likewise
    """A part or an arm is damaged; one loss is enough to end the episode (R11)."""
    for i in range(2):
        rewards[i, LOSSES] = LOSS
    finish(s, reason, terminated)


@rule
def finish(s, reason, terminated):  # type: ignore[no-untyped-def]  # likewise
    """All end, for the first reason that there was."""
    for i in range(2):
        terminated[i] = True
        if s.ending[i] == 0:
            s.ending[i] = reason


@rule
def next_arm(s, t):  # type: ignore[no-untyped-def]  # likewise
    """Arm that is ready first; of two, the one in the shared space; else the giver (R4)."""
    if s.ready[0] == s.ready[1]:
        return 1 if is_inside(s, t, 1) else 0
    return 0 if s.ready[0] < s.ready[1] else 1


@rule
def is_inside(s, t, agent):  # type: ignore[no-untyped-def]  # likewise
    """The arm's hand is in the shared space."""
    return s.extension[agent] >= t.reach


@rule
def slot_at(t, agent):  # type: ignore[no-untyped-def]  # likewise
    """The extension at which an arm's hand is over the slot."""
    return t.slot_cell if agent == 0 else 2 * t.reach + t.shared - 1 - t.slot_cell


@rule
def is_legal(s, t, agent, action):  # type: ignore[no-untyped-def]  # likewise
    """Tells whether the arm may take the action (R8)."""
    extension, is_empty = s.extension[agent], s.holds[agent] == 0
    if action == RETRACT:
        return extension > 0
    if action == REACH:
        is_entering = extension == t.reach - 1 and is_inside(s, t, 1 - agent)
        return extension < t.reach + t.shared - 1 and not is_entering
    if action == GRASP:
        if extension == slot_at(t, agent):
            return is_empty and s.slot != 0
        return is_empty and agent == 0 and extension == 0 and s.lying > 0
    return not is_empty if action == RELEASE else True


@rule
def mask(s, t, agent, flags):  # type: ignore[no-untyped-def]  # likewise
    """Mask of the arm's actions (R8)."""
    for action in range(ACTIONS):
        flags[action] = 1 if is_legal(s, t, agent, action) else 0


@rule
def observe(s, t, agent, obs):  # type: ignore[no-untyped-def]  # likewise
    """Observation of an arm; 0 stands for what is hidden (knob `occlusion`)."""
    other = 1 - agent
    obs[0] = s.extension[agent]
    obs[1] = 1 if s.holds[agent] != 0 else 0
    obs[2] = 1 + s.extension[other]
    obs[3] = 2 if s.holds[other] != 0 else 1
    obs[4] = 2 if s.slot != 0 else 1
    obs[5] = 1 + s.lying
    obs[6] = slot_at(t, agent)
    obs[7] = t.reach - 1
    obs[8] = t.parts - s.delivered


@rule
def inform(s, t, agent, info):  # type: ignore[no-untyped-def]  # likewise
    """The time, and how many parts are not yet delivered."""
    info.clock = s.clock
    info.undelivered = t.parts - s.delivered


@rule
def overview(s, t, state):  # type: ignore[no-untyped-def]  # likewise
    """All that decides what comes; laid out in `Handover`."""
    for i in range(2):
        state[3 * i] = s.extension[i]
        state[3 * i + 1] = 1 if s.holds[i] != 0 else 0
        state[3 * i + 2] = s.ready[i] - s.clock
    state[6] = 1 if s.slot != 0 else 0
    state[7] = s.lying
    state[8] = t.parts - s.delivered
    state[9] = t.slot_cell
    state[10] = max(s.arrivals[s.arrived] - s.clock, 0) if s.arrived < t.parts else 0
