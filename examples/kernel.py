"""A first kernel: robots on a ring fetch parcels until their batteries are empty.

    R1. Robots stand on a ring of cells, evenly apart; a parcel lies in a cell that is drawn.
    R2. Each tick all move at once: 0 a cell down, 1 nowhere, 2 a cell up. A move costs a unit of
        battery.
    R3. Robots in the parcel's cell share 1 for it ("parcel"), and the next one is drawn.
    R4. A robot with an empty battery is truncated ("empty"), each at its own time. After 100 ticks
        all are.

    python examples/kernel.py

plays it as one environment, line by line in plain Python, and as a batch of 1,024 compiled copies.
"""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box, Discrete

from gamekeeper.kernels import Batch, Kernel, draws, kernel_env, rule

ROBOTS, CELLS, CHARGE = 3, 12, 30


@rule
def reset(s):
    """Robots, batteries, a parcel (R1); everything else is 0 already."""
    for i in range(ROBOTS):
        s.cell[i] = i * CELLS // ROBOTS
        s.battery[i] = CHARGE
    s.parcel = draws.integers(s, CELLS)


@rule
def step(s, actions, rewards, terminated, truncated):
    """One tick for all (R2 to R4); who isn't live has no say."""
    takers = 0
    for i in range(ROBOTS):
        if s.live[i] != 0:
            s.cell[i] = (s.cell[i] + actions[i] - 1) % CELLS
            if actions[i] != 1:
                s.battery[i] -= 1
            if s.cell[i] == s.parcel:
                takers += 1
    for i in range(ROBOTS):
        if s.live[i] != 0:
            if s.cell[i] == s.parcel:
                rewards[i, 0] = 1.0 / takers
            if s.battery[i] == 0:
                truncated[i] = True
                s.ending[i] = 1  # the first of `endings`
    if takers > 0:
        s.parcel = draws.integers(s, CELLS)


@rule
def observe(s, obs):
    """Everybody's cell, the parcel's, and what is left in the battery."""
    for i in range(ROBOTS):
        obs[i, 0] = s.cell[i]
        obs[i, 1] = s.parcel
        obs[i, 2] = s.battery[i]


RING = Kernel(
    name="ring_v0",
    agents=[f"robot_{i}" for i in range(ROBOTS)],
    observation_space=Box(0, np.array([CELLS - 1, CELLS - 1, CHARGE]), dtype=np.int64),
    action_space=Discrete(3),
    state=[("cell", "i4", (ROBOTS,)), ("battery", "i4", (ROBOTS,)), ("parcel", "i4")],
    reset=reset,
    step=step,
    observe=observe,
    terms=["parcel"],
    endings=["empty"],
    horizon=100,
)


def main() -> None:
    """Plays an episode as PettingZoo has it, then 100 steps of a batch."""
    env, rng = kernel_env(RING, debug=True), np.random.default_rng(0)
    env.reset(seed=0)
    while env.agents:
        env.step({agent: int(rng.integers(3)) for agent in env.agents})
    print(f"one copy: {env.turns} ticks, {env.endings}")

    batch = Batch(RING, 1024, seed=0)
    batch.reset()
    paid = 0.0
    for _ in range(100):
        _, rewards, _, _ = batch.step(rng.integers(0, 3, batch.arrays.actions.shape))
        paid += rewards.sum()
    print(f"1,024 copies: {paid:.0f} parcels in 100 steps")


if __name__ == "__main__":
    main()
