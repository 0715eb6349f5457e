"""Faults of messages planted in the environments of message_envs.py, for benchmarks/messages.py.

A fault is the speaker's (it says the wrong word, or nothing), the listener's (it misreads, or goes
by what it heard long ago), or the air's between them. Beside them stand faults that have nothing to
do with messages, and set-ups without one. Whether a set-up is what it claims to be is looked at by
plain rollouts, by the rule of undo_causes.py.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import undo_causes
from message_envs import NUMBERS, SEAMS, Boats, Chain, Quarry, boats, chain, quarry, through
from undo_causes import Act, Faulty, mirrored, renamed, scaled, swapped

FAILED = "return < 1"


@dataclass(frozen=True)
class Stack:
    """An environment, and a policy that does well in it for every agent."""

    env: Any
    act: Act
    agents: tuple[str, ...]


STACKS = {
    "quarry": Stack(Quarry, quarry, ("lookout_0", "digger_0", "digger_1")),
    "chain": Stack(Chain, chain, ("clerk", "runner", "valve")),
    "boats": Stack(Boats, boats, ("boat_0", "boat_1")),
}


class Stale(Faulty):
    """A listener that goes by what it heard `turns` ago, or by its first word for ever."""

    def __init__(self, act: Act, *, fields: slice, turns: int) -> None:
        """Plants it."""
        self.fields, self.turns = fields, turns
        super().__init__(act)

    def reset(self, seed: int) -> None:
        """Forgets."""
        super().reset(seed)
        self.heard: list[Any] = []

    def __call__(self, observation: Any, agent: str, info: Any, rng: Any) -> Any:
        """The action."""
        seen = np.array(observation)
        self.heard.append(seen[self.fields].copy())
        seen[self.fields] = self.heard[max(len(self.heard) - 1 - self.turns, 0)]
        return super().__call__(seen, agent, info, rng)


@dataclass(frozen=True)
class MessageCause:
    """A set-up, and what is wrong with it.

    Attributes:
        name: what it is.
        env: the environment.
        act: the policy without a fault.
        policies: by agent.
        kind: `said`, `heard`, `air`, `other` (no message) or `healthy`.
        agents: whose fault it is; none: the air's, or nobody's.
        between: the speaker and the listeners of the message; none where it is none.
        labels: what it may be called, where it is an agent's.
    """

    name: str
    env: Any
    act: Act
    policies: dict[str, Any]
    kind: str
    agents: tuple[str, ...] = ()
    between: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()


def only(places: slice, change: Any) -> Any:
    """A change of some numbers of an array alone."""

    def changed(array: Any) -> Any:
        array = np.array(array)
        array[places] = change(array[places])
        return array

    return changed


def silent(action: Any) -> Any:
    """Nothing said: the first word, or zeros."""
    return 0 if isinstance(action, int) else np.zeros_like(action)


P, C, T = ("perception",), ("control",), ("timing",)
Row = tuple[str, str, str, tuple[str, ...], tuple[str, ...], dict[str, Any]]
"""Agent, what it is, kind, speaker and listeners, labels, and the arguments of `Faulty`."""

DIGGERS = ("lookout_0", "digger_0", "digger_1")
QUARRY: list[Row] = [
    ("lookout_0", "says 1 for 2", "said", DIGGERS, C, {"does": renamed(1, 2)}),
    ("lookout_0", "says 0 for 3", "said", DIGGERS, C, {"does": renamed(0, 3)}),
    ("lookout_0", "says the next", "said", DIGGERS, C, {"does": lambda a: (a + 1) % SEAMS}),
    ("lookout_0", "sees 0 as 1", "said", DIGGERS, P, {"sees": swapped(0, 1)}),
    ("lookout_0", "says 0 always", "said", DIGGERS, (), {"does": silent}),
    ("lookout_0", "says anything", "said", DIGGERS, (), {"slip": 0.95, "actions": SEAMS}),
    ("digger_0", "hears 1 as 2", "heard", ("lookout_0", "digger_0"), P, {"sees": swapped(1, 2)}),
    ("digger_1", "hears 0 as 3", "heard", ("lookout_0", "digger_1"), P, {"sees": swapped(0, 3)}),
    ("digger_1", "hears 2 as 3", "heard", ("lookout_0", "digger_1"), P, {"sees": swapped(2, 3)}),
    ("digger_0", "walks the wrong way", "other", (), C, {"does": renamed(0, 2)}),
    ("digger_1", "walks the wrong way", "other", (), C, {"does": renamed(0, 2)}),
    ("digger_1", "stays for going left", "other", (), C, {"does": renamed(0, 1)}),
]
CHAIN: list[Row] = [
    ("clerk", "reads mirrored", "said", ("clerk", "runner"), P, {"sees": mirrored(0, NUMBERS)}),
    ("clerk", "says mirrored", "said", ("clerk", "runner"), C, {"does": mirrored(0, NUMBERS)}),
    ("clerk", "says nothing", "said", ("clerk", "runner"), (), {"does": silent}),
    ("runner", "hears mirrored", "heard", ("clerk", "runner"), P, {"sees": mirrored(0, NUMBERS)}),
    ("runner", "says mirrored", "said", ("runner", "valve"), C, {"does": mirrored(0, NUMBERS)}),
    ("runner", "says nothing", "said", ("runner", "valve"), (), {"does": silent}),
    ("valve", "hears mirrored", "heard", ("runner", "valve"), P, {"sees": mirrored(0, NUMBERS)}),
    ("valve", "exchanges its fields", "other", (), P, {"sees": swapped(0, 1)}),
    ("valve", "turns the wrong way", "other", (), C, {"does": mirrored(0, 2)}),
    ("valve", "pulls at the wrong time", "other", (), C, {"does": mirrored(1, 1)}),
    ("valve", "misreads its own place", "other", (), P, {"sees": mirrored(1, NUMBERS)}),
]
BETWEEN = {0: ("boat_1", "boat_0"), 1: ("boat_0", "boat_1")}
HEARD, SAID = slice(4, 6), slice(2, 4)


def _boat(k: int) -> list[Row]:
    """Faults of one boat."""
    one, said, heard = f"boat_{k}", BETWEEN[1 - k], BETWEEN[k]
    return [
        (one, "says exchanged", "said", said, C, {"does": swapped(2, 3)}),
        (one, "says 0 mirrored", "said", said, C, {"does": mirrored(2, 0)}),
        (one, "says a tenth", "said", said, (), {"does": only(SAID, scaled(0.1))}),
        (one, "says nothing", "said", said, (), {"does": only(SAID, silent)}),
        (one, "sees the goal exchanged", "said", said, P, {"sees": swapped(2, 3)}),
        (one, "hears exchanged", "heard", heard, P, {"sees": swapped(4, 5)}),
        (one, "hears 1 mirrored", "heard", heard, P, {"sees": mirrored(5, 0)}),
        (one, "sails mirrored", "other", (), C, {"does": mirrored(0, 0)}),
        (one, "sails exchanged", "other", (), C, {"does": swapped(0, 1)}),
        (one, "misreads its place", "other", (), P, {"sees": mirrored(0, 0)}),
    ]


ROWS = {"quarry": QUARRY, "chain": CHAIN, "boats": [*_boat(0), *_boat(1)]}
STALE = [
    ("quarry", "digger_0", ("lookout_0", "digger_0"), slice(0, SEAMS), 15),
    ("chain", "runner", ("clerk", "runner"), slice(0, 1), 20),
    ("chain", "valve", ("runner", "valve"), slice(0, 1), 20),
    ("boats", "boat_0", BETWEEN[0], HEARD, 40),
    ("boats", "boat_1", BETWEEN[1], HEARD, 40),
]
AIRS = ("lost", "late", "garbled", "exchanged")
AIR = {"quarry": DIGGERS, "chain": ("clerk", "runner"), "boats": BETWEEN[0]}
HARMLESS: list[dict[str, Any]] = [{}, {"lag": 1}, {"every": 2}, {"noise": 0.001}]


def causes() -> Iterator[MessageCause]:
    """All set-ups."""
    for name, stack in STACKS.items():
        for agent, text, kind, between, labels, arguments in ROWS[name]:
            policy = Faulty(stack.act, **arguments)
            title = f"{name}: {agent} {text}"
            yield _cause(title, stack, {agent: policy}, kind, (agent,), between, labels)
        for fault in AIRS:
            title = f"{name}: messages {fault}"
            yield _cause(title, stack, {}, "air", (), AIR[name], (), env=through(stack.env, fault))
        for agent in stack.agents:
            for number, arguments in enumerate(HARMLESS):
                title = f"{name}: {agent} harmless {number}"
                yield _cause(title, stack, {agent: Faulty(stack.act, **arguments)}, "healthy")
    for name, agent, between, fields, turns in STALE:
        stack = STACKS[name]
        policy = Stale(stack.act, fields=fields, turns=turns)
        title = f"{name}: {agent} goes by old words"
        yield _cause(title, stack, {agent: policy}, "heard", (agent,), between, ())


def _cause(
    name: str,
    stack: Stack,
    changed: dict[str, Any],
    kind: str,
    agents: tuple[str, ...] = (),
    between: tuple[str, ...] = (),
    labels: tuple[str, ...] = (),
    env: Any = None,
) -> MessageCause:
    policies = {agent: Faulty(stack.act) for agent in stack.agents} | changed
    env = env or stack.env
    return MessageCause(name, env, stack.act, policies, kind, agents, between, labels)


def holds(cause: MessageCause) -> bool:
    """Tells whether a set-up is what it claims to be, by the rule of undo_causes.py."""
    count, most = successes(cause, cause.policies), undo_causes.EPISODES
    if cause.kind == "healthy":
        return count >= most - 2
    sound = {agent: Faulty(cause.act) for agent in cause.policies}
    stack = next(each for each in STACKS.values() if each.act is cause.act)
    return count <= most // 2 and successes(cause, sound, stack.env) >= most - 2


def successes(cause: MessageCause, policies: Any, env: Any = None) -> int:
    """Number of fresh episodes that succeed."""
    of = undo_causes.Planted("", env or cause.env, policies, FAILED, (), (), "")
    return undo_causes.successes(of)
