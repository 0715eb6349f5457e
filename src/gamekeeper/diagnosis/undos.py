"""Undos: faults inside a policy undone from outside, at the boundary of the agents that it plays.

An undo changes what a policy is given, what of its choice is carried out, or when it is asked, and
nothing else; no knob, no reference and no access to its code is needed. One that restores success
shows at which boundary the fault can be made up for.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from gamekeeper.contract import Contract
from gamekeeper.diagnosis.plain_data import frozen
from gamekeeper.episodes.layout import agent_name
from gamekeeper.episodes.outcome import Label
from gamekeeper.interface.capture import AgentId
from gamekeeper.interface.env_source import api_of
from gamekeeper.rollouts.interventions.fields import NumberField, acted_fields, observed_fields
from gamekeeper.rollouts.interventions.legal_actions import LegalActions, legal_actions_of
from gamekeeper.rollouts.interventions.perturbation import action_space, observation_space

OnObservation = Literal[
    "exchange fields",
    "mirror field",
    "turn fields",
    "exchange values",
    "rescale fields",
    "normalize fields",
    "shift field",
    "shift values",
    "deliver messages",
]
OnAction = Literal[
    "exchange axes",
    "mirror axis",
    "turn axes",
    "rescale axes",
    "shift axis",
    "exchange actions",
    "shift actions",
]
OnCalls = Literal["settle", "hold", "commonest"]
Way: TypeAlias = OnObservation | OnAction | OnCalls

OBSERVATION: Final = get_args(OnObservation)
ACTION: Final = get_args(OnAction)
MESSAGES: Final = "messages"
"""Component of messages that are late or lost on their way, which is no agent's own."""
DRAWS: Final = "draws"
"""Component of a policy whose draws are settled: no boundary of it is touched, so no label."""
Numbers: TypeAlias = NDArray[np.float64]
Passed: TypeAlias = Callable[[Any], Any]
"""From an observation or action to what is passed on in its place."""


@dataclass(frozen=True, slots=True)
class BoundaryUndo:
    """One thing done otherwise at the boundary of some agents' policies.

    Attributes:
        agents: those agents; their spaces are equal.
        way: what is done.
        places: fields of the observation or axes of the action, by number (of `rescale`, where
            there is none: all of them); of `exchange values`
            and `exchange actions` the field or axis and the two values; of `deliver messages` the
            fields, then as many axes of the speaker's action.
        amount: factor of `rescale`, quarter turns of `turn`, lower end of the range up to 1 of
            `normalize`, what `shift` adds, further calls of `settle`, turns of `hold` (its policy
            is asked at each of them), draws of `commonest`.
        names: of the places, for people; of `deliver messages` the speaker.
    """

    agents: tuple[str, ...]
    way: Way
    places: tuple[int, ...] = ()
    amount: float = 0.0
    names: tuple[str, ...] = ()

    @property
    def component(self) -> Label | Literal["draws", "messages"]:
        """The label of the boundary that it touches."""
        if self.way == "deliver messages":
            return MESSAGES
        if self.way in OBSERVATION:
            return "perception"
        if self.way in ACTION:
            return "control"
        return DRAWS if self.way == "commonest" else "timing"

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> BoundaryUndo:
        """Inverse of `to_json`."""
        return cls(**frozen(data))

    def __str__(self) -> str:
        """The undo in words: `exchanging fields 0 and 1 of light's observation`."""
        *most, last = self.agents
        axes = " and ".join(map(str, self.places))
        what = " and ".join(name.removeprefix("field ") for name in self.names)
        fields = "fields" if len(self.places) > 1 else "field"
        at = f"{fields} {what} of " if self.way in OBSERVATION else f"axis {axes} of "
        return TEXTS[self.way].format(
            at=at if self.places else "",
            whose=f"{', '.join(most)} and {last}'s" if most else f"{last}'s",
            agents=", ".join(self.agents),
            what=what,
            axes=axes,
            values=" and ".join(map(str, self.places[1:])),
            of=f"{what} of " if what else "",
            n=f"{self.amount:g}",
            more=f"{self.amount + 1:g}",
            by=f"{self.amount:+g}",
            degrees=f"{90 * self.amount:g}",
        )


TEXTS: Final[Mapping[Way, str]] = {
    "exchange fields": "exchanging fields {what} of {whose} observation",
    "mirror field": "mirroring field {what} of {whose} observation",
    "turn fields": "turning fields {what} of {whose} observation by {degrees} degrees",
    "exchange values": "exchanging values {values} of field {what} of {whose} observation",
    "rescale fields": "multiplying {at}{whose} observation by {n}",
    "normalize fields": "normalizing {whose} observation to {n} to 1",
    "shift field": "adding {n} to field {what} of {whose} observation",
    "shift values": "shifting values of field {what} of {whose} observation by {by}",
    "deliver messages": "giving {agents} what {what} said last",
    "exchange axes": "exchanging axes {axes} of {whose} action",
    "mirror axis": "mirroring axis {axes} of {whose} action",
    "turn axes": "turning axes {axes} of {whose} action by {degrees} degrees",
    "rescale axes": "multiplying {at}{whose} action by {n}",
    "shift axis": "adding {n} to axis {axes} of {whose} action",
    "exchange actions": "exchanging values {values} of {of}{whose} action",
    "shift actions": "shifting {whose} action by {by}",
    "settle": "asking {whose} policy {more} times a turn",
    "hold": "holding each of {whose} actions for {n} turns",
    "commonest": "taking the most frequent of {n} draws of {whose} policy",
}
VALUES: Final = ("exchange values", "exchange actions")


class UndonePolicies:
    """A joint policy in which an undo stands between the game and the policies of some agents."""

    def __init__(self, joint_policy: Any, undo: BoundaryUndo, env: Any, contract: Contract) -> None:
        self._joint_policy, self._undo = joint_policy, undo
        self._env, self._contract = env, contract
        self._agents = frozenset(undo.agents)
        self._boundaries: dict[AgentId, tuple[Passed, Passed, LegalActions | None]] = {}
        self._held: dict[AgentId, tuple[int, Any]] = {}
        self._way = MessageWay(undo, env, contract) if undo.way == "deliver messages" else None

    def begin(self, run_seed: int, episode: int) -> None:
        """Begins an episode."""
        self._held = {}
        if self._way is not None:
            self._way.begin()
        self._joint_policy.begin(run_seed, episode)

    def asked(self, agent: AgentId, *given: Any, **how: Any) -> Any:
        """Actions of another agent's policy that is asked several times."""
        return self._joint_policy.asked(agent, *given, **how)

    def act(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """The action of a live agent; an illegal one gives way as `LegalActions.stand_in` says."""
        if self._way is not None:
            shown = self._way.given(agent, observation)
            return self._way.noted(agent, self._joint_policy.act(agent, shown, info))
        if agent_name(agent) not in self._agents:
            return self._joint_policy.act(agent, observation, info)
        if agent not in self._boundaries:
            boundary = _boundary(self._undo, self._env, self._contract, agent)
            self._boundaries[agent] = boundary
        seen, pass_on, legal_actions = self._boundaries[agent]
        shown = seen(observation)
        if legal_actions is not None:  # before its policy could write into what it is given
            legal_actions.take(observation, info)
        action = self._chosen(agent, shown, info)
        done = pass_on(action)
        is_own = done is action and self._undo.way != "hold"
        return (
            done
            if is_own or legal_actions is None or legal_actions.allows(done)
            else legal_actions.stand_in(action)
        )

    def _chosen(self, agent: AgentId, observation: Any, info: Any) -> Any:
        """The action; the policy itself is asked once a turn, so that its memory goes on as ever.

        What it would say if it were asked again is asked of copies.
        """
        undo, times = self._undo, int(self._undo.amount)
        if undo.way == "settle":
            return self._joint_policy.asked(agent, observation, info, times + 2, anew=False)[-1]
        if undo.way == "commonest":
            draws = self._joint_policy.asked(agent, observation, info, times, anew=True)
            keys = [repr(np.asarray(each).tolist()) for each in draws]
            return draws[keys.index(Counter(keys).most_common(1)[0][0])]  # of equals the first
        action = self._joint_policy.act(agent, observation, info)
        if undo.way == "hold":
            count, held = self._held.get(agent, (0, None))
            action = held if count % times else action
            self._held[agent] = (count + 1, action)
        return action


class MessageWay:
    """The way of messages from one agent to another, with nothing late or lost.

    What the speaker did last is written over the listener's fields, as it would be by the next
    turn: in a Parallel environment not before the next tick.
    """

    def __init__(self, undo: BoundaryUndo, env: Any, contract: Contract) -> None:
        self._undo, self._env, self._contract = undo, env, contract
        self._is_parallel = api_of(env) == "parallel"
        self._fields: list[NumberField] = []
        self._axes: list[NumberField] = []
        self.begin()

    def begin(self) -> None:
        """Begins an episode: nothing was said."""
        self._said: list[float] | None = None
        self._arrived: list[float] | None = None
        self._acted: set[AgentId] = set()

    def given(self, agent: AgentId, observation: Any) -> Any:
        """The observation that an agent is shown."""
        if agent in self._acted or not self._is_parallel:
            self._arrived, self._acted = self._said, set()
        self._acted.add(agent)
        if agent_name(agent) not in self._undo.agents or self._arrived is None:
            return observation
        if not self._fields:
            space, half = observation_space(self._env, agent), len(self._undo.places) // 2
            every = () if space is None else observed_fields(self._contract, agent, space)
            self._fields = [every[place] for place in self._undo.places[:half]]
        for each, number in zip(self._fields, self._arrived, strict=True):
            observation = each.write(observation, number)
        return observation

    def noted(self, agent: AgentId, action: Any) -> Any:
        """The same action; what the speaker says is kept."""
        if agent_name(agent) != self._undo.names[0] or action is None:
            return action
        if not self._axes:
            space = action_space(self._env, agent)
            every = () if space is None else acted_fields(space)
            half = len(self._undo.places) // 2
            self._axes = [every[place] for place in self._undo.places[half:]]
        read = [each.read(action) for each in self._axes]
        self._said = None if None in read else [x for x in read if x is not None]
        return action


def _boundary(
    undo: BoundaryUndo, env: Any, contract: Contract, agent: AgentId
) -> tuple[Passed, Passed, LegalActions | None]:
    """Both directions between the game and the policy of one agent, and its legal actions."""
    observed, acted = observation_space(env, agent), action_space(env, agent)
    seen: Passed = _same
    done: Passed = _same
    if undo.way in OBSERVATION and observed is not None:
        seen = passed_with(undo, observed_fields(contract, agent, observed), is_action=False)
    if undo.way in ACTION and acted is not None:
        done = passed_with(undo, acted_fields(acted), is_action=True)
    return seen, done, legal_actions_of(contract, env, agent)


def _same(value: Any) -> Any:
    return value


def passed_with(undo: BoundaryUndo, fields: Sequence[NumberField], *, is_action: bool) -> Passed:
    """The function that writes other numbers at the places of an undo."""
    places = undo.places[:1] if undo.way in VALUES else undo.places
    chosen = [fields[place] for place in places] if places else list(fields)
    low = np.array([each.low for each in chosen])
    high = np.array([each.high for each in chosen])
    rule = _rule(undo, low, high)

    def passed(value: Any) -> Any:
        read = [each.read(value) for each in chosen]
        if any(number is None for number in read):
            return value
        numbers = rule(np.array(read, np.float64))
        if is_action or undo.way == "shift field":
            numbers = np.clip(numbers, low, high)
        for each, number in zip(chosen, numbers.tolist(), strict=True):
            value = each.write(value, number)
        return value

    return passed


def _rule(undo: BoundaryUndo, low: Numbers, high: Numbers) -> Callable[[Numbers], Numbers]:
    """Other numbers in place of those at the undo's places; a span without bounds is around 0."""
    is_bounded = bool(np.isfinite(low).all() and np.isfinite(high).all())
    middle = (low + high) / 2 if is_bounded else np.zeros_like(low)
    amount = undo.amount
    if undo.way in ("exchange fields", "exchange axes"):
        return lambda x: x[::-1]
    if undo.way in ("mirror field", "mirror axis"):
        return lambda x: 2 * middle - x
    if undo.way in ("turn fields", "turn axes"):
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(amount) % 4]
        turn = np.array([[cosine, -sine], [sine, cosine]], np.float64)
        return lambda x: middle + turn @ (x - middle)
    if undo.way == "normalize fields":
        return lambda x: amount + (x - low) / (high - low) * (1 - amount)
    if undo.way in VALUES:
        one, two = undo.places[1:]
        return lambda x: np.where(x == one, two, np.where(x == two, one, x))
    if undo.way in ("shift actions", "shift values"):  # the last value goes on at the first
        return lambda x: (x - low + amount) % (high - low + 1) + low
    if undo.way in ("shift field", "shift axis"):
        return lambda x: x + amount
    return lambda x: x * amount
