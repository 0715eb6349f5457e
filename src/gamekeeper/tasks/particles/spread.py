"""Agents spread over landmarks, as many as they are, and keep out of each other's way.

    R1. Agents and landmarks begin at random places in [-1, 1] on both axes, agents at rest.
    R2. All agents move at once; they are discs of radius SIZE that push each other, and don't
        collide with landmarks. How they move is told in `particles` (P1 to P3).
    R3. After each tick every agent is paid 1 - `local_ratio` times minus the sum, over landmarks,
        of how far the nearest agent is from it ("cover"),
    R4. and `local_ratio` times minus the number of other agents that it overlaps ("collision"). At
        stage 0 of a curriculum overlaps cost nothing.
    R5. An agent sees its velocity, its place, and from where it stands the places of landmarks and
        of other agents; then two zeros for each other agent, which says nothing. With
        `num_landmark_neighbors` or `num_agent_neighbors` it sees so many of the nearest of these,
        the nearest first, and zeros where there are fewer.
    R6. After `max_cycles` ticks (the contract's, 25, unless given) all are truncated ("horizon").
    R7. With `terminate_on_success`, where before that every landmark has an agent nearer than
        COVERED, all are terminated ("covered").

Equal to mpe2's `simple_spread_v3` but for the random places (ours are drawn from our Stream, in the
same order) and the infos: `collisions`, how many others an agent overlaps, and `uncovered`, how
many landmarks nobody is nearer to than COVERED.

Source: mpe2 1.1.1, `simple_spread`; Lowe et al. 2017, "Multi-Agent Actor-Critic for Mixed
Cooperative-Competitive Environments".
"""

import math
from typing import Any, Final, Unpack

import numpy as np

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import inlined, rule
from gamekeeper.tasks.arguments import check_part, check_whole
from gamekeeper.tasks.drawing import BLUE, STONE, metadata_of
from gamekeeper.tasks.particles import bearings
from gamekeeper.tasks.particles import physics as p
from gamekeeper.tasks.particles.particle_env import ParticleArguments, ParticleTicks
from gamekeeper.tasks.particles.scripted_policies import lazy, spread_greedy, spread_reference

SIZE: Final = 0.15
"""Radius of an agent."""
TOUCHING: Final = p.least_square(2 * SIZE)
"""Squares of distances below it are of agents that overlap."""
COVERED: Final = 0.1
"""Nearer than this an agent covers a landmark."""
WORD: Final = 2
"""Numbers that would be heard of each other agent, if it said anything."""
LAST_STAGE: Final = 1
"""Last stage of a curriculum, in which overlaps cost something."""
NUMBERS: Final = np.dtype(
    [("local_ratio", "f8"), ("max_cycles", "i8"), ("is_paid", "f8"), ("ends_covered", "i8")]
)
"""Weights of rewards, and the end of an episode."""


class SpreadArguments(ParticleArguments, total=False):
    """Arguments of the rules, beside the number of agents; see `Spread`."""

    local_ratio: float


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Puts all bodies at random places (R1)."""
    p.scatter(s, 1.0)


@inlined
def move(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Lets agents push each other, and moves them (R2)."""
    n = len(s.x)
    for i in range(n):
        for j in range(i + 1, n):
            p.push_agents(s, i, j, 2 * SIZE)
    for i in range(n):
        p.drift(s, i)


@inlined
def nearest(s, k):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Distance of the nearest agent from a landmark."""
    best = math.inf
    for i in range(len(s.x)):
        dx = s.x[i] - s.mark_x[k]
        dy = s.y[i] - s.mark_y[k]
        best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)


@inlined
def pay(s, t, rewards):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Pays for landmarks and overlaps (R3, R4)."""
    n = len(s.x)
    far = 0.0
    for k in range(n):
        far -= nearest(s, k)
    far *= 1 - t.local_ratio
    for i in range(n):
        for j in range(i + 1, n):
            dx = s.x[i] - s.x[j]
            dy = s.y[i] - s.y[j]
            if dx * dx + dy * dy < TOUCHING:
                rewards[i, 1] -= t.is_paid
                rewards[j, 1] -= t.is_paid
    for i in range(n):
        rewards[i, 0] = far
        rewards[i, 1] *= t.local_ratio


@rule
def uncovered(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Counts landmarks that no agent covers."""
    count = 0
    for k in range(len(s.mark_x)):
        count += 1 if nearest(s, k) >= COVERED else 0
    return count


@inlined
def after(s, t, rewards, terminated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Moves bodies once forces are set, and pays agents (R2 to R4, R7)."""
    move(s)
    pay(s, t, rewards)
    if t.ends_covered != 0 and s.time < t.max_cycles and uncovered(s) == 0:
        for i in range(len(s.x)):
            terminated[i] = True
            s.ending[i] = 1


@rule
def step(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Plays a tick of discrete actions."""
    for i in range(len(s.x)):
        p.steer(s, i, actions[i], p.STRENGTH)
    after(s, t, rewards, terminated)


@rule
def step_by(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Plays a tick of continuous actions."""
    for i in range(len(s.x)):
        p.steer_by(s, i, actions, i, p.STRENGTH)
    after(s, t, rewards, terminated)


def observer(others: int | None, marks: int | None) -> Any:
    """Returns `observe(s, t, obs)` (R5), of so many others and marks each; None: of all."""
    show_others, show_marks = bearings.others_shower(others), bearings.marks_shower(marks)
    most = None if others is None else WORD * others

    @rule
    def observe(s: Any, t: Any, obs: Any) -> None:
        n = len(s.x)
        words = WORD * (n - 1) if most is None else most
        for i in range(n):
            at = bearings.show_self(s, i, obs, i)
            at = show_marks(s, i, obs, i, at)
            at = show_others(s, i, obs, i, at)
            bearings.show_nothing(obs, i, at, at + words)

    return observe


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """Counts the agents that each agent overlaps, and the uncovered landmarks."""
    n = len(s.x)
    left = uncovered(s)
    for i in range(n):
        overlaps = 0
        for j in range(n):
            overlaps += 1 if j != i and p.apart(s, i, j) < 2 * SIZE else 0
        infos[i].collisions = overlaps
        infos[i].uncovered = left


def spread_kernel(
    *,
    N: int = 3,  # noqa: N803  # as mpe2 calls it
    local_ratio: float = 0.5,
    max_cycles: int = p.HORIZON,
    continuous_actions: bool = False,
    curriculum: bool = False,
    curriculum_stage: int = 0,
    terminate_on_success: bool = False,
    num_agent_neighbors: int | None = None,
    num_landmark_neighbors: int | None = None,
) -> Kernel:
    """The rules for `N` agents; arguments as of `Spread`.

    Raises:
        SpecError: an argument is out of its range.
    """
    others, marks = num_agent_neighbors, num_landmark_neighbors
    p.check_counts(
        N=N, max_cycles=max_cycles, num_agent_neighbors=others, num_landmark_neighbors=marks
    )
    check_part("local_ratio", local_ratio)
    check_whole("curriculum_stage", curriculum_stage, 0, LAST_STAGE)
    others_seen, marks_seen = N - 1 if others is None else others, N if marks is None else marks
    length = 4 + 2 * marks_seen + (2 + WORD) * others_seen
    observe = observer(others, marks)
    is_paid = not curriculum or curriculum_stage == LAST_STAGE
    numbers = (local_ratio, max_cycles, float(is_paid), int(terminate_on_success))
    return Kernel(
        name="spread_v0",
        agents=[f"agent_{i}" for i in range(N)],
        observation_space=p.seen_space(length),
        action_space=p.action_space(continuous=continuous_actions),
        state=p.bodies(N, N),
        tables=np.array([numbers], NUMBERS),
        reset=reset,
        step=step_by if continuous_actions else step,
        observe=observe,
        inform=inform,
        info=[("collisions", "i8"), ("uncovered", "i8")],
        overview=bearings.overview_of(observe, [(N, length)]),
        state_space=p.seen_space(N * length),
        terms=("cover", "collision"),
        endings=("covered",),
        horizon=max_cycles,
    )


class Spread(ParticleTicks):
    """Agents `agent_0`, ... and as many landmarks; observations are [length] float32.

    Args:
        N: agents, and landmarks.
        local_ratio: part of the reward that is an agent's own.
        max_cycles: ticks after which all are truncated.
        continuous_actions: actions are five numbers from 0 to 1, in place of one of five moves.
        dynamic_rescaling: discs shrink in a picture as the world in it grows.
        curriculum: overlaps cost nothing before the last stage.
        curriculum_stage: 0 or 1; each stage is an environment of its own (in mpe2 1.1.1 the
            stage stays 0: its base class's property swallows every other).
        terminate_on_success: the episode ends once every landmark is covered.
        num_agent_neighbors, num_landmark_neighbors: numbers of others and landmarks that an agent
            sees, the nearest first; None: all.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python.
    Raises:
        SpecError: an argument is out of its range.
    """

    metadata = metadata_of("spread_v0", fps=10)
    contract = "spread.toml"
    policies = {"reference": spread_reference, "greedy": spread_greedy, "lazy": lazy}  # noqa: RUF012  # PettingZoo declares it so

    def __init__(
        self,
        *,
        N: int = 3,  # noqa: N803  # as mpe2 calls it
        dynamic_rescaling: bool = True,
        render_mode: str | None = None,
        debug: bool = False,
        **arguments: Unpack[SpreadArguments],
    ) -> None:
        super().__init__(
            spread_kernel(N=N, **arguments),
            radii=[SIZE] * N + [p.MARK_SIZE] * N,
            colors=[BLUE] * N + [STONE] * N,
            render_mode=render_mode,
            dynamic_rescaling=dynamic_rescaling,
            debug=debug,
        )
