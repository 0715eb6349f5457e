"""Slow adversaries chase faster prey among obstacles; bodies push each other.

    R1. Agents begin at random places in [-1, 1] on both axes, at rest, adversaries first; obstacles
        lie at random places in [-0.9, 0.9].
    R2. All agents move at once; how is told in `particles` (P1 to P3). Adversaries are larger,
        weaker and slower at most (ADVERSARY), prey is GOOD; a curriculum slows it further.
        Everything collides, and obstacles don't move.
    R3. After each tick, for each of the prey and each adversary that overlap, every adversary is
        paid CATCH ("catch") and that prey -CATCH ("caught").
    R4. Prey pays for being far out, on each axis: nothing within 0.9 of the middle, up to 1.0 ten
        times what it is beyond 0.9, beyond that exp(2 x - 2), at most 10 ("bound").
    R5. An agent sees its velocity, its place, and from where it stands the places of obstacles and
        of other agents; then the velocities of other prey. With `num_landmark_neighbors` or
        `num_agent_neighbors` it sees so many of the nearest of these, the nearest first, zeros
        where there are fewer, and for each agent seen its velocity, or zeros if an adversary.
    R6. After `max_cycles` ticks (the contract's, 25, unless given) all are truncated ("horizon").
    R7. With `terminate_on_success`, where before that every one of the prey overlaps an adversary,
        all are terminated ("caught").

Equal to mpe2's `simple_tag_v3` but for the random places (ours are drawn from our Stream, in the
same order) and the infos: `collisions`, how many of the other side an agent overlaps.

Source: mpe2 1.1.1, `simple_tag`; Lowe et al. 2017, "Multi-Agent Actor-Critic for Mixed
Cooperative-Competitive Environments".
"""

import math
from typing import Any, Final, Unpack

import numpy as np

from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import inlined, rule
from gamekeeper.tasks.arguments import check_whole
from gamekeeper.tasks.drawing import GREEN, INK, RED, metadata_of
from gamekeeper.tasks.particles import bearings
from gamekeeper.tasks.particles import physics as p
from gamekeeper.tasks.particles.particle_env import ParticleArguments, ParticleTicks
from gamekeeper.tasks.particles.scripted_policies import Chase, lazy

ADVERSARY: Final = (0.075, 3.0, 1.0)
GOOD: Final = (0.05, 4.0, 1.3)
"""Radius, force of a move, top speed."""
OBSTACLE: Final = 0.2
"""Radius of an obstacle."""
SPREAD: Final = 0.9
"""Greatest distance of an obstacle from the middle, along an axis."""
CATCH: Final = 10.0
"""Reward of an adversary for an overlap, and its price for prey."""
INNER, OUTER = 0.9, 1.0
MOST: Final = 10.0
"""Distances at which the price of being far out begins and grows faster, and the most it is."""
STAGES: Final = (0.5, 0.75, 1.0)
"""Strength and speed of prey at the stages of a curriculum, as part of GOOD."""


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Puts all bodies at random places (R1)."""
    p.scatter(s, SPREAD)


@inlined
def move(s, t):  # type: ignore[no-untyped-def]  # likewise
    """Lets bodies push each other, and moves agents (R2)."""
    n = len(s.x)
    for i in range(n):
        for j in range(i + 1, n):
            p.push_agents(s, i, j, t.radius[i] + t.radius[j])
        for k in range(len(s.mark_x)):
            p.push_off(s, i, k, t.radius[i] + OBSTACLE)
    for i in range(n):
        p.drift(s, i)
        p.slow_down(s, i, t.top[i])


@inlined
def overlap(s, t, i, j):  # type: ignore[no-untyped-def]  # likewise
    """True if two agents overlap."""
    return p.apart(s, i, j) < t.radius[i] + t.radius[j]


@inlined
def price(far):  # type: ignore[no-untyped-def]  # likewise
    """Price of being so far out on an axis (R4)."""
    if far < INNER:
        return 0.0
    if far < OUTER:
        return (far - INNER) * 10
    return min(math.exp(2 * far - 2), MOST)


@inlined
def after(s, t, rewards, terminated):  # type: ignore[no-untyped-def]  # likewise
    """Moves bodies once forces are set, and pays agents (R2 to R4, R7)."""
    move(s, t)
    n, hunters = len(s.x), t.adversaries
    catches, caught = 0, 0
    for j in range(hunters, n):
        own = 0
        for i in range(hunters):
            own += 1 if overlap(s, t, i, j) else 0
        catches += own
        caught += 1 if own > 0 else 0
        rewards[j, 1] = -CATCH * own
        rewards[j, 2] = -price(abs(s.x[j])) - price(abs(s.y[j]))
    for i in range(hunters):
        rewards[i, 0] = CATCH * catches
    if t.ends_caught != 0 and s.time < t.max_cycles and caught == n - hunters:
        for i in range(n):
            terminated[i] = True
            s.ending[i] = 1


def stepper(steer: Any, *, by_role: bool) -> Any:
    """Returns `step(s, t, actions, rewards, terminated, truncated)`.

    Args:
        steer: `steer(s, i, actions, place, strength)`: one agent's action becomes a force.
        by_role: actions are two arrays, adversaries' and prey's.
    """

    @rule
    def step(s: Any, t: Any, actions: Any, rewards: Any, terminated: Any, truncated: Any) -> None:
        for i in range(len(s.x)):
            steer(s, i, actions, i, t.strength[i])
        after(s, t, rewards, terminated)

    @rule
    def step_by_role(
        s: Any, t: Any, actions: Any, rewards: Any, terminated: Any, truncated: Any
    ) -> None:
        for i in range(t.adversaries):
            steer(s, i, actions[0], i, t.strength[i])
        for i in range(t.adversaries, len(s.x)):
            steer(s, i, actions[1], i - t.adversaries, t.strength[i])
        after(s, t, rewards, terminated)

    return step_by_role if by_role else step


def observer(others: int | None, marks: int | None) -> Any:
    """Returns `observe(s, t, obs)` (R5), of so many others and marks each; None: of all."""
    show_marks, show_others = bearings.marks_shower(marks), bearings.others_shower(others)
    show_speeds = show_prey if others is None else speeds_shower(others)

    @inlined
    def show(s: Any, t: Any, i: Any, obs: Any, row: Any) -> None:
        at = bearings.show_self(s, i, obs, row)
        at = show_marks(s, i, obs, row, at)
        at = show_others(s, i, obs, row, at)
        show_speeds(s, t, i, obs, row, at)

    @rule
    def observe(s: Any, t: Any, obs: Any) -> None:
        for i in range(len(s.x)):
            show(s, t, i, obs, i)

    @rule
    def observe_by_role(s: Any, t: Any, obs: Any) -> None:
        for i in range(t.adversaries):
            show(s, t, i, obs[0], i)
        for i in range(t.adversaries, len(s.x)):
            show(s, t, i, obs[1], i - t.adversaries)

    return observe_by_role if others is None else observe


@inlined
def show_prey(s, t, i, obs, row, at):  # type: ignore[no-untyped-def]  # likewise
    """Shows the velocities of all other prey."""
    for j in range(t.adversaries, len(s.x)):
        if j != i:
            at = bearings.show_pair(obs, row, at, s.vx[j], s.vy[j])


def speeds_shower(count: int) -> Any:
    """Returns `show(s, t, i, obs, row, at)`: velocities of the nearest, zeros of adversaries."""

    @rule
    def show(s: Any, t: Any, i: Any, obs: Any, row: Any, at: Any) -> None:
        end = at + 2 * count
        last, far = bearings.NO_BODY, -1.0
        for _ in range(count):
            last, far = bearings.next_other(s, i, far, last)
            if last == bearings.NO_BODY:
                break
            is_prey = last >= t.adversaries
            x, y = s.vx[last] if is_prey else 0.0, s.vy[last] if is_prey else 0.0
            at = bearings.show_pair(obs, row, at, x, y)
        bearings.show_nothing(obs, row, at, end)

    return show


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """Counts the agents of the other side that each agent overlaps."""
    hunters = t.adversaries
    for i in range(len(s.x)):
        count = 0
        for j in range(len(s.x)):
            count += 1 if (i < hunters) != (j < hunters) and overlap(s, t, i, j) else 0
        infos[i].collisions = count


def tag_kernel(
    *,
    num_good: int = 1,
    num_adversaries: int = 3,
    num_obstacles: int = 2,
    max_cycles: int = p.HORIZON,
    continuous_actions: bool = False,
    curriculum: bool = False,
    curriculum_stage: int = 0,
    terminate_on_success: bool = False,
    num_agent_neighbors: int | None = None,
    num_landmark_neighbors: int | None = None,
) -> Kernel:
    """The rules for so many bodies; arguments as of `Tag`.

    Raises:
        SpecError: an argument is out of its range.
    """
    check_whole("curriculum_stage", curriculum_stage, 0, len(STAGES) - 1)
    check_whole("num_obstacles", num_obstacles, 0, p.MOST)
    others, marks = num_agent_neighbors, num_landmark_neighbors
    p.check_counts(
        num_good=num_good,
        num_adversaries=num_adversaries,
        max_cycles=max_cycles,
        num_agent_neighbors=others,
        num_landmark_neighbors=marks,
    )
    names = [f"adversary_{i}" for i in range(num_adversaries)]
    names += [f"agent_{i}" for i in range(num_good)]
    length = 4 + 2 * (num_obstacles if marks is None else marks)
    each = len(names) - 1 if others is None else others
    hunter = length + 2 * each + 2 * (num_good if others is None else others)
    prey = hunter - 2 if others is None else hunter
    lengths = {a: hunter if a in names[:num_adversaries] else prey for a in names}
    observe = observer(others, marks)
    shapes = [(num_adversaries, hunter), (num_good, prey)]
    speed = STAGES[curriculum_stage] if curriculum else 1.0
    return Kernel(
        name="tag_v0",
        agents=names,
        observation_space={agent: p.seen_space(lengths[agent]) for agent in names},
        action_space=p.action_space(continuous=continuous_actions),
        state=p.bodies(len(names), num_obstacles),
        tables=numbers_of(
            num_adversaries, num_good, speed, max_cycles, is_short=terminate_on_success
        ),
        reset=reset,
        step=stepper(p.steer_by if continuous_actions else p.steer_as, by_role=others is None),
        observe=observe,
        inform=inform,
        info=[("collisions", "i8")],
        overview=bearings.overview_of(
            observe, shapes if others is None else [(len(names), hunter)]
        ),
        state_space=p.seen_space(sum(lengths.values())),
        terms=("catch", "caught", "bound"),
        endings=("caught",),
        horizon=max_cycles,
    )


def numbers_of(
    adversaries: int, good: int, speed: float, max_cycles: int, *, is_short: bool
) -> Any:
    """Returns the tables: bodies' sizes, forces and speeds, their numbers, the episode's end."""
    n = adversaries + good
    tables = np.zeros(
        1,
        [
            ("radius", "f8", (n,)),
            ("strength", "f8", (n,)),
            ("top", "f8", (n,)),
            ("adversaries", "i8"),
            ("max_cycles", "i8"),
            ("ends_caught", "i8"),
        ],
    )
    prey = (GOOD[0], GOOD[1] * speed, GOOD[2] * speed)
    for name, hunter, quarry in zip(("radius", "strength", "top"), ADVERSARY, prey, strict=True):
        tables[name][0] = [hunter] * adversaries + [quarry] * good
    tables["adversaries"], tables["max_cycles"] = adversaries, max_cycles
    tables["ends_caught"] = is_short
    return tables


class Tag(ParticleTicks):
    """Adversaries `adversary_0`, ... and prey `agent_0`, ...; observations are [length] float32.

    Args:
        num_good: number of prey.
        num_adversaries: number of agents that chase them.
        num_obstacles: number of bodies that stand in the way.
        max_cycles: ticks after which all are truncated.
        continuous_actions: actions are five numbers from 0 to 1, in place of one of five moves.
        dynamic_rescaling: discs shrink in a picture as the world in it grows.
        curriculum: prey is slower before the last stage.
        curriculum_stage: 0 to 2; each stage is an environment of its own (in mpe2 1.1.1 the
            stage stays 0: its base class's property swallows every other).
        terminate_on_success: the episode ends once all prey is caught at the same time.
        num_agent_neighbors, num_landmark_neighbors: numbers of others and obstacles that an agent
            sees, the nearest first; None: all.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python.
    Raises:
        SpecError: an argument is out of its range.
    """

    metadata = metadata_of("tag_v0", fps=10)
    contract = "tag.toml"

    def __init__(
        self,
        *,
        num_good: int = 1,
        num_adversaries: int = 3,
        num_obstacles: int = 2,
        dynamic_rescaling: bool = True,
        render_mode: str | None = None,
        debug: bool = False,
        **arguments: Unpack[ParticleArguments],
    ) -> None:
        kernel = tag_kernel(
            num_good=num_good,
            num_adversaries=num_adversaries,
            num_obstacles=num_obstacles,
            **arguments,
        )
        marks = [OBSTACLE] * num_obstacles
        super().__init__(
            kernel,
            radii=[*kernel.tables["radius"][0].tolist(), *marks],
            colors=[RED] * num_adversaries + [GREEN] * num_good + [INK] * num_obstacles,
            render_mode=render_mode,
            dynamic_rescaling=dynamic_rescaling,
            debug=debug,
        )
        counts = num_adversaries, num_good, num_obstacles
        self.policies = {
            "reference": Chase(*counts, is_bold=True),
            "greedy": Chase(*counts, is_bold=False),
            "lazy": lazy,
        }
