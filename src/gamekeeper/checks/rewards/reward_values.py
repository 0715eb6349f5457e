"""Checks of rewards: numbers, made anew, and 0 after the end."""

from __future__ import annotations

import math
from typing import Any, Final

from gamekeeper.checks.case import Reproducer
from gamekeeper.checks.check import HIGH, Case, Cases, check
from gamekeeper.checks.facts.aec_book_facts import MarkedReward
from gamekeeper.checks.probe_evidence import ProbeEvidence
from gamekeeper.checks.rewards.reward_ledger import is_dead_step
from gamekeeper.contract import Contract
from gamekeeper.episodes.episode import Turn

NO_NUMBERS: Final = ("NoneType", "str", "bytes", "list", "tuple", "dict", "complex")
"""Types that are no real numbers, whatever they hold."""


@check(
    "GK401",
    needs=("rollout",),
    severity=HIGH,
    fix="pay a finite Python or NumPy number: 0.0 where nothing is paid, `float(...)` around an "
    "array of one element",
    looks_at="a step that returns rewards",
)
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
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            strange = _strange(turn)
            for agent, seen in strange.items():
                where = trace.at(turn, agent, "rewards")
                expected = "one finite real number"
                yield Case(where, False, expected, seen, _number_proof(evidence.api, agent))
            for agent, reward in turn.rewards.items():
                if agent not in strange:
                    where = trace.at(turn, agent, "rewards")
                    is_ok = math.isfinite(reward)
                    expected = "one finite real number"
                    yield Case(where, is_ok, expected, reward, _number_proof(evidence.api, agent))


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
    needs=("rollout",),
    severity=HIGH,
    fix='pay an agent 0 once it has ended, or declare rewards.after_end = "allowed"',
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
    """
    for trace in evidence["rollout"]:
        ended: frozenset[str] = frozenset()
        for turn in trace.turns:
            ended = (ended - turn.live) | turn.ended  # who is live again is another check's
            if evidence.api == "aec" and is_dead_step(turn):
                continue  # what a dead step leaves standing is GK407's
            for agent in sorted(ended):
                paid = turn.rewards.get(agent, 0.0)
                where = trace.at(turn, agent, "rewards")
                yield Case(where, paid == 0.0, 0.0, paid, _after_end_proof(evidence.api, agent))


def _after_end_proof(api: str, agent: str) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"paid = {{str(a): r for a, r in {rewards}.items()}}\n"
        f"assert paid.get({agent!r}, 0) == 0, paid"
    )


@check(
    "GK405",
    needs=("books",),
    severity=HIGH,
    api="aec",
    fix="call `self._clear_rewards()` at the start of every step of a live agent",
)
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
    env.rewards[{agent!r}] += mark  # which the next step must clear
    env.last()
    env.step(ACTIONS[-1])
    return float(env.rewards.get({agent!r}, 0))

mark = {mark!r}
more = paid(mark) - paid(0)
assert abs(more - mark) > 1e-3 * mark, more"""
    return Reproducer(lines, plays=False)
