"""Knobs: what can be wrong with a robot, off by default, the same for every task.

A knob is an argument of a task. Its ideal is 0: nothing is disturbed then, and every row is the
row of the task without knobs. A number holds for all agents; a dictionary holds by agent or role,
`{"carrier_0": 2}`, so that one robot can be made faulty among sound ones.

What a knob draws comes from a stream of its own (a lane of the episode's stream for each knob and
agent), and is a function of how many turns the agent has had: the task's own draws stay as they
are, an observation may be asked for twice, and no agent's faults depend on another's.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import compress
from types import MappingProxyType
from typing import Any, Final, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray

from gamekeeper.errors import SpecError
from gamekeeper.randomness import stream as draws
from gamekeeper.randomness.stream import Stream

Setting: TypeAlias = "float | Mapping[str, float]"
Array: TypeAlias = NDArray[Any]

LABELS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "observation_noise": "perception",
        "occlusion": "perception",
        "observation_delay": "perception",
        "odometry_drift": "state estimation",
        "actuator_slip": "control",
        "actuator_dropout": "control",
        "latency": "timing",
        "slowness": "timing",
        "held_out": "data coverage",
    }
)
"""Every knob, and what failing under it is called. The order settles lanes: add at the end."""
COUNTS: Final = frozenset({"observation_delay", "latency", "slowness"})
"""Knobs in whole turns; `observation_noise` is in units of the observation, the others are
probabilities."""
LANES: Final = 16
"""Lanes of an agent, and of the episode itself; more than there are knobs."""
AHEAD: Final = (256, 8192)
"""Numbers that are drawn at once at first, and at most: an array costs as much as a few of them."""


class KnobArguments(TypedDict, total=False):
    """The knobs as keyword arguments of a task.

    Args:
        observation_noise: standard deviation of what is added to each number an agent sees, in the
            units of the observation; rounded where it is whole, kept in the space.
        occlusion: probability that a thing isn't seen this turn.
        observation_delay: an agent is shown what it would have been shown so many of its turns ago.
        odometry_drift: probability, whenever an agent moves, that its own idea of where it is goes
            wrong by one more cell.
        actuator_slip: probability that an action turns out as a neighbouring one.
        actuator_dropout: probability that an action isn't carried out.
        latency: an action is carried out so many turns of its agent later.
        slowness: an agent is idle for so many turns after each that it acts in.
        held_out: probability that an episode takes place in a layout kept out of training.
    """

    observation_noise: Setting
    occlusion: Setting
    observation_delay: Setting
    odometry_drift: Setting
    actuator_slip: Setting
    actuator_dropout: Setting
    latency: Setting
    slowness: Setting
    held_out: float


class Knobs:
    """The settings of a task's knobs, read once: `value(name, agent)`.

    Args:
        given: the arguments; those that are left out stand at their ideal.
        agents: the possible agents; a role is a name before its number (`picker_0`).
        offered: the knobs that the task has.
    Raises:
        SpecError: the task has no such knob, a value is out of its range, or is for no agent.
    """

    def __init__(
        self, given: Mapping[str, Any], *, agents: Iterable[str], offered: Iterable[str] = LABELS
    ) -> None:
        self.agents, self.offered = tuple(agents), tuple(offered)
        for name in given:
            if name not in self.offered:
                raise SpecError(
                    f"the task has no knob or argument called {name!r}",
                    where=name,
                    expected=", ".join(self.offered),
                    actual=name,
                    fix="use one of these names",
                )
        self._values: dict[str, dict[str, float]] = {}
        self.held_out = 0.0
        for name, setting in given.items():
            if name == "held_out":
                self.held_out = _checked(name, setting)
            elif any(values := self._spread(name, setting)):
                self._values[name] = dict(zip(self.agents, values, strict=True))

    @property
    def is_ideal(self) -> bool:
        """True without any disturbance."""
        return not self._values and not self.held_out

    def value(self, name: str, agent: str) -> float:
        """A knob's value for an agent."""
        return self._values[name][agent] if name in self._values else 0.0

    def _spread(self, name: str, setting: Setting) -> list[float]:
        """The value for each agent: its own, its role's, else the ideal."""
        if not isinstance(setting, Mapping):
            return [_checked(name, setting)] * len(self.agents)
        roles = [agent.rpartition("_")[0] or agent for agent in self.agents]
        strangers = sorted(set(map(str, setting)) - set(self.agents) - set(roles))
        if strangers:
            raise SpecError(
                f"the knob {name} is set for {strangers[0]!r}, which is no agent and no role",
                where=name,
                expected=", ".join(sorted({*roles, *self.agents}))[:300],
                actual=strangers[0],
                fix="set the knob for an agent or a role of the task",
            )
        checked = {target: _checked(name, value) for target, value in setting.items()}
        pairs = zip(self.agents, roles, strict=True)
        return [checked.get(agent, checked.get(role, 0.0)) for agent, role in pairs]


def _checked(name: str, value: Any) -> float:
    unit = "in whole turns" if name in COUNTS else "as a probability, at most 1"
    if name == "observation_noise":
        unit = "as a standard deviation"
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and 0.0 <= value < float("inf"):
        is_whole = value == int(value)
        if is_whole if name in COUNTS else (value <= 1.0 or name == "observation_noise"):
            return float(value)
    raise SpecError(
        f"the knob {name} can't be set to that",
        where=name,
        expected=f"a number from 0 up, {unit}; or a dictionary of these by agent or role",
        actual=repr(value)[:200],
        fix="give a number, or a dictionary such as {'carrier': 0.2}",
    )


class Disturbances:
    """Effects of the knobs in an episode; their state is copied with the environment.

    Args:
        bounds: by agent, the least and the greatest observation, as arrays of its shape.
        things: by agent, the parts (first, end) of its flat observation that stand for one thing
            each; a thing that is hidden shows 0.
        noop: the action that does nothing.
        neighbours: by action, what it may turn out as under `actuator_slip`.
    """

    def __init__(
        self,
        knobs: Knobs,
        *,
        bounds: Mapping[str, tuple[Array, Array]],
        things: Mapping[str, Sequence[tuple[int, int]]],
        noop: int,
        neighbours: Mapping[int, Sequence[int]],
    ) -> None:
        self.knobs, self._bounds, self._things = knobs, bounds, things
        self._noop, self._neighbours = noop, neighbours
        self._place = {agent: place for place, agent in enumerate(knobs.agents, start=1)}
        self.begin(Stream(0))

    def begin(self, rng: Stream) -> None:
        """A new episode: nothing is delayed, queued or drifted."""
        self._rng = rng.copy()
        self.turns = dict.fromkeys(self.knobs.agents, 0)
        self.drift = dict.fromkeys(self.knobs.agents, (0, 0))
        self._queues: dict[str, deque[int]] = {}
        self._seen: dict[str, deque[Array]] = {}
        self._ahead: dict[tuple[str, str], tuple[int, Array]] = {}
        self.is_held_out = self.knobs.held_out > 0 and self.layout_rng().uniform() < (
            self.knobs.held_out
        )

    def layout_rng(self) -> Stream:
        """The stream that a held-out layout is drawn from, after the number that asked for it."""
        return self._rng.fork(1 + list(LABELS).index("held_out"))

    def played(self, agent: str, action: int) -> int:
        """Action that is carried out for an agent's; called once in each turn that it has.

        First slowness (the turn is idle), then latency (an earlier action), dropout, slip.
        """
        turn = self.turns[agent]
        self.turns[agent] = turn + 1
        value = self.knobs.value
        if turn % (1 + int(value("slowness", agent))):
            action = self._noop
        late = int(value("latency", agent))
        if late:
            queue = self._queues.setdefault(agent, deque([self._noop] * late))
            queue.append(action)
            action = queue.popleft()
        if self._chance("actuator_dropout", agent, turn):
            return self._noop
        others = self._neighbours.get(action, ())
        if others and (stream := self._chance("actuator_slip", agent, turn)):
            return stream.choice(others)
        return action

    def moved(self, agent: str) -> None:
        """The agent has moved: its idea of where it is may go wrong by one more cell."""
        turn = self.turns[agent]
        if stream := self._chance("odometry_drift", agent, turn):
            x, y = self.drift[agent]
            east, south = ((0, -1), (1, 0), (0, 1), (-1, 0))[stream.integers(4)]
            self.drift[agent] = (x + east, y + south)

    def located(self, agent: str) -> None:
        """The agent has learnt where it is: its drift is gone."""
        self.drift[agent] = (0, 0)

    def remember(self, agent: str, view: Callable[[str], Array]) -> None:
        """Keeps what the agent would be shown now; called as its turn begins to be played."""
        late = int(self.knobs.value("observation_delay", agent))
        if late:
            self._seen.setdefault(agent, deque(maxlen=late)).append(view(agent))

    def shown(self, agent: str, view: Callable[[str], Array]) -> Array:
        """Observation of an agent: late, with things hidden, with noise.

        Args:
            view: what it would be shown undisturbed, a flat array.
        """
        value = self.knobs.value
        seen = self._seen.get(agent)
        clean = view(agent) if not seen else seen[0]
        hides, noise = value("occlusion", agent), value("observation_noise", agent)
        if not hides and not noise:
            return clean.copy() if seen else clean
        least, greatest = self._bounds[agent]
        shown = clean.astype(np.float64)
        if hides:
            things = self._things[agent]
            struck = self._drawn("occlusion", agent, len(things), draws.units) < hides
            for first, end in compress(things, struck):
                shown[first:end] = 0
        if noise:
            shown += noise * self._drawn("observation_noise", agent, shown.size, draws.normals)
        if clean.dtype.kind in "iu":
            shown = np.rint(shown)
        kept = np.minimum(np.maximum(shown, least), greatest)  # np.clip takes twice as long
        return kept.astype(clean.dtype)

    def _chance(self, name: str, agent: str, turn: int) -> Stream | None:
        """The knob's stream where it strikes in this turn, standing after the number it drew."""
        chance = self.knobs.value(name, agent)
        if not chance:
            return None
        stream = self._stream(name, agent, turn * 8)  # a choice after it fits into the eight
        return stream if stream.uniform() < chance else None

    def _drawn(
        self, name: str, agent: str, count: int, draw: Callable[[Stream, int], Array]
    ) -> Array:
        """[count] what a knob draws for an agent in this turn: two words a number, turn by turn."""
        turn = self.turns[agent]
        first, drawn = self._ahead.get((name, agent), (0, np.empty((0, count))))
        if not first <= turn < first + len(drawn):
            numbers = min(max(2 * drawn.size, AHEAD[0]), AHEAD[1])
            first, turns = turn, max(numbers // max(count, 1), 1)
            stream = self._stream(name, agent, turn * 2 * count)
            drawn = draw(stream, turns * count).reshape(turns, count)
            self._ahead[name, agent] = first, drawn
        found: Array = drawn[turn - first]
        return found

    def __getstate__(self) -> dict[str, Any]:
        """State to copy: all but what can be drawn again."""
        return {**self.__dict__, "_ahead": {}}

    def _stream(self, name: str, agent: str, word: int) -> Stream:
        """A knob's stream for an agent, at a word of it."""
        lane = self._place[agent] * LANES + list(LABELS).index(name)
        stream = self._rng.fork(lane)
        stream.draws = word
        return stream
