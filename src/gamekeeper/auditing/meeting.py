"""Policies that bring agents together: to one place, one target, one action.

Agents that choose at random hardly ever compete. These learn within the episode what each action
does to the agent's own observation, and steer several agents to one value of the numbers that
actions move: another agent's, another object's (numbers beside them), the middle, an end, zero or
any that was seen. Where nothing can be learned, agents of equal action spaces do the same for a
while.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete, Space

from gamekeeper.contract import Contract
from gamekeeper.interface.action_mask import Reader, legal_flags, reader
from gamekeeper.interface.capture import AgentId
from gamekeeper.rollouts.episode_loop import ActionChooser
from gamekeeper.statistics.significance import FloatArray

MOST_NUMBERS: Final = 512
"""Numbers of an observation; larger ones are pictures, and nothing is learned of them."""
MOST_ACTIONS: Final = 64
MOST_STEERED: Final = 6
"""Numbers that are steered at once."""
LEAST: Final = 3
"""Tries of an action before its effect is taken for known."""
PLAIN: Final = 0.3
"""Part of what moves a number that the choice of the action must explain."""
LEARNING: Final = 12
"""First ticks, in which all choose at random."""
PHASES: Final = ((4, 12), (8, 40))
"""Least and most ticks of a phase of equal actions, and of one that steers."""
IDLE: Final = 0.15
"""Chance of a random action on the way."""
STAY: Final = 6
"""Ticks at the target, each agent's, after which the next phase begins."""
ARRIVED: Final = 0.6
"""Distance from the target, in steps, below which all stay, or act alike or at random, in turn."""


@dataclass(slots=True)
class OwnEffects:
    """Mean effect of each action on the numbers of an agent's own observation.

    Attributes:
        counts: [actions] tries of each.
        sums: [actions, numbers] of what they changed.
        squares: [numbers] sum of the squared changes.
        low: [numbers] the least seen.
        high: [numbers] the largest seen.
    """

    counts: FloatArray
    sums: FloatArray
    squares: FloatArray
    low: FloatArray
    high: FloatArray

    def add(self, action: int, before: FloatArray, after: FloatArray) -> None:
        """Learns from one step."""
        change = after - before
        self.counts[action] += 1
        self.sums[action] += change
        self.squares += change * change
        np.minimum(self.low, after, out=self.low)
        np.maximum(self.high, after, out=self.high)

    def means(self) -> FloatArray:
        """[actions, numbers] mean changes; 0 of an action that was hardly tried."""
        known = self.counts >= LEAST
        means: FloatArray = self.sums / np.maximum(self.counts, 1)[:, None] * known[:, None]
        return means

    def steered(self) -> list[int]:
        """The numbers that the choice of the action moves both ways, those it explains best.

        A number that no action raises, such as fuel, or none lowers, such as a clock, can't be
        steered back to where another agent's is.
        """
        means, total = self.means(), max(float(self.counts.sum()), 1.0)
        both_ways = (means.max(axis=0) > 0) & (means.min(axis=0) < 0)
        explained = (self.counts[:, None] * (means - means.mean(axis=0)) ** 2).sum(axis=0)
        share = explained * both_ways / np.maximum(self.squares, 1e-12)
        best = [k for k in np.argsort(-share, kind="stable") if share[k] > PLAIN]
        is_seen = total >= LEAST * 2
        return sorted(int(k) for k in best[:MOST_STEERED]) if is_seen else []


@dataclass(slots=True)
class MeetingPhase:
    """Plan for some ticks.

    Attributes:
        left: ticks to go.
        kind: `random`, `alike` or `meet`.
        members: agents that take part; the others choose at random.
        numbers: places in the observation that are steered.
        target: their wanted values.
        arrived: agent ticks that were spent there.
    """

    left: int = 0
    kind: str = "random"
    members: frozenset[Any] = frozenset()
    numbers: list[int] = field(default_factory=list)
    target: FloatArray = field(default_factory=lambda: np.zeros(0))
    arrived: int = 0


class MeetingPolicies:
    """Chooses for all agents as `base` does, or so that they meet."""

    def __init__(
        self,
        base: ActionChooser,
        space_of: Callable[[AgentId], Space[Any]],
        mask_of: Callable[[AgentId], Reader],
    ) -> None:
        self._base, self._space_of, self._mask_of = base, space_of, mask_of
        self.begin(0, 0)

    def begin(self, run_seed: int, episode: int) -> None:
        """Forgets what was learned, and seeds the policies."""
        self._base.begin(run_seed, episode)
        self._rng = np.random.default_rng([17, run_seed, episode])
        self._effects: dict[Any, OwnEffects] = {}
        self._last: dict[Any, tuple[FloatArray, int | None]] = {}
        self._acted: set[Any] = set()
        self._tick = 0
        self._phase = MeetingPhase()
        self._alike: dict[str, Any] = {}

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """Returns the action of `agent`."""
        if agent in self._acted:
            self._next_tick()
        self._acted.add(agent)
        usual = self._base.act(agent, observation, info)
        space = self._space_of(agent)
        values = vector(observation)
        self._learn(agent, space, values)
        action = self._wanted(agent, space, values, usual)
        if action is not usual and not self._is_legal(agent, space, action, observation, info):
            action = usual
        place = int(action) - int(space.start) if isinstance(space, Discrete) else None
        self._last[agent] = values, place
        return action

    def _next_tick(self) -> None:
        self._acted, self._alike = set(), {}
        self._tick += 1
        self._phase.left -= 1
        if self._tick >= LEARNING and self._phase.left <= 0:
            self._phase = self._new_phase()

    def _learn(self, agent: AgentId, space: Space[Any], values: FloatArray) -> None:
        known = self._last.get(agent)
        if known is None or known[1] is None or known[0].shape != values.shape:
            return
        if not len(values) or not isinstance(space, Discrete) or space.n > MOST_ACTIONS:
            return
        key = (str(space), len(values))
        if key not in self._effects:
            shape = (int(space.n), len(values))
            zeros = np.zeros(shape[1])
            self._effects[key] = OwnEffects(
                np.zeros(shape[0]), np.zeros(shape), zeros, values.copy(), values.copy()
            )
        self._effects[key].add(known[1], known[0], values)

    def _new_phase(self) -> MeetingPhase:
        rng, names = self._rng, list(self._last)
        many = rng.random() < 0.6 or len(names) < 3
        members = names if many else [names[k] for k in rng.permutation(len(names))[:2]]
        chance = rng.random()
        guide = names[int(rng.integers(len(names)))] if names else None
        if guide is not None and chance < 0.6:
            values = self._last[guide][0]
            effects = self._effects.get((str(self._space_of(guide)), len(values)))
            numbers = effects.steered() if effects is not None else []
            if effects is not None and numbers:
                target = self._target(effects, numbers, values)
                length = int(rng.integers(*PHASES[1]))
                return MeetingPhase(length, "meet", frozenset(members), numbers, target)
        kind = "alike" if chance < 0.85 else "random"
        return MeetingPhase(int(rng.integers(*PHASES[0])), kind, frozenset(members))

    def _target(self, effects: OwnEffects, numbers: list[int], values: FloatArray) -> FloatArray:
        """Values to steer to: of another, of an object beside, the middle, zero, or any."""
        rng, at = self._rng, np.array(numbers)
        low, high = effects.low[at], effects.high[at]
        kind = int(rng.integers(7))
        if kind <= 1:
            shifts = [s for s in range(-at[0], len(values) - at[-1]) if s]
            others = [values[at + s] for s in shifts]
            inside = [v for v in others if (v >= low - 1).all() and (v <= high + 1).all()]
            if inside:
                return np.array(inside[int(rng.integers(len(inside)))])
        if kind in (2, 3):
            middle = (low + high) / 2
            is_whole = bool((values[at] == np.rint(values[at])).all())
            return np.floor(middle + int(rng.integers(2)) / 2) if is_whole else np.array(middle)
        if kind == 4:
            return np.array(values[at])
        if kind == 5:
            is_relative = ((low < 0) & (high > 0)).all()
            ends = np.where(rng.integers(2, size=len(at)) > 0, high, low)
            return np.zeros(len(at)) if is_relative else np.array(ends)
        return np.array(rng.uniform(low, high))

    def _wanted(self, agent: AgentId, space: Space[Any], values: FloatArray, usual: Any) -> Any:
        phase = self._phase
        if agent not in phase.members or phase.kind == "random":
            return usual
        if phase.kind == "alike":
            return self._alike.setdefault(str(space), usual)
        effects = self._effects.get((str(space), len(values)))
        if effects is None or not isinstance(space, Discrete) or self._rng.random() < IDLE:
            return usual
        means = effects.means()[:, phase.numbers]
        step = np.maximum(np.abs(means).max(axis=0), 1e-9)
        apart = (values[phase.numbers] - phase.target) / step
        if np.abs(apart).max() <= ARRIVED:
            phase.arrived += 1
            if phase.arrived >= STAY * len(phase.members):
                phase.left = 0
            if self._tick % 2:  # else they stay: all of the actions that keep them there
                return self._alike.setdefault(str(space), usual) if self._tick % 4 == 1 else usual
        cost = ((apart + means / step) ** 2).sum(axis=1)
        cost = cost + (effects.counts < LEAST) * 1e6
        best = np.flatnonzero(cost <= cost.min() + 1e-6)
        place = int(best[int(self._rng.integers(len(best)))])
        return space.dtype.type(place + int(space.start))

    def _is_legal(
        self, agent: AgentId, space: Space[Any], action: Any, observation: Any, info: Any
    ) -> bool:
        mask = self._mask_of(agent)(observation, info)
        if mask is None:
            return True
        if not isinstance(space, Discrete):
            return False
        return bool(legal_flags(mask, int(space.n))[int(action) - int(space.start)])


def meeting(contract: Contract, base: ActionChooser, env: Any) -> MeetingPolicies:
    """Policies in place of `base` that bring the agents of `env` together."""
    return MeetingPolicies(
        base, env.action_space, cache(lambda agent: reader(contract.mask_of(agent)))
    )


def vector(value: Any) -> FloatArray:
    """The numbers of an observation in a row; none where they are too many."""
    found = _numbers(value)
    return found if len(found) <= MOST_NUMBERS else np.zeros(0)


def _numbers(value: Any) -> FloatArray:
    if isinstance(value, dict):
        parts = [_numbers(value[key]) for key in sorted(value, key=str) if key != "action_mask"]
    elif isinstance(value, list | tuple):
        parts = [_numbers(each) for each in value]
    elif isinstance(value, np.ndarray | np.number | bool | int | float):
        array = np.asarray(value)
        if array.dtype.kind not in "biuf" or array.size > MOST_NUMBERS:
            return np.zeros(0)
        return np.nan_to_num(array.astype(np.float64).ravel())
    else:
        parts = []
    return np.concatenate(parts) if parts else np.zeros(0)
