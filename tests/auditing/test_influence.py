"""Replaced actions: what they move, when, and what is seen of them too early."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.checks.facts.episode_facts import PaymentTime
from gamekeeper.checks.probe_evidence import Fact, ProbeEvidence, ProbeRun
from gamekeeper.checks.rewards.reward_delay import rewards_come_with_the_tick_that_earns_them
from gamekeeper.contract import Contract
from gamekeeper.episodes.where import Where
from tests.auditing.small_games import Grab
from tests.auditing.sound_games import Table
from tests.auditing.sound_habits import Gifts, Lottery
from tests.faults.payers import Pursuit
from tests.faults.ticks import HANDS_CONTRACT, Hands
from tests.faults.walkers import Walkers


def verdict(spec: Any, id: str, **options: Any) -> Any:
    """What one check came to."""
    found = audit_here(spec, select=(id,), **{"budget": 500, **options}).of(id)
    assert found.outcome != "error", found.reason
    return found


class Prompt(Pursuit):
    """The same game with rewards after the moves."""

    def step(self, actions: Any) -> Any:
        """Pays once all have moved."""
        acting = list(self.agents)
        out = super().step(actions)
        return out[0], {a: self.reward(a) for a in acting}, *out[2:]


class Sled(Prompt):
    """Actions push, and positions follow a tick later: slow by its rules, not a late reward."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody moves yet."""
        self.push = {a: np.zeros(2, int) for a in self.possible_agents}
        return super().reset(seed, options)

    def step(self, actions: Any) -> Any:
        """Drifts on, then takes the new push."""
        acting = list(self.agents)
        for agent in acting:
            self.cells[agent] = (self.cells[agent] + self.push[agent]) % 6
        held = {a: self.cells[a].copy() for a in acting}
        out = Pursuit.step(self, actions)
        for agent in acting:
            self.push[agent] = self.cells[agent] - held[agent]
            self.cells[agent] = held[agent]
        seen = {a: self.observation(a) for a in acting}
        return seen, {a: self.reward(a) for a in acting}, *out[2:]

    def observation(self, agent: Any) -> Any:
        """The push stands in place of the last evader."""
        seen = super().observation(agent)
        seen[-2:] = self.push[agent] % 6
        return seen


class LateShaping(Pursuit):
    """A catch is paid at once, and nearness one tick late; `terms` tell both where asked to."""

    tells = False

    def step(self, actions: Any) -> Any:
        """Takes nearness from before the moves, the catch from after them."""
        acting = list(self.agents)
        near = {a: self.reward(a) - self.caught(a) for a in acting}
        out = super().step(actions)
        self.terms = {a: {"catch": self.caught(a), "near": near[a]} for a in acting}
        paid = {a: sum(self.terms[a].values()) for a in acting}
        if not self.tells:
            del self.terms
        return out[0], paid, *out[2:]

    def caught(self, agent: Any) -> float:
        """The evaders on the own cell."""
        return float((self.evaders == self.cells[agent]).all(axis=1).sum())


class ToldLateShaping(LateShaping):
    """The same with its terms told."""

    tells = True

    def __init__(self) -> None:
        super().__init__()
        self.terms: dict[str, Any] = {}


class Harvest(Prompt):
    """Nothing but catches pays, at once: what moves a next reward is the way to it."""

    def reward(self, agent: Any) -> float:
        """The evaders on the own cell."""
        return float((self.evaders == self.cells[agent]).all(axis=1).sum())


def test_a_late_part_beside_one_on_time_is_broken() -> None:
    """Nearness one tick late beside catches on time, whether or not the terms are told."""
    assert verdict(LateShaping, "GK411", budget=1_000).outcome == "failed"
    terms = Contract.from_json({"rewards": {"catch": {}, "near": {}}})
    found = verdict(ToldLateShaping, "GK411", contract=terms)
    assert found.outcome == "failed"
    assert all("near" in each.where and "catch" not in each.where for each in found.findings)


def test_catches_alone_are_no_late_part() -> None:
    """A catch that two moves lead to is decided by either, and was paid on time."""
    assert verdict(Harvest, "GK411", budget=2_000).outcome in ("passed", "not_exercised")


def test_rewards_before_the_moves_are_broken() -> None:
    """Pursuit's rewards of the state before the tick come one step late."""
    assert verdict(Pursuit, "GK411").outcome == "failed"


def test_rewards_after_the_moves_are_kept() -> None:
    """The same game, paid once all have moved."""
    assert verdict(Prompt, "GK411").outcome == "passed"


def test_slow_rules_are_no_late_reward() -> None:
    """A position that follows a push a tick later moves the reward later too, and is right."""
    assert verdict(Sled, "GK411").outcome == "passed"


def test_gifts_that_are_seen_are_no_rewards_of_another_one() -> None:
    """An agent that observes what it got is meant to be paid for what another one did."""
    assert verdict(Gifts, "GK416", budget=1_500).outcome == "passed"


def test_payment_by_a_later_draw_is_no_late_reward() -> None:
    """What tickets win is decided by the draw of the tick that pays, not when they are bought."""
    assert verdict(partial(Lottery, ticks=30), "GK411", budget=8_000).outcome == "passed"


class Bids(Table):
    """An auction: who folds pays at once and leaves, the last one has what it bid for."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Nothing is bid."""
        super().reset(seed, options)
        self.price, self.holder = 0.0, None
        self.values = {a: float(self.rng.uniform(0.2, 0.9)) for a in self.agents}

    def observe(self, agent: Any) -> Any:
        """The own value and the price."""
        return np.array([self.values[agent], self.price])

    def step(self, action: Any) -> None:
        """Folds by 0; else bids more."""
        agent, ended = self.agent_selection, self.terminations
        if ended[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        following = self.next_bidder(agent)
        if action > 0:
            self.price, self.holder = self.price + 0.05 * int(action), agent
        elif self.holder != agent:
            ended[agent], self.rewards[agent] = True, -0.1
            if self.next_bidder(following) == following:
                ended[following] = True
                self.rewards[following] = self.values[following] - self.price
        self.agent_selection = following
        self._accumulate_rewards()
        self._deads_step_first()

    def next_bidder(self, agent: Any) -> Any:
        """The next one that hasn't folded."""
        there = [a for a in self.agents if a == agent or not self.terminations[a]]
        return there[(there.index(agent) + 1) % len(there)]


def test_what_an_agent_pays_as_it_leaves_is_on_time() -> None:
    """A fold ends its bidder, who has one look left: it counts beside bids that matter later."""
    assert verdict(partial(Bids, ("a", "b", "c", "d")), "GK411", budget=2_000).outcome == "passed"


def test_a_game_that_pays_nothing_is_not_exercised() -> None:
    """Without rewards nobody can tell when they come."""
    assert verdict(partial(Grab, "none", (1,), 3), "GK411").outcome in ("passed", "not_exercised")


def test_hands_shown_need_the_declaration() -> None:
    """Turns that answer each other are a game of their own unless declared simultaneous."""
    assert verdict(Hands, "GK331").outcome == "not_applicable"
    declared = Contract.from_json(HANDS_CONTRACT)
    assert verdict(Hands, "GK331", contract=declared).outcome == "failed"


def test_stages_may_see_each_other() -> None:
    """Who is declared to act in a later stage may see what the earlier one did."""
    declared = Contract.from_json(
        {
            "api": "aec",
            "roles": {
                name: {"agents": [f"player_{place}"]}
                for place, name in enumerate(("one", "two", "three"))
            },
            "schedule": {"stages": [["one"], ["two"], ["three"]], "observe": "after tick"},
        }
    )
    assert verdict(Hands, "GK331", contract=declared).outcome == "not_exercised"


def test_a_bump_that_both_can_avoid_is_joint() -> None:
    """A penalty that its payee could have avoided too lands on no wrong participant."""

    class Crash(Grab):
        def step(self, actions: Any) -> Any:
            """Two who ask at once crash; the first of them pays."""
            asking = [a for a in self.agents if actions[a] == 1]
            out = super().step(actions)
            paid = {a: -float(len(asking) > 1 and a == asking[0]) for a in out[1]}
            return out[0], paid, *out[2:]

    declared = Contract.from_json(
        {
            "roles": {"player": {"agents": ["*"]}},
            "rewards": {"crash": {"kind": "individual", "earner": "all", "payee": "earner"}},
        }
    )
    assert verdict(Crash, "GK421", contract=declared).outcome == "passed"


def test_undeclared_terms_are_not_judged() -> None:
    """Whose doing a reward is, only a contract says."""
    assert verdict(partial(Grab, "none"), "GK421").outcome == "not_applicable"


def test_symmetry_under_a_declared_priority_is_not_judged() -> None:
    """Where some agents are declared to come first, they may fare better."""
    roles = {"player": {"agents": ["*"], "symmetric": True}}
    declared = Contract.from_json({"roles": roles, "schedule": {"conflicts": "priority"}})
    assert verdict(partial(Grab, "first"), "GK511", contract=declared).outcome == "not_applicable"


def test_hidden_priority_shows_among_symmetric_agents() -> None:
    """Who always wins conflicts isn't interchangeable with the others."""
    roles = {"player": {"agents": ["*"], "symmetric": True}}
    declared = Contract.from_json({"roles": roles})
    found = {
        rule: verdict(partial(Grab, rule, (0, 1, 2), 20), "GK511", contract=declared).outcome
        for rule in ("first", "draw")
    }
    assert found == {"first": "failed", "draw": "passed"}


class LateCoin(Grab):
    """Asking costs at once; the coin is seen at once, and paid one step late."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Owes nothing."""
        self.due: dict[Any, float] = {}
        return super().reset(seed, options)

    def step(self, actions: Any) -> Any:
        """Pays the coin of the step before."""
        due, out = self.due, super().step(actions)
        self.due = out[1]
        return out[0], {a: due.get(a, 0.0) - 0.1 * actions[a] for a in out[1]}, *out[2:]


def test_a_rare_reward_one_tick_late_is_broken() -> None:
    """A coin that two agents decide, beside a cost on time that their actions move too."""
    found = verdict(partial(LateCoin, "none", (0, 1), 12), "GK411", budget=600)
    assert found.outcome == "failed"
    assert "more than usual" in found.findings[0].actual


@pytest.mark.parametrize(
    ("shown", "after", "is_on_time", "cases"),
    [
        ({0}, {0}, False, [False] * 4),
        ({0, 1}, {0}, False, []),  # announced, and back once it was paid
        ({0}, {0, 1}, False, []),  # what pays happens a tick later too
        (set(), {0}, False, []),  # nothing shows that anything was done
        ({0}, {0}, True, [True]),  # one of that size can be changed in its own tick
    ],
)
def test_late_payments_are_judged_by_what_observations_tell(
    shown: set[int], after: set[int], is_on_time: bool, cases: list[bool]
) -> None:
    """A delay that is a rule of the environment isn't called broken."""
    late = PaymentTime(
        "a", 2.0, ((1, "a", 0),), False, (0, "a", 1), *map(frozenset, (shown, after))
    )
    seen = [late] * 4 + [PaymentTime("a", 2.1, ((1, "a", 0),), is_on_time=True)] * is_on_time
    facts = tuple(
        Fact(Where("payment_times", k, 1, "a", "rewards"), each) for k, each in enumerate(seen)
    )
    evidence = ProbeEvidence("parallel", looks={"payment_times": (ProbeRun(facts=facts),)})
    found = rewards_come_with_the_tick_that_earns_them.run(Contract(), evidence)
    assert [case.ok for case in found] == cases


class ShiftedAsTheyFall(Walkers):
    """Rewards of those that are left come first, in the steps in which some fall."""

    def paid(self, acting: list[str]) -> dict[str, float]:
        """In the order of those that are left, then of those that fall."""
        own = super().paid(acting)
        order = [a for a in acting if a in self.agents] + [
            a for a in acting if a not in self.agents
        ]
        return dict(zip(acting, [own[a] for a in order], strict=True))


@pytest.mark.parametrize(("spec", "outcome"), [(ShiftedAsTheyFall, "failed"), (Walkers, "passed")])
def test_rewards_that_are_shifted_as_agents_leave_are_found(spec: Any, outcome: str) -> None:
    """A shift in the very step of a removal is a shift too; moves of the probe `form` show it."""
    assert verdict(spec, "GK415", budget=1_400).outcome == outcome
