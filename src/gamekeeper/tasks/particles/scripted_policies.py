"""Scripted agents for worlds of particles: functions of what one agent is shown.

They know discrete actions, and observations that show every body. `reference` plays its task
as it is meant, `greedy` looks after itself alone, `lazy` does nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.tasks.particles.physics import DAMPING, DOWN, DT, LEFT, MOVES, NOTHING, RIGHT, UP

Seen = NDArray[np.float32]
Points = NDArray[np.float64]

GLIDE: Final = DT / DAMPING
"""Seconds of its velocity that a body still glides when nothing pushes it."""
NEAR: Final = 0.03
"""Distance within which an agent is at its goal."""
FEW: Final = 6
"""Most agents that try all ways to share out landmarks; more choose one after the other."""
EDGE: Final = 0.8
"""Distance beyond which fleeing prey turns back to the middle."""


def move_towards(way: Points, velocity: Points) -> int:
    """The move that shortens the way that is left after gliding out, along its longer axis."""
    x, y = (way - GLIDE * velocity).tolist()
    if max(abs(x), abs(y)) < NEAR:
        return NOTHING
    if abs(x) >= abs(y):
        return RIGHT if x > 0 else LEFT
    return UP if y > 0 else DOWN


def lazy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Does nothing."""
    return NOTHING


def _pairs(observation: Seen, first: int, count: int) -> Points:
    """So many places from number `first` on, [count, 2]."""
    return np.asarray(observation[first : first + 2 * count], np.float64).reshape(count, 2)


# -- spread


def spread_reference(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Goes where the shares of least total way send it; all agents work out the same shares."""
    n = len(observation) // 6
    me = int(agent.rpartition("_")[2])
    marks, others = _pairs(observation, 4, n), _pairs(observation, 4 + 2 * n, n - 1)
    bodies = np.insert(others, me, 0.0, axis=0)
    far = np.linalg.norm(bodies[:, None] - marks[None], axis=2).round(4)
    return move_towards(marks[_shares(far)[me]], _pairs(observation, 0, 1)[0])


def spread_greedy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Goes to the nearest landmark, whoever else does."""
    return _to_nearest(observation, _pairs(observation, 4, len(observation) // 6))


def _to_nearest(observation: Seen, marks: Points) -> int:
    nearest = int(np.linalg.norm(marks, axis=1).argmin())
    return move_towards(marks[nearest], _pairs(observation, 0, 1)[0])


def _shares(far: Points) -> list[int]:
    """A landmark for each agent; `far` is [agent, landmark]."""
    n = len(far)
    if n <= FEW:
        return list(
            min(permutations(range(n)), key=lambda p: sum(far[i, k] for i, k in enumerate(p)))
        )
    found, rest = [0] * n, far.copy()
    for _ in range(n):
        i, k = divmod(int(rest.argmin()), n)
        found[i] = k
        rest[i, :] = rest[:, k] = np.inf
    return found


# -- tag


@dataclass(frozen=True, slots=True)
class Chase:
    """Adversaries run after the nearest prey, and prey runs away.

    Args:
        hunters, prey, obstacles: how many there are of each.
        is_bold: adversaries run to where prey glides, and prey flees all of them and keeps within
            the edge; else both look at the nearest alone.
    """

    hunters: int
    prey: int
    obstacles: int
    is_bold: bool

    def __call__(
        self, observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator
    ) -> int:
        """The move of an agent."""
        own, place = _pairs(observation, 0, 2)
        first = 4 + 2 * self.obstacles
        others = _pairs(observation, first, self.hunters + self.prey - 1)
        if not agent.startswith("adversary"):
            return self._flee(place, others[: self.hunters])
        quarry = others[self.hunters - 1 :]
        if self.is_bold:
            quarry = quarry + GLIDE * _pairs(observation, first + 2 * len(others), self.prey)
        return move_towards(quarry[int(np.linalg.norm(quarry, axis=1).argmin())], own)

    def _flee(self, place: Points, threats: Points) -> int:
        far = np.linalg.norm(threats, axis=1)
        if not self.is_bold:
            return move_towards(-threats[int(far.argmin())], np.zeros(2))
        away = -(threats / np.maximum(far, NEAR)[:, None] ** 2).sum(axis=0)
        beyond = np.abs(place) > EDGE
        away[beyond] = -10.0 * place[beyond]
        return move_towards(away, np.zeros(2))


# -- reference, speaker_listener


def reference_reference(
    observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """Says which landmark the other's goal is, and goes to the one that it hears of."""
    goal = int(np.argmax(observation[8:11]))
    return goal * MOVES + _to_heard(observation, observation[11:14])


def reference_greedy(observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator) -> int:
    """Goes to the nearest landmark, and says nothing to the point."""
    return _to_nearest(observation, _pairs(observation, 2, 3))


def speaker_listener_reference(
    observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """The speaker names the goal, the listener goes to what is named."""
    if agent.startswith("speaker"):
        return int(np.argmax(observation))
    return _to_heard(observation, observation[8:11])


def speaker_listener_greedy(
    observation: Seen, agent: str, info: Mapping[str, Any], rng: Generator
) -> int:
    """The speaker says the same all the time, the listener goes to the nearest landmark."""
    if agent.startswith("speaker"):
        return 0
    return _to_nearest(observation, _pairs(observation, 2, 3))


def _to_heard(observation: Seen, word: Seen) -> int:
    """Towards the landmark that was named; nowhere before anything was."""
    if not word.any():
        return NOTHING
    way = _pairs(observation, 2, 3)[int(np.argmax(word))]
    return move_towards(way, _pairs(observation, 0, 1)[0])
