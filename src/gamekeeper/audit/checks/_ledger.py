"""What agents are owed in an AEC play: what was paid since their own last turn, beside `last()`.

Source: PettingZoo's AEC API: `rewards` is what the last step paid, `last()` gives an agent the sum
since its own last turn.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof
from gamekeeper.core.trace import Trace, Turn

Kind: TypeAlias = Literal["right", "carried", "again", "lost"]

PRECISION: Final = 1e-5
"""Of the sum of what was paid: rewards may be float32 and be summed as such."""
MOST_TIMES: Final = 4
"""A reward that is told so often, or less, is told again; what is more is something else."""

PROOF: Final = Proof(
    """\
env = make()
env.reset(seed=SEED)
owed = dict.fromkeys(env.agents, 0.0)
for action in ACTIONS:
    env.last()
    owed[env.agent_selection] = 0.0  # whoever acts has been told
    env.step(action)
    for agent, reward in env.rewards.items():
        owed[agent] = owed.get(agent, 0.0) + reward
agent, told = env.agent_selection, env.last()[1]
assert np.isclose(told, owed[agent], atol=1e-6), (agent, told, owed[agent])""",
    plays=False,
)


@dataclass(frozen=True, slots=True)
class Told:
    """What `last()` told an agent at its turn, beside what it was owed.

    Attributes:
        trace: where.
        turn: when.
        agent: whom.
        told: the reward of `last()`.
        owed: the sum of `rewards` since its own last turn, or since the reset.
        carried: what it was told at its own last turn; 0 at its first.
        scale: sum of the absolute values of what was paid and told.
    """

    trace: Trace
    turn: int
    agent: str
    told: float
    owed: float
    carried: float
    scale: float

    @property
    def is_right(self) -> bool:
        """It was told what it was owed."""
        return self._is(self.owed)

    @property
    def looks_like(self) -> tuple[Kind, ...]:
        """What it may be by itself; small numbers are more than one thing by chance."""
        if self.is_right:
            return ("right",)
        is_carried = self.carried and self._is(self.owed + self.carried)
        is_again = self.owed and any(self._is(n * self.owed) for n in range(2, MOST_TIMES + 1))
        kinds: dict[Kind, bool] = {"carried": bool(is_carried), "again": bool(is_again)}
        return tuple(kind for kind, is_it in kinds.items() if is_it)

    def _is(self, value: float) -> bool:
        return math.isclose(self.told, value, abs_tol=1e-9 + PRECISION * self.scale)


def all_told(evidence: Gathered) -> Iterator[tuple[Told, Kind]]:
    """Every look at what an agent was told, where it was paid or told anything, and what it is.

    Too much that names its cause (*carried*, *again*) is it where at least half of all that is
    wrong looks alike; else it is *lost*, as what was owed didn't come.
    """
    looks = list(_all_told(evidence))
    kinds = Counter(kind for told in looks for kind in told.looks_like)
    wrong = len(looks) - kinds["right"]
    for told in looks:
        likely = max(told.looks_like, key=kinds.__getitem__, default=None)
        is_it = likely == "right" or 2 * kinds[likely or "lost"] >= wrong
        yield told, likely if likely is not None and is_it else "lost"


def _all_told(evidence: Gathered) -> Iterator[Told]:
    for trace in evidence["rollout"]:
        yield from _told(trace, {})
    says = [fact.value for fact in evidence.facts("books", "told")]
    for trace, last in zip(evidence["books"], says, strict=False):
        yield from _told(trace, last)


def is_dead_step(turn: Turn) -> bool:
    """Whether the turn is the None turn of an agent that had ended."""
    return bool(turn.order) and turn.order[0] in ended_in(turn)


@dataclass(slots=True)
class _Account:
    """One agent's account; `is_sure`: all that went in is known."""

    owed: float = 0.0
    carried: float = 0.0
    scale: float = 0.0
    is_sure: bool = True


@dataclass(slots=True)
class _Ledger:
    """The accounts of one play."""

    accounts: dict[str, _Account] = field(default_factory=dict)

    def of(self, agent: str) -> _Account:
        """The agent's account, a fresh one at first."""
        return self.accounts.setdefault(agent, _Account())

    def book(self, turn: Turn) -> None:
        """Notes what a crossing paid; what a dead step leaves standing is nobody's pay."""
        is_dead = is_dead_step(turn)
        for agent, reward in turn.rewards.items():
            account = self.of(agent)
            if is_dead or not math.isfinite(reward):
                account.is_sure = account.is_sure and not reward
                continue
            account.owed += reward
            account.scale += abs(reward)
        for agent, fields in turn.odd.items():
            if "reward" in fields:
                self.of(agent).is_sure = False


def _told(trace: Trace, last: Mapping[int, Any]) -> Iterator[Told]:
    """The looks of one play; `last` has what `last()` itself said, by turn, where that is known."""
    ledger = _Ledger()
    for turn in trace.turns:
        agent = turn.order[0] if turn.order else next(iter(turn.received), None)
        if agent is None:
            continue
        told, account = last.get(turn.index, turn.received.get(agent)), ledger.of(agent)
        is_known = isinstance(told, int | float) and math.isfinite(told)
        if is_known and account.is_sure and (told or account.owed or account.carried):
            yield Told(
                trace, turn.index, agent, told, account.owed, account.carried,
                account.scale + abs(told) + abs(account.carried),
            )  # fmt: skip
        ledger.accounts[agent] = _Account(carried=told if is_known else 0.0)
        ledger.book(turn)
