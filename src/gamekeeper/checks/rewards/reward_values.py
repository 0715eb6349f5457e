"""Checks of rewards: numbers, made anew, told once and in full by `last()`, and 0 after the end."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal, TypeAlias

import numpy as np

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, MEDIUM, Case, Cases, check
from gamekeeper.checks.ended_agents import ended_in
from gamekeeper.checks.facts.aec_book_facts import LastRewards, MarkedReward, OwedAfterReset
from gamekeeper.checks.literal import key_literal
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.reproducer_source import reproducer_of
from gamekeeper.checks.reproducers import dead_steps_pay_nobody as dead_pay_stops
from gamekeeper.checks.reproducers import rewards_add_up
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Episode, Turn

Kind: TypeAlias = Literal["right", "carried", "again", "lost"]

LEDGER_PRECISION: Final = 1e-5
"""Precision, as a part of the sum of rewards: they may be float32 and be summed as such."""
MOST_TIMES: Final = 4
"""A reward that is told so often, or less, is told again; what is more is something else."""


@dataclass(frozen=True, slots=True)
class ReportedReward:
    """Cumulative reward that `last()` gave an agent at its turn, beside the sum it should be.

    Attributes:
        told: the reward of `last()`.
        paid: its `rewards` since its own last turn, or since the reset.
        carried: what it was told at its own last turn; 0 at its first.
    """

    episode: Episode
    turn: int
    agent: str
    told: float
    paid: tuple[float, ...]
    carried: float

    @property
    def owed(self) -> float:
        """The sum of what was paid."""
        return sum(self.paid)

    @property
    def numbers(self) -> tuple[float, float]:
        """Rewards as told and as owed, whatever the order in which these were summed."""
        return self.told, float(f"{self.owed:.9g}")

    @property
    def is_right(self) -> bool:
        """It was told what it was owed, though the books may have been kept in float16."""
        return self._is(self.owed) or self.told == _in_halves(self.paid)

    @property
    def looks_like(self) -> tuple[Kind, ...]:
        """Kinds of fault that it may be, if it isn't right; small numbers fit more by chance."""
        is_carried = self.carried and self._is(self.owed + self.carried)
        more = [n * self.owed for n in range(2, MOST_TIMES + 1)]
        more += [self.owed + each for each in self.paid if each and self.told]
        is_again = self.owed and any(map(self._is, more))
        kinds: dict[Kind, bool] = {"carried": bool(is_carried), "again": bool(is_again)}
        return tuple(kind for kind, is_it in kinds.items() if is_it)

    def _is(self, value: float) -> bool:
        scale = sum(map(abs, (*self.paid, self.told, self.carried)))
        return math.isclose(self.told, value, abs_tol=LEDGER_PRECISION * scale)


def _in_halves(paid: tuple[float, ...]) -> float | None:
    """The sum as float16 has it, which is coarse; None where that is nothing."""
    with np.errstate(over="ignore"):
        return float(np.add.accumulate(np.array([0.0, *paid], np.float16))[-1]) or None


def all_told(evidence: ProbeEvidence) -> Iterator[tuple[ReportedReward, Kind]]:
    """Every look at what an agent was told, where it was paid or told anything, and what it is.

    Too much that names its cause (*carried*, *again*) is it where at least half of all that is
    wrong looks alike; else it is *lost*, as what was owed didn't come. The same numbers count once,
    for what they look like at each turn at which they come: of small ones much is told by chance.
    """
    looks = list(_all_told(evidence))
    alike: dict[tuple[float, float], tuple[Kind, ...]] = {}
    for told in (each for each in looks if not each.is_right):
        kinds = alike.setdefault(told.numbers, told.looks_like)
        alike[told.numbers] = tuple(kind for kind in kinds if kind in told.looks_like)
    counts = Counter(kind for kinds in alike.values() for kind in kinds)
    for told in looks:
        likely: Kind = "right"
        if not told.is_right:
            likely = max(alike[told.numbers], key=counts.__getitem__, default="lost")
            likely = likely if 2 * counts[likely] >= len(alike) else "lost"
        yield told, likely


def _all_told(evidence: ProbeEvidence) -> Iterator[ReportedReward]:
    for episode in evidence["rollout"]:
        yield from _told(episode, {})
    says = [fact.value.turns for fact in evidence.facts(LastRewards)]
    for episode, last in zip(evidence["books"], says, strict=False):
        yield from _told(episode, last)


def is_dead_step(turn: Turn) -> bool:
    """Tells whether the turn is the None turn of an agent that had ended."""
    return bool(turn.order) and turn.order[0] in ended_in(turn)


@dataclass(slots=True)
class _Account:
    """One agent's account; `is_sure`: all that went in is known."""

    paid: list[float] = field(default_factory=list)
    carried: float = 0.0
    is_sure: bool = True


def _book(accounts: Mapping[str, _Account], turn: Turn) -> None:
    """Notes what a step paid; what a dead step leaves standing is nobody's pay."""
    is_dead = is_dead_step(turn)
    for agent, reward in turn.rewards.items():
        account = accounts[agent]
        if is_dead or not math.isfinite(reward):
            account.is_sure = account.is_sure and not reward
            continue
        account.paid.append(reward)
    for agent, fields in turn.nonconforming.items():
        if "reward" in fields:
            accounts[agent].is_sure = False


def _told(episode: Episode, last: Mapping[int, Any]) -> Iterator[ReportedReward]:
    """The looks of one episode; `last` has the results of `last()` by turn, where known."""
    accounts = defaultdict[str, _Account](_Account)
    for turn in episode.turns:
        agent = turn.order[0] if turn.order else next(iter(turn.cumulative_reward), None)
        if agent is None:
            continue
        told, account = last.get(turn.index, turn.cumulative_reward.get(agent)), accounts[agent]
        is_known = isinstance(told, int | float) and math.isfinite(told)
        paid, carried = tuple(account.paid), account.carried
        if is_known and account.is_sure and (told or sum(paid) or carried):
            yield ReportedReward(episode, turn.index, agent, told, paid, carried)
        accounts[agent] = _Account(carried=told if is_known else 0.0)
        _book(accounts, turn)


@check("GK403", HIGH, "rollout", "books", api="aec")
def rewards_reach_the_agent(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every reward is accumulated: `last()` gives all that was paid since the agent's last turn.

    Learners get their rewards from `last()`. Rewards that are set and never accumulated,
    accumulated before they are set, or cleared before their agent's turn came, are lost to it or
    come with the wrong turn; an ended agent reads its last reward at its None turn.

    Bad:
        self._accumulate_rewards()                # the old ones
        self.rewards[agent] = 1.0

    Good:
        self._cumulative_rewards[agent] = 0       # who acts has been told
        self._clear_rewards()
        self.rewards[agent] = 1.0
        self._accumulate_rewards()

    Fix: in step(): set `self._cumulative_rewards[agent] = 0` for the agent that acts, clear
    `rewards`, set them, and call `self._accumulate_rewards()` last, on every path
    """
    for told, kind in all_told(evidence):
        where = told.episode.at(told.turn, told.agent, "cumulative_reward")
        expected = f"{told.owed!r}, the sum of `rewards` since its last turn"
        seen = f"last() gives {told.told!r}"
        yield Case(where, kind != "lost", expected, seen, reproducer_of(rewards_add_up))


@check("GK404", HIGH, "rollout", "books", api="aec")
def rewards_are_told_once(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`last()` tells each reward once: cumulative rewards are cleared when their agent acts.

    Where `_cumulative_rewards` isn't cleared, `last()` gives the return so far, and a learner
    counts the first reward of an episode once for every turn; accumulated twice in a step, every
    reward counts double.

    Bad:
        self.rewards[agent] = 1.0
        self._accumulate_rewards()                # on top of what the agent has been told

    Good:
        self._cumulative_rewards[agent] = 0
        self._clear_rewards()
        self.rewards[agent] = 1.0
        self._accumulate_rewards()

    Fix: set `self._cumulative_rewards[agent] = 0` for the agent that acts, before rewards are
    accumulated, and accumulate once in a step
    """
    for told, kind in all_told(evidence):
        more = {
            "carried": f", with the {told.carried!r} that it gave at the turn before",
            "again": ", the same more than once",
        }.get(kind, "")
        where = told.episode.at(told.turn, told.agent, "cumulative_reward")
        is_ok = kind not in ("carried", "again")
        expected = f"{told.owed!r}, the sum of `rewards` since its last turn"
        seen = f"last() gives {told.told!r}{more}"
        yield Case(where, is_ok, expected, seen, reproducer_of(rewards_add_up))


RESET_DEBT_PROOF: Final = """\
env.reset(seed=SEED)
assert env.last()[1] == 0, env.last()[1]
assert not any(env.rewards.values()), env.rewards
assert not any(env._cumulative_rewards.values()), env._cumulative_rewards  # what last() reads"""


@check("GK406", HIGH, "books", api="aec")
def reset_owes_nothing(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """A reset clears `rewards` and what `last()` tells: nothing of the last episode is owed.

    A reward of the episode before, told in the first turns of the next one, is credited to actions
    that had nothing to do with it.

    Bad:
        def reset(self, seed=None, options=None):
            self.agents = self.possible_agents[:]     # the books of the last episode stay

    Good:
        def reset(self, seed=None, options=None):
            self.agents = self.possible_agents[:]
            self.rewards = dict.fromkeys(self.agents, 0.0)
            self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)

    Fix: in reset(): `self.rewards = dict.fromkeys(self.agents, 0.0)`, and the same for
    `self._cumulative_rewards`
    """
    for fact in evidence.facts(OwedAfterReset):
        owed = fact.value
        found = {"last": owed.last, "rewards": owed.rewards, "cumulative": owed.cumulative}
        books = {name: left for name, left in found.items() if left}
        seen = "; ".join(f"{name}: {left!r}" for name, left in books.items())
        yield Case(fact.where, not books, "nothing owed after a reset", seen, RESET_DEBT_PROOF)


@check("GK407", MEDIUM, "rollout", api="aec", looks_at="a None turn of an agent that has ended")
def dead_steps_pay_nobody(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """The None step of a dead agent pays no agent: earlier rewards are cleared first.

    A reward that still stands in `rewards` after such a step is counted again by all code that sums
    it up: a converter to the Parallel API, a recorder, a score.

    Bad:
        if self.terminations[agent]:
            self.agents.remove(agent)             # `rewards` of the others is as it was
            return

    Good:
        if self.terminations[agent]:
            return self._was_dead_step(action)

    Fix: clear `rewards` in the None step of a dead agent, as `self._was_dead_step(None)` does
    """
    for episode in evidence["rollout"]:
        stood: Mapping[str, float] = {}
        ended: set[str] = set()
        for turn in episode.turns:
            ended |= turn.ended
            if is_dead_step(turn):
                left = _left(turn, stood, ended)
                where = episode.at(turn, turn.order[0], "rewards")
                expected = "nobody is paid by a dead agent's step"
                seen = f"rewards after it: {left!r}"
                yield Case(where, not left, expected, seen, reproducer_of(dead_pay_stops))
            stood = turn.rewards


def _left(turn: Turn, stood: Mapping[str, float], ended: set[str]) -> dict[str, float]:
    """Rewards of agents of the game that stood before a dead step, or that pay who has ended."""
    live = turn.live - {turn.order[0]}  # of entries of those that were removed GK106 tells
    return {
        agent: reward
        for agent, reward in turn.rewards.items()
        if reward and agent in live and (agent in ended or stood.get(agent) == reward)
    }


NO_NUMBERS: Final = ("NoneType", "str", "bytes", "list", "tuple", "dict", "complex")
"""Types that are no real numbers, whatever they hold."""


@check("GK401", HIGH, "rollout", looks_at="a step that returns rewards")
def rewards_are_numbers(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """Every reward is one finite real number: no None, no NaN or infinity, no array, no text.

    A single NaN in a batch makes every weight of a learner NaN; None and arrays crash it, or change
    the shape of what it stores. Numbers of NumPy and 0-d arrays are fine.

    Bad:
        rewards[agent] = None if agent not in scored else 1.0
        rewards[agent] = gain / cost              # 0 / 0 of numpy is NaN
        rewards[agent] = np.array([1.0])

    Good:
        rewards[agent] = 1.0 if agent in scored else 0.0
        rewards[agent] = gain / cost if cost else 0.0

    Fix: pay a finite Python or NumPy number: 0.0 where nothing is paid, `float(...)` around an
    array of one element
    """
    for episode in evidence["rollout"]:
        for turn in episode.turns:
            strange = _strange(turn)
            rewards: dict[str, Any] = {**strange, **turn.rewards, **strange}
            for agent, seen in rewards.items():
                is_ok = agent not in strange and math.isfinite(seen)
                where = episode.at(turn, agent, "rewards")
                proof = _number_proof(evidence.api, agent)
                yield Case(where, is_ok, "one finite real number", seen, proof)


def _strange(turn: Turn) -> dict[str, str]:
    """Rewards that are no numbers, in words, by agent; missing ones are another check's."""
    found = {}
    for agent, fields in turn.nonconforming.items():
        entry = fields.get("reward")
        if entry is not None and "value" in entry and not _is_number(entry):
            found[agent] = f"{entry['value']!r} ({entry['type']})"
    return found


def _is_number(entry: dict[str, Any]) -> bool:
    if entry["type"] in NO_NUMBERS:
        return False
    value = entry["value"]
    if getattr(value, "shape", ()) != ():
        return False
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError):  # kept as words: another library's number, not judged
        return type(value).__name__ == "Opaque"


def _number_proof(api: str, agent: str) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"reward = {{str(a): r for a, r in {rewards}.items()}}[{agent!r}]\n"
        "assert not isinstance(reward, str) and np.ndim(reward) == 0, repr(reward)\n"
        "assert np.isfinite(float(reward)), repr(reward)"
    )


def _allowed(contract: Contract, evidence: ProbeEvidence) -> str | None:
    is_allowed = contract.after_end == "allowed"
    return "the contract allows rewards after the end" if is_allowed else None


@check(
    "GK402",
    HIGH,
    "rollout",
    applies=_allowed,
    looks_at="a turn after an agent's end (AEC: in which another agent acts)",
)
def rewards_stop_at_the_end(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """An agent that has ended is paid nothing more.

    Learners bootstrap past the end and credit the wrong action with a reward that comes later. What
    an agent earns by the step that ends it is paid by that very step.

    Bad:
        for agent in self.possible_agents:        # also those that are gone
            rewards[agent] += team_bonus

    Good:
        for agent in self.agents:
            rewards[agent] += team_bonus

    Fix: pay an agent 0 once it has ended, or declare rewards.after_end = "allowed"
    """
    for episode in evidence["rollout"]:
        ended: frozenset[str] = frozenset()
        for turn in episode.turns:
            ended = (ended - turn.live) | turn.ended  # who is live again is another check's
            if evidence.api == "aec" and is_dead_step(turn):
                continue  # what a dead step leaves standing is GK407's
            for agent in sorted(ended):
                paid = turn.rewards.get(agent, 0.0)
                where = episode.at(turn, agent, "rewards")
                yield Case(where, paid == 0.0, 0.0, paid, _after_end_proof(evidence.api, agent))


def _after_end_proof(api: str, agent: str) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"paid = {{str(a): r for a, r in {rewards}.items()}}\n"
        f"assert paid.get({agent!r}, 0) == 0, paid"
    )


@check("GK405", HIGH, "books", api="aec")
def rewards_are_made_anew(contract: Contract, evidence: ProbeEvidence) -> Cases:
    """`rewards` is cleared in every step: it holds what that step paid, nothing from before.

    A reward that still stands after the next step is accumulated again, once for every step until
    something overwrites it; a converter to the Parallel API counts it as often. Looked at by
    raising a reward before a step: what is paid must not rise with it.

    Bad:
        def step(self, action):
            ...
            self.rewards[agent] = gain            # everybody else's still stands
            self._accumulate_rewards()

    Good:
        def step(self, action):
            ...
            self._clear_rewards()
            self.rewards[agent] = gain
            self._accumulate_rewards()

    Fix: call `self._clear_rewards()` at the start of every step of a live agent
    """
    for fact in evidence.facts(MarkedReward):
        seen = fact.value
        yield Case(
            fact.where,
            not seen.stood,
            "made by the step alone",
            f"the reward {seen.reward!r} from before the step still stands after it",
            proof=_fresh_rewards_proof(seen.agent, seen.mark),
        )


def _fresh_rewards_proof(agent: Any, mark: float) -> Reproducer:
    lines = f"""\
def paid(mark):
    \"\"\"What the last step pays where a reward was raised before it.\"\"\"
    env = make()
    env.reset(seed=SEED)
    for action in ACTIONS[:-1]:
        env.last()
        env.step(action)
    env.rewards[{key_literal(agent)}] += mark  # which the next step must clear
    env.last()
    env.step(ACTIONS[-1])
    return float(env.rewards.get({key_literal(agent)}, 0))

mark = {mark!r}
more = paid(mark) - paid(0)
assert abs(more - mark) > 1e-3 * mark, more"""
    return Reproducer(lines, plays=False)
