"""Facts of the probes `rollout`, `evidence`, `order` and `alternatives`: whole episodes."""

from dataclasses import dataclass
from typing import Any

from gamekeeper.checks.facts.state_facts import StateAnswer


@dataclass(frozen=True, slots=True)
class MoverTrial:
    """Alternatives of one agent to what it did before a payment.

    Attributes:
        turn: at which it acted.
        tried: how many alternatives.
        instead: the first that made the payment smaller; None where none did.
    """

    turn: int
    tried: int
    instead: Any


@dataclass(frozen=True, slots=True)
class TurnRosters:
    """Rosters of a rollout: after the reset and after each env step."""

    turns: list[list[str]]


@dataclass(frozen=True, slots=True)
class SelectedAgents:
    """Agents that `agent_selection` named before each turn and after the last.

    Each with its name, and if it stood in `agents`.
    """

    turns: list[tuple[str | None, bool]]


@dataclass(frozen=True, slots=True)
class RaisedCall:
    """A call of a rollout that raised: `reset`, `last`, `step`; the exception's class and text."""

    call: str
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class NearLimit:
    """An episode that was played to a limit, of an instance that was built with a near one or not.

    Attributes:
        limits: what it may be, by name, as far as the name speaks of time, not of turns of a game.
        options: the limit, by the name of its argument; none where the instance has its own.
        rosters: as in `TurnRosters`.
        selected: as in `SelectedAgents`.
        raised: what ended the episode, if anything did.
    """

    limits: dict[str, int]
    options: dict[str, int]
    rosters: list[list[str]]
    selected: list[tuple[str | None, bool]]
    raised: RaisedCall | None


@dataclass(frozen=True, slots=True)
class StateForms:
    """The first answer of each form that `state()` gave in a rollout."""

    answers: list[StateAnswer]


@dataclass(frozen=True, slots=True)
class AgentNames:
    """Names of the agents: of `possible_agents` in their order, then as they appeared.

    Attributes:
        names: text and type of each.
        no_values: texts of those that don't equal a copy of theirs.
    """

    names: list[list[str]]
    no_values: list[str]


@dataclass(frozen=True, slots=True)
class UnwrittenActions:
    """Reason why actions couldn't be taken from the evidence, in words."""

    reason: str


@dataclass(frozen=True, slots=True)
class OrderOutcome:
    """Outcome of other orders of the action dictionary.

    Attributes:
        result: `same`, `rounding` (last digits), `noise` (the unchanged rerun differs too),
            `draws`, `outcome` or `undecided`.
        order: name of the order that differs.
        turn: env steps after which the difference shows.
        part: what differs.
        agent: whose; empty where it is nobody's own.
        one: in the first order.
        two: in the other one.
        p_values: of the tests whether it is draws.
    """

    result: str
    ticks: int
    order: str = "reversed"
    turn: int | None = None
    part: str = ""
    agent: str = ""
    one: Any = None
    two: Any = None
    p_values: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class PaymentTime:
    """Tick that decides an unusual reward.

    Attributes:
        amount: paid beyond what the agent gets in most steps.
        tried: turn, agent and action of each alternative in the tick of the payment.
        is_on_time: the last of these changes the payment, or other random draws in its tick do.
        decided: turn, agent and action of one in the tick before that changes it, where none of
            the payment's own tick does; None: none was found.
        shown: numbers of the payee's next observation that this one moves.
        after: numbers that it moves in the observation after the payment.
    """

    agent: str
    amount: float
    tried: tuple[tuple[int, str, Any], ...]
    is_on_time: bool = False
    decided: tuple[int, str, Any] | None = None
    shown: frozenset[int] = frozenset()
    after: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class LateEffect:
    """A replaced action that moves no reward before its agent's next turn, and one from there on.

    Attributes:
        step: the first that pays differently.
        is_drawn: under other random draws in that step it pays differently by another amount.
    """

    step: int
    is_drawn: bool


@dataclass(frozen=True, slots=True)
class Payment:
    """A payment of a declared term that was looked into, and alternatives by agent."""

    term: str
    agent: str
    amount: float
    movers: dict[str, MoverTrial]
