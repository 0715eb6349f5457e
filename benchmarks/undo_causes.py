"""Environments without knobs, and policies with one fault planted inside, for benchmarks/undo.py.

Nothing here uses the diagnosis' own code. A fault sits inside an agent's policy: between what it is
given and what it computes with, between its choice and its action, or in when it chooses. Whether
a set-up fails, and doesn't without its fault, is looked at by plain rollouts on seeds of their own,
by this rule, stated beforehand:

- *failing*: at most half of 24 episodes succeed, and 22 or more without the fault;
- *healthy*: 22 of 24 or more succeed.

Set-ups that don't come out so are none. *Undoable*: something outside the policy makes up for it.
"""

import copy
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import MultiDiscrete
from mpe2 import simple_speaker_listener_v4, simple_spread_v3
from pettingzoo.utils import BaseParallelWrapper, BaseWrapper
from undo_more_envs import DIGITS, Ants, Hoist, Safe, ants, hoist, safe

import gamekeeper as gk
from gamekeeper.episodes.outcome import failed, failures, outcome_of

EPISODES = 24
SEED = 555_000
SIDE = 6


class Berth(gk.TickEnv):
    """A caller sees a ship and its berth and says numbers; the ship's pilot hears them and moves.

    Parallel; observations and actions are MultiDiscrete. Both are paid 1 when the ship is there.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "berth_v0"}

    def __init__(self, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["caller", "pilot"]
        four = MultiDiscrete([SIDE] * 4)
        self.observation_spaces = {"caller": four, "pilot": four}
        self.action_spaces = {"caller": MultiDiscrete([SIDE] * 2), "pilot": MultiDiscrete([3] * 2)}

    def start(self, rng: Any, options: Any) -> None:
        """Draws a ship and a berth that lie apart."""
        while True:
            self.ship = [int(rng.integers(SIDE)) for _ in range(2)]
            self.berth = [int(rng.integers(SIDE)) for _ in range(2)]
            apart = [abs(a - b) for a, b in zip(self.ship, self.berth, strict=True)]
            if min(apart) >= 1 and self.berth[0] != self.berth[1]:
                break
        self.said, self.tick_number = [0, 0], 0

    def tick(self, actions: Any) -> None:
        """The caller's numbers are heard at the next tick; the ship moves at once."""
        self.tick_number += 1
        move = [int(each) - 1 for each in actions["pilot"]]
        self.ship = [min(max(a + d, 0), SIDE - 1) for a, d in zip(self.ship, move, strict=True)]
        self.said = [int(each) for each in actions["caller"]]
        if self.ship == self.berth:
            for agent in self.possible_agents:
                self.add_reward(agent, 1.0)
                self.terminate(agent, "docked")
        elif self.tick_number >= 12:
            for agent in self.possible_agents:
                self.truncate(agent, "late")

    def observe(self, agent: str) -> Any:
        """Ship and berth for the caller, ship and what was said for the pilot."""
        other = self.berth if agent == "caller" else self.said
        return np.array([*self.ship, *other], np.int64)


class ArrivedParallel(BaseParallelWrapper):  # type: ignore[type-arg]
    """Tells in the infos how far away the goals still are, as `left`."""

    def step(self, actions: Any) -> Any:
        """A tick, with `left`."""
        *out, infos = super().step(actions)
        return *out, {agent: {**info, "left": _left(self)} for agent, info in infos.items()}


class ArrivedAEC(BaseWrapper):  # type: ignore[type-arg]
    """The same in turns."""

    def step(self, action: Any) -> None:
        """A turn, with `left`."""
        super().step(action)
        for info in self.unwrapped.infos.values():
            info["left"] = _left(self)


def _left(env: Any) -> float:
    """Greatest distance of a goal to the nearest of those that should be there."""
    world = env.unwrapped.world
    goal = getattr(world.agents[0], "goal_b", None)
    marks = world.landmarks if goal is None else [goal]
    places = [agent.state.p_pos for agent in world.agents if agent.movable]
    return max(
        float(min(np.linalg.norm(mark.state.p_pos - place) for place in places)) for mark in marks
    )


def spread_parallel(**kwargs: Any) -> Any:
    """Two agents that cover two landmarks; Parallel."""
    return ArrivedParallel(simple_spread_v3.parallel_env(N=2, max_cycles=40, **kwargs))


def spread_aec(**kwargs: Any) -> Any:
    """The same in turns, with forces (Box) for actions."""
    env = simple_spread_v3.env(N=2, max_cycles=40, continuous_actions=True, **kwargs)
    return ArrivedAEC(env)


def speaker_aec(**kwargs: Any) -> Any:
    """A speaker that knows the goal and a listener that moves; AEC, with messages."""
    return ArrivedAEC(simple_speaker_listener_v4.env(max_cycles=40, **kwargs))


Act = Callable[[Any, str], Any]


def berth(observation: Any, agent: str) -> Any:
    """Says where the berth is; goes where the caller says."""
    first, second = np.asarray(observation[:2]), np.asarray(observation[2:])
    if agent == "caller":
        return np.array(second, np.int64)
    return np.array(np.sign(second - first) + 1, np.int64)


def _step(x: float, y: float, *, near: float = 0.04) -> int:
    """Action towards a place."""
    if max(abs(x), abs(y)) < near:
        return 0
    if abs(x) >= abs(y):
        return 2 if x > 0 else 1
    return 4 if y > 0 else 3


def _wanted(observation: Any) -> Any:
    """Way to the landmark that is this one's in the shortest assignment, velocity made up for."""
    velocity, marks = observation[0:2], np.reshape(observation[4:8], (2, 2))
    other = observation[8:10]
    mine, theirs = np.linalg.norm(marks, axis=1), np.linalg.norm(marks - other, axis=1)
    mark = 0 if mine[0] + theirs[1] <= mine[1] + theirs[0] else 1
    return marks[mark] - 0.6 * velocity


def spread(observation: Any, agent: str) -> Any:
    """Goes to its landmark."""
    return _step(*_wanted(observation))


def spread_box(observation: Any, agent: str) -> Any:
    """Goes to its landmark, by forces between 0 and 1 to the left, right, down and up."""
    x, y = np.clip(3.0 * _wanted(observation), -1.0, 1.0)
    return np.array([0.0, max(-x, 0), max(x, 0), max(-y, 0), max(y, 0)], np.float32)


def speaker(observation: Any, agent: str) -> Any:
    """The speaker says the color of the goal, and the listener goes there."""
    if agent.startswith("speaker"):
        return int(np.argmax(observation))
    said = observation[8:11]
    if not np.any(said):
        return 0
    place = 2 + 2 * int(np.argmax(said))
    return _step(*(observation[place : place + 2] - 0.6 * observation[0:2]))


# -- Faults


class Faulty:
    """A policy with a fault inside; new at every reset.

    Attributes:
        sees: from the observation to what it computes with.
        does: from its choice to its action.
        lag: turns that its actions wait.
        every: turns after which it chooses anew; it repeats itself in between.
        slip: probability that it does something else.
        noise: standard deviation of what is added to what it sees.
    """

    def __init__(
        self,
        act: Act,
        *,
        sees: Callable[[Any], Any] | None = None,
        does: Callable[[Any], Any] | None = None,
        lag: int = 0,
        every: int = 1,
        slip: float = 0.0,
        noise: float = 0.0,
        still: bool = False,
        actions: int = 5,
    ) -> None:
        """Plants it."""
        self.act, self.sees, self.does = act, sees, does
        self.lag, self.every, self.slip, self.noise = lag, every, slip, noise
        self.still, self.actions = still, actions
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forgets."""
        self.queue: deque[Any] = deque()
        self.count, self.last = 0, None

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> Any:
        """The action."""
        seen = np.array(observation)
        if self.noise:
            seen = seen + rng.normal(0.0, self.noise, seen.shape)
        if self.sees is not None:
            seen = self.sees(seen)
        if self.count % self.every == 0 or self.last is None:
            self.last = self.act(seen, agent)
        self.count += 1
        action = copy.copy(self.last)
        if self.slip and rng.random() < self.slip:
            action = int(rng.integers(self.actions))
        if self.still:
            action = action * 0 if isinstance(action, int) else np.zeros_like(action)
        if self.does is not None:
            action = self.does(action)
        self.queue.append(action)
        return self.queue.popleft() if len(self.queue) > self.lag else self.queue[0]


def swapped(one: int, two: int) -> Callable[[Any], Any]:
    """Two fields of an array exchanged."""

    def change(array: Any) -> Any:
        array = np.array(array)
        array[[one, two]] = array[[two, one]]
        return array

    return change


def mirrored(place: int, total: float) -> Callable[[Any], Any]:
    """One field of an array turned round."""

    def change(array: Any) -> Any:
        array = np.array(array)
        array[place] = total - array[place]
        return array

    return change


def scaled(factor: float) -> Callable[[Any], Any]:
    """All of an array times a factor."""
    return lambda array: np.asarray(array) * factor


def renamed(one: int, two: int) -> Callable[[int], int]:
    """Two actions exchanged."""
    return lambda action: {one: two, two: one}.get(action, action)


def mirrored_action(count: int) -> Callable[[int], int]:
    """Actions in the opposite order."""
    return lambda action: count - 1 - action


@dataclass(frozen=True)
class Planted:
    """A set-up, and what is wrong with it.

    Attributes:
        name: what it is.
        spec: the environment; `BERTH`: the one above.
        policies: by agent.
        failed: condition of a failed episode.
        agents: whose fault it is.
        labels: what it may be called; none: no boundary shows it.
        kind: `undoable`, `inside` (nothing outside makes up for it) or `healthy`.
    """

    name: str
    spec: Any
    policies: dict[str, Any]
    failed: str
    agents: tuple[str, ...]
    labels: tuple[str, ...]
    kind: str


@dataclass(frozen=True)
class Stack:
    """An environment with policies that do well in it."""

    spec: Any
    act: Act
    agents: tuple[str, ...]
    failed: str
    actions: int


FAR = "left > 0.2"
STACKS = {
    "berth": Stack(Berth, berth, ("caller", "pilot"), "return < 1", 3),
    "spread": Stack(spread_parallel, spread, ("agent_0", "agent_1"), FAR, 5),
    "spread, Box": Stack(spread_aec, spread_box, ("agent_0", "agent_1"), FAR, 5),
    "speaker, AEC": Stack(speaker_aec, speaker, ("speaker_0", "listener_0"), FAR, 5),
    "hoist": Stack(Hoist, hoist, ("winch_0", "winch_1", "trolley_0"), "return < 1", 0),
    "safe": Stack(Safe, safe, ("scout_0", "scout_1", "opener_0"), "return < 1", 0),
    "ants": Stack(Ants, ants, ("ant_0", "ant_1", "ant_2"), "return < 3", 6),
}

P, C, T = ("perception",), ("control",), ("timing",)
Fault = tuple[str, tuple[str, ...], dict[str, Any]]
"""What it is, its labels, and the arguments of `Faulty`."""

SPREAD_SIGHT: list[Fault] = [
    (f"fields {a} and {b} exchanged", P, {"sees": swapped(a, b)})
    for a, b in ((4, 5), (6, 7), (4, 6))
] + [(f"field {a} mirrored", P, {"sees": mirrored(a, 0)}) for a in (4, 5, 6, 7)]
NAMES: list[Fault] = [
    (f"actions {a} and {b} exchanged", C, {"does": renamed(a, b)})
    for a, b in ((1, 2), (3, 4), (1, 3), (2, 4))
]
LATE: list[Fault] = [
    ("acts 8 turns late", T, {"lag": 8}),
    ("acts 12 turns late", T, {"lag": 12}),
    ("chooses every 16th turn", T, {"every": 16}),
]
WINCH: list[Fault] = [
    ("fields 0 and 1 exchanged", P, {"sees": swapped(0, 1)}),
    ("field 1 mirrored", P, {"sees": mirrored(1, 0)}),
    ("axis mirrored", C, {"does": mirrored(0, 0)}),
    ("a tenth of the force", C, {"does": scaled(0.1)}),
    ("acts 10 turns late", T, {"lag": 10}),
    ("chooses every 12th turn", T, {"every": 12}),
]
TROLLEY: list[Fault] = [
    ("fields 0 and 2 exchanged", P, {"sees": swapped(0, 2)}),
    ("fields 2 and 3 exchanged", P, {"sees": swapped(2, 3)}),
    ("field 0 mirrored", P, {"sees": mirrored(0, 0)}),
    ("field 3 mirrored", P, {"sees": mirrored(3, 0)}),
    ("axis 0 mirrored", C, {"does": mirrored(0, 0)}),
    ("axis 1 mirrored", C, {"does": mirrored(1, 0)}),
    ("axes exchanged", C, {"does": swapped(0, 1)}),
    ("acts 10 turns late", T, {"lag": 10}),
    ("a tenth of the force", C, {"does": scaled(0.1)}),
]
SCOUT: list[Fault] = [
    ("field 0 mirrored", P, {"sees": mirrored(0, DIGITS - 1)}),
    ("fields 0 and 2 exchanged", P, {"sees": swapped(0, 2)}),
    ("axis 0 mirrored", C, {"does": mirrored(0, DIGITS - 1)}),
    ("axis 1 mirrored", C, {"does": mirrored(1, 1)}),
]
OPENER: list[Fault] = [
    ("field 0 mirrored", P, {"sees": mirrored(0, DIGITS - 1)}),
    ("field 1 mirrored", P, {"sees": mirrored(1, 1)}),
    ("field 2 mirrored", P, {"sees": mirrored(2, DIGITS - 1)}),
    ("axis 0 mirrored", C, {"does": mirrored(0, DIGITS - 1)}),
    ("axis 1 mirrored", C, {"does": mirrored(1, DIGITS - 1)}),
    ("axis 2 mirrored", C, {"does": mirrored(2, 1)}),
    ("axes 0 and 1 exchanged", C, {"does": swapped(0, 1)}),
    ("fields 0 and 2 exchanged", P, {"sees": swapped(0, 2)}),
]
ANT: list[Fault] = [
    ("fields 0 and 1 exchanged", P, {"sees": swapped(0, 1)}),
    ("fields 2 and 3 exchanged", P, {"sees": swapped(2, 3)}),
    ("fields 4 and 5 exchanged", P, {"sees": swapped(4, 5)}),
    ("field 0 mirrored", P, {"sees": mirrored(0, SIDE - 1)}),
    ("field 3 mirrored", P, {"sees": mirrored(3, SIDE - 1)}),
    ("actions 1 and 2 exchanged", C, {"does": renamed(1, 2)}),
    ("actions 3 and 4 exchanged", C, {"does": renamed(3, 4)}),
    ("actions 0 and 5 exchanged", C, {"does": renamed(0, 5)}),
    ("actions 1 and 3 exchanged", C, {"does": renamed(1, 3)}),
    ("acts 9 turns late", T, {"lag": 9}),
    ("chooses every 9th turn", T, {"every": 9}),
]
UNDOABLE: dict[str, dict[str, list[Fault]]] = {
    "berth": {
        "pilot": [
            ("field 0 mirrored", P, {"sees": mirrored(0, SIDE - 1)}),
            ("field 1 mirrored", P, {"sees": mirrored(1, SIDE - 1)}),
            ("fields 0 and 1 exchanged", P, {"sees": swapped(0, 1)}),
            ("fields 1 and 2 exchanged", P, {"sees": swapped(1, 2)}),
            ("axis 0 mirrored", C, {"does": mirrored(0, 2)}),
            ("axis 1 mirrored", C, {"does": mirrored(1, 2)}),
            ("axes exchanged", C, {"does": swapped(0, 1)}),
            ("acts 4 turns late", T, {"lag": 4}),
            ("chooses every 6th turn", T, {"every": 6}),
        ]
    },
    "spread": {
        "agent_0": [*SPREAD_SIGHT, *NAMES, *LATE],
        "agent_1": [*SPREAD_SIGHT, *NAMES, *LATE],
    },
    "spread, Box": {
        "agent_1": [
            *SPREAD_SIGHT[:5],
            ("axes 1 and 2 exchanged", C, {"does": swapped(1, 2)}),
            ("axes 3 and 4 exchanged", C, {"does": swapped(3, 4)}),
            ("axes 2 and 4 exchanged", C, {"does": swapped(2, 4)}),
            ("a tenth of the force", C, {"does": scaled(0.1)}),
            *LATE,
        ]
    },
    "speaker, AEC": {
        "listener_0": [
            ("field 2 mirrored", P, {"sees": mirrored(2, 0)}),
            ("fields 2 and 3 exchanged", P, {"sees": swapped(2, 3)}),
            ("fields 4 and 5 exchanged", P, {"sees": swapped(4, 5)}),
            *NAMES,
            *LATE,
        ]
    },
    "hoist": {"winch_0": WINCH, "winch_1": WINCH, "trolley_0": TROLLEY},
    "safe": {"scout_0": SCOUT, "scout_1": SCOUT, "opener_0": OPENER},
    "ants": {"ant_0": ANT, "ant_1": ANT, "ant_2": ANT},
}
"""By environment and agent. A fault of a message could be the speaker's or the listener's."""


def _inside(stack: Stack, agent: str) -> list[Fault]:
    """Faults that nothing outside makes up for."""
    found: list[Fault] = [("does nothing", (), {"still": True})]
    if agent not in ("caller", "speaker_0") and stack.spec is not Safe:
        found.append(("noisy sight", P, {"noise": 3.0}))
    if stack.actions >= 5 and agent != "speaker_0" and stack.spec is not spread_aec:
        slip = 0.9 if stack.actions == 5 else 0.97
        found.append(("slips", (), {"slip": slip, "actions": stack.actions}))
    return found


HARMLESS: list[dict[str, Any]] = [
    {},
    {"lag": 1},
    {"every": 2},
    {"noise": 0.01},
    {"sees": swapped(0, 1)},
    {"lag": 1, "every": 2},
]
"""What does no harm, or little, in most of them."""


LOOKED_AT = (
    ("hoist", "winch_1", "axis mirrored"),
    ("safe", "opener_0", "fields 0 and 2 exchanged"),
    ("safe", "scout_1", "axis 0 mirrored"),
    ("safe", "opener_0", "axes 0 and 1 exchanged"),
    ("ants", "ant_1", "actions 1 and 2 exchanged"),
    ("ants", "ant_2", "fields 2 and 3 exchanged"),
)
"""Set-ups that were looked at while the search was changed: they are no part of the benchmark."""


def undoable() -> Iterator[Planted]:
    """Set-ups with a fault that something outside makes up for."""
    for name, agents in UNDOABLE.items():
        for agent, faults in agents.items():
            for fault in faults:
                if (name, agent, fault[0]) not in LOOKED_AT:
                    yield _planted(name, agent, fault, "undoable")


def inside() -> Iterator[Planted]:
    """Set-ups with a fault that nothing outside makes up for."""
    for name, stack in STACKS.items():
        for agent in stack.agents:
            yield from (_planted(name, agent, f, "inside") for f in _inside(stack, agent))


def healthy() -> Iterator[Planted]:
    """Set-ups without a fault that harms."""
    for name, stack in STACKS.items():
        for agent in stack.agents:
            for number, fault in enumerate(HARMLESS):
                yield _planted(name, agent, (f"harmless {number}", (), fault), "healthy")


def _planted(name: str, agent: str, fault: Fault, kind: str) -> Planted:
    text, labels, arguments = fault
    stack = STACKS[name]
    policies: dict[str, Any] = {each: Faulty(stack.act) for each in stack.agents}
    policies[agent] = Faulty(stack.act, **arguments)
    agents = () if kind == "healthy" else (agent,)
    title = f"{name}: {agent} {text}"
    return Planted(title, stack.spec, policies, stack.failed, agents, labels, kind)


def successes(planted: Planted, *, is_sound: bool = False) -> int:
    """Number of `EPISODES` that succeed; without the fault if `is_sound`."""
    policies = planted.policies
    if is_sound:
        policies = {agent: Faulty(each.act) for agent, each in policies.items()}
    evidence = gk.rollout(planted.spec, policies=policies, episodes=EPISODES, seed=SEED)
    conditions = failures(evidence.contract, planted.failed)
    told = [failed(outcome_of(each), conditions, evidence.contract) for each in evidence.episodes]
    return sum(not each["team"] for each in told)


def holds(planted: Planted) -> bool:
    """Tells whether a set-up is what it claims to be, by the rule above."""
    count = successes(planted)
    if planted.kind == "healthy":
        return count >= EPISODES - 2
    return count <= EPISODES // 2 and successes(planted, is_sound=True) >= EPISODES - 2
