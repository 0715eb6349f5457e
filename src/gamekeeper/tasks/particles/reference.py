"""Two agents go each to a landmark that the other alone knows: both speak and both move.

    R1. Each agent's goal is a random one of three landmarks; agents and landmarks begin at random
        places in [-1, 1] on both axes, agents at rest.
    R2. Both move at once and nothing collides; how they move is told in `particles` (P1, P2). What
        an agent says in a tick is heard after it: one of WORDS words (P4).
    R3. A discrete action is 5 times the word, plus the move; a continuous one is five numbers for
        the move and WORDS for the word.
    R4. After each tick an agent is paid `local_ratio` times minus how far the other is from the
        landmark that the agent knows of ("goal"), and 1 - `local_ratio` times the mean of these
        over both ("team").
    R5. An agent sees its velocity, the places of landmarks from where it stands, the colour of the
        landmark that the other looks for, and what the other said.
    R6. After `max_cycles` ticks (the contract's, 25, unless given) both are truncated ("horizon").

Equal to mpe2's `simple_reference_v3` but for the random goals and places (ours are drawn from our
Stream, in the same order) and the info `distance`: how far the agent itself is from its goal.

Source: mpe2 1.1.1, `simple_reference`; Mordatch & Abbeel 2017, "Emergence of Grounded Compositional
Language in Multi-Agent Populations".
"""

from typing import Final

import numpy as np

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import inlined, rule
from gamekeeper.tasks.arguments import check_part
from gamekeeper.tasks.drawing import Color, metadata_of
from gamekeeper.tasks.particles import bearings
from gamekeeper.tasks.particles import physics as p
from gamekeeper.tasks.particles.particle_env import ParticleTicks, shade, spoken
from gamekeeper.tasks.particles.scripted_policies import lazy, reference_greedy, reference_reference

MARKS: Final = 3
WORDS: Final = 10
COLORS: Final = np.array([(0.75, 0.25, 0.25), (0.25, 0.75, 0.25), (0.25, 0.25, 0.75)])
"""Colours of landmarks, red first, by which an agent sees a goal."""
LENGTH: Final = 2 + 2 * MARKS + 3 + WORDS


@rule
def reset(s, t):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Draws goals and places (R1)."""
    for i in range(2):
        s.goal[i] = draws.integers(s, MARKS)
    p.scatter(s, 1.0)


@inlined
def after(s, t, rewards):  # type: ignore[no-untyped-def]  # likewise
    """Moves both, and pays them (R2, R4)."""
    for i in range(2):
        p.drift(s, i)
    first, second = -p.away(s, 1, s.goal[0]), -p.away(s, 0, s.goal[1])
    for i in range(2):
        rewards[i, 0] = (first + second) / 2 * (1 - t.local_ratio)
        rewards[i, 1] = (first if i == 0 else second) * t.local_ratio


@rule
def step(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """Plays a tick of discrete actions (R3)."""
    for i in range(2):
        p.steer(s, i, actions[i] % p.MOVES, p.STRENGTH)
        for word in range(WORDS):
            s.said[i, word] = 0.0
        s.said[i, actions[i] // p.MOVES] = 1.0
    after(s, t, rewards)


@rule
def step_by(s, t, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """Plays a tick of continuous actions (R3)."""
    for i in range(2):
        p.steer_by(s, i, actions, i, p.STRENGTH)
        for word in range(WORDS):
            s.said[i, word] = actions[i, p.MOVES + word]
    after(s, t, rewards)


@rule
def observe(s, t, obs):  # type: ignore[no-untyped-def]  # likewise
    """Shows agents what they see and hear (R5)."""
    for i in range(2):
        at = bearings.show_pair(obs, i, 0, s.vx[i], s.vy[i])
        at = bearings.show_marks(s, i, obs, i, at)
        for channel in range(3):
            obs[i, at + channel] = COLORS[s.goal[i], channel]
        for word in range(WORDS):
            obs[i, at + 3 + word] = s.said[1 - i, word]


@rule
def inform(s, t, infos):  # type: ignore[no-untyped-def]  # likewise
    """Tells each agent's distance from its own goal, which the other knows."""
    for i in range(2):
        infos[i].distance = p.away(s, i, s.goal[1 - i])


def reference_kernel(
    *, local_ratio: float = 0.5, max_cycles: int = p.HORIZON, continuous_actions: bool = False
) -> Kernel:
    """The rules; arguments as of `Reference`.

    Raises:
        SpecError: an argument is out of its range.
    """
    check_part("local_ratio", local_ratio)
    p.check_counts(max_cycles=max_cycles)
    return Kernel(
        name="reference_v0",
        agents=("agent_0", "agent_1"),
        observation_space=p.seen_space(LENGTH),
        action_space=p.action_space(continuous=continuous_actions, words=WORDS),
        state=[*p.bodies(2, MARKS), ("goal", "i8", (2,)), ("said", "f4", (2, WORDS))],
        tables=np.array([(local_ratio,)], [("local_ratio", "f8")]),
        reset=reset,
        step=step_by if continuous_actions else step,
        observe=observe,
        inform=inform,
        info=[("distance", "f8")],
        overview=bearings.overview_of(observe, [(2, LENGTH)]),
        state_space=p.seen_space(2 * LENGTH),
        terms=("team", "goal"),
        horizon=max_cycles,
    )


class Reference(ParticleTicks):
    """Agents `agent_0` and `agent_1`; observations are [21] float32.

    Args:
        local_ratio: part of the reward that is an agent's own.
        max_cycles: ticks after which both are truncated.
        continuous_actions: actions are fifteen numbers from 0 to 1, in place of one of fifty.
        dynamic_rescaling: discs shrink in a picture as the world in it grows.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python.
    Raises:
        SpecError: an argument is out of its range.
    """

    metadata = metadata_of("reference_v0", fps=10)
    contract = "reference.toml"
    policies = {  # noqa: RUF012  # PettingZoo declares it so
        "reference": reference_reference,
        "greedy": reference_greedy,
        "lazy": lazy,
    }

    def __init__(
        self,
        *,
        local_ratio: float = 0.5,
        max_cycles: int = p.HORIZON,
        continuous_actions: bool = False,
        dynamic_rescaling: bool = True,
        render_mode: str | None = None,
        debug: bool = False,
    ) -> None:
        kernel = reference_kernel(
            local_ratio=local_ratio, max_cycles=max_cycles, continuous_actions=continuous_actions
        )
        super().__init__(
            kernel,
            radii=[p.MARK_SIZE] * (2 + MARKS),
            colors=[shade(color) for color in COLORS[[0, 0, *range(MARKS)]]],
            render_mode=render_mode,
            dynamic_rescaling=dynamic_rescaling,
            debug=debug,
        )

    def tint(self) -> list[Color]:
        """Agents have the colours of their goals."""
        goals = self.memory.records["goal"][0].tolist()
        return [shade(COLORS[goals[1]]), shade(COLORS[goals[0]]), *self.colors[2:]]

    def notes(self) -> list[str]:
        """Words that were said, a line each."""
        said = self.memory.records["said"][0]
        return [f"{a} says {spoken(w)}" for a, w in zip(self.possible_agents, said, strict=True)]
