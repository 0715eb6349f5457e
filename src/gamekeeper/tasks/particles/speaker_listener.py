"""A speaker that can't move tells a listener that can't speak which landmark to go to.

    R1. The goal is a random one of three landmarks; speaker, listener and landmarks are at random
        places in [-1, 1] on both axes, the listener at rest.
    R2. The listener moves as told in `particles` (P1, P2); nothing collides. What the speaker says
        in a tick is heard after it: one of three words, or of continuous actions three numbers.
    R3. After each tick both are paid minus the square of how far the listener is from the goal
        ("goal").
    R4. The speaker sees the goal's colour; the listener its velocity, the places of landmarks from
        where it stands, and what was said.
    R5. After `max_cycles` ticks (the contract's, 25, unless given) both are truncated ("horizon").

Equal to mpe2's `simple_speaker_listener_v4` but for the random goal and places (ours are drawn from
our Stream, in the same order) and the info `distance`: how far the listener is from the goal.

Source: mpe2 1.1.1, `simple_speaker_listener`; Lowe et al. 2017, "Multi-Agent Actor-Critic for Mixed
Cooperative-Competitive Environments".
"""

from typing import Final

import numpy as np
from gymnasium.spaces import Box, Discrete

from gamekeeper.kernels import draws
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.scalar_rules import inlined, rule
from gamekeeper.tasks.drawing import STONE, Color, metadata_of
from gamekeeper.tasks.particles import bearings
from gamekeeper.tasks.particles import physics as p
from gamekeeper.tasks.particles.particle_env import ParticleTicks, shade, spoken
from gamekeeper.tasks.particles.scripted_policies import (
    lazy,
    speaker_listener_greedy,
    speaker_listener_reference,
)

SPEAKER, LISTENER = range(2)
AGENTS: Final = ("speaker_0", "listener_0")
MARKS: Final = 3
WORDS: Final = 3
COLORS: Final = np.array([(0.65, 0.15, 0.15), (0.15, 0.65, 0.15), (0.15, 0.15, 0.65)])
"""Colours of landmarks, red first, by which the speaker sees the goal."""
SIZE, MARK_SIZE = 0.075, 0.04
"""Radii of agents and of landmarks."""
LIGHTER: Final = 0.45
"""Number by which the listener's colour is lighter than its goal's."""
SEEN: Final = 2 + 2 * MARKS + WORDS


@rule
def reset(s):  # type: ignore[no-untyped-def]  # a rule's types are found when it compiles
    """Draws goal and places (R1)."""
    s.goal = draws.integers(s, MARKS)
    p.scatter(s, 1.0)


@inlined
def after(s, rewards):  # type: ignore[no-untyped-def]  # likewise
    """Moves the listener, and pays both (R2, R3)."""
    p.drift(s, LISTENER)
    dx = s.x[LISTENER] - s.mark_x[s.goal]
    dy = s.y[LISTENER] - s.mark_y[s.goal]
    for i in range(2):
        rewards[i, 0] = -(dx * dx + dy * dy)


@rule
def step(s, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """Plays a tick of discrete actions."""
    for word in range(WORDS):
        s.said[word] = 0.0
    s.said[actions[SPEAKER][0]] = 1.0
    p.steer(s, LISTENER, actions[LISTENER][0], p.STRENGTH)
    after(s, rewards)


@rule
def step_by(s, actions, rewards, terminated, truncated):  # type: ignore[no-untyped-def]  # likewise
    """Plays a tick of continuous actions."""
    for word in range(WORDS):
        s.said[word] = actions[SPEAKER][0, word]
    p.steer_by(s, LISTENER, actions[LISTENER], 0, p.STRENGTH)
    after(s, rewards)


@rule
def observe(s, obs):  # type: ignore[no-untyped-def]  # likewise
    """Shows the speaker the goal, and the listener landmarks and words (R4)."""
    for channel in range(3):
        obs[SPEAKER][0, channel] = COLORS[s.goal, channel]
    seen = obs[LISTENER]
    at = bearings.show_pair(seen, 0, 0, s.vx[LISTENER], s.vy[LISTENER])
    at = bearings.show_marks(s, LISTENER, seen, 0, at)
    for word in range(WORDS):
        seen[0, at + word] = s.said[word]


@rule
def inform(s, infos):  # type: ignore[no-untyped-def]  # likewise
    """Tells the listener's distance from the goal."""
    for i in range(2):
        infos[i].distance = p.away(s, LISTENER, s.goal)


def speaker_listener_kernel(
    *, max_cycles: int = p.HORIZON, continuous_actions: bool = False
) -> Kernel:
    """The rules; arguments as of `SpeakerListener`.

    Raises:
        SpecError: an argument is out of its range.
    """
    p.check_counts(max_cycles=max_cycles)
    says = Box(0.0, 1.0, (WORDS,), np.float32) if continuous_actions else Discrete(WORDS)
    moves = p.action_space(continuous=continuous_actions)
    return Kernel(
        name="speaker_listener_v0",
        agents=AGENTS,
        observation_space=dict(zip(AGENTS, (p.seen_space(3), p.seen_space(SEEN)), strict=True)),
        action_space=dict(zip(AGENTS, (says, moves), strict=True)),
        state=[*p.bodies(2, MARKS), ("goal", "i8"), ("said", "f4", (WORDS,))],
        reset=reset,
        step=step_by if continuous_actions else step,
        observe=observe,
        inform=inform,
        info=[("distance", "f8")],
        overview=overview,
        state_space=p.seen_space(3 + SEEN),
        terms=("goal",),
        horizon=max_cycles,
    )


@rule
def overview(s, state):  # type: ignore[no-untyped-def]  # likewise
    """Shows both observations, one behind the other."""
    observe(s, (state[:3].reshape((1, 3)), state[3:].reshape((1, SEEN))))


class SpeakerListener(ParticleTicks):
    """Agents `speaker_0` and `listener_0`; observations are [3] and [11] float32.

    Args:
        max_cycles: ticks after which both are truncated.
        continuous_actions: actions are three and five numbers from 0 to 1, in place of one of three
            words and one of five moves.
        dynamic_rescaling: discs shrink in a picture as the world in it grows.
        render_mode: `ansi`, `rgb_array` or None.
        debug: the rules run as plain Python.
    Raises:
        SpecError: an argument is out of its range.
    """

    metadata = metadata_of("speaker_listener_v0", fps=10)
    contract = "speaker_listener.toml"
    policies = {  # noqa: RUF012  # PettingZoo declares it so
        "reference": speaker_listener_reference,
        "greedy": speaker_listener_greedy,
        "lazy": lazy,
    }

    def __init__(
        self,
        *,
        max_cycles: int = p.HORIZON,
        continuous_actions: bool = False,
        dynamic_rescaling: bool = True,
        render_mode: str | None = None,
        debug: bool = False,
    ) -> None:
        super().__init__(
            speaker_listener_kernel(max_cycles=max_cycles, continuous_actions=continuous_actions),
            radii=[SIZE] * 2 + [MARK_SIZE] * MARKS,
            colors=[STONE, STONE, *map(shade, COLORS)],
            render_mode=render_mode,
            dynamic_rescaling=dynamic_rescaling,
            debug=debug,
        )

    def tint(self) -> list[Color]:
        """The listener has a lighter shade of its goal's colour."""
        goal = int(self.memory.records["goal"][0])
        return [STONE, shade(COLORS[goal] + LIGHTER), *self.colors[2:]]

    def notes(self) -> list[str]:
        """Words that were said, a line each."""
        return [f"speaker_0 says {spoken(self.memory.records['said'][0])}"]
