"""Reward books: what is a reward, what `last()` tells, what stands in `rewards`, declared terms."""

from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.contract import Contract
from tests.auditing.roster_games import Counting, Turning
from tests.auditing.sound_games import Table
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders

CHANCE = np.random.default_rng(8)
"""Of no instance."""


def audited(
    spec: object, *, contract: dict[str, Any] | None = None, budget: int = 300
) -> AuditResult:
    """The audit of a small game, by the checks of rewards."""
    declared = None if contract is None else Contract.from_json(contract)
    found = audit_here(spec, contract=declared, select=("GK40",), budget=budget)
    assert [v.reason for v in found.verdicts if v.outcome == "error"] == []
    return found


def broken(spec: object, **options: Any) -> set[str]:
    """The ids of the checks that are broken."""
    return {verdict.id for verdict in audited(spec, **options).failed}


def paying(reward: Any) -> Any:
    """A Parallel game that pays the first agent `reward`."""

    def bend(env: Any, out: Any) -> Any:
        if "a" in out[1]:
            out[1]["a"] = reward
        return out

    return lambda: Counting(bend=bend)


@pytest.mark.parametrize("game", [Counting, Turning])
@pytest.mark.parametrize("ids", [("a", "b", "c"), (0, 1, 2), (("red", 0), 1, "b")], ids=str)
def test_agents_may_be_called_anything(game: Any, ids: Any) -> None:
    """Numbers and tuples name agents as well as texts do."""
    assert broken(lambda: game(ids)) == set()


@pytest.mark.parametrize("game", [Counting, Turning])
def test_one_agent_and_an_object_are_enough(game: Any) -> None:
    """A game for one keeps every promise, also where only the object is there."""
    assert broken(game(("a",), (4,))) == set()


@pytest.mark.parametrize(
    "reward",
    [1, True, np.float32(0.5), np.int8(3), np.float16(1), np.array(2.0), 2**60, np.longdouble(1)],
    ids=lambda reward: type(reward).__name__,
)
def test_rewards_may_be_any_real_number(reward: Any) -> None:
    """Numbers of Python and of NumPy are rewards, and so is an array without axes."""
    assert broken(paying(reward)) == set()


@pytest.mark.parametrize(
    "reward", [None, "1.0", float("nan"), float("inf"), np.array([1.0]), [1.0], {}, 1j], ids=str
)
def test_rewards_are_numbers(reward: Any) -> None:
    """What is no finite real number is no reward."""
    assert broken(paying(reward)) == {"GK401"}


def test_nan_in_the_books_is_one_fault() -> None:
    """A NaN in an AEC environment is told as such, not as a sum that is wrong."""

    def bend(env: Any) -> None:
        env.rewards[env.agents[0]] = float("nan")

    assert broken(lambda: Turning(bend=bend)) == {"GK401"}


class Sums(Traders):
    """Traders whose books are in float32, as some environments keep them."""

    def settle(self) -> None:
        """Pays thirds."""
        super().settle()
        self.rewards = {a: np.float32(r) / np.float32(3) for a, r in self.rewards.items()}


def test_books_in_float32_are_right() -> None:
    """What rounding leaves is no fault."""
    assert broken(Sums) == set()


class Paid(Turning):
    """Everybody is paid alike by every turn, as an environment with a cost of living does."""

    def _accumulate_rewards(self) -> None:
        self.rewards = {a: 0.0 if self.terminations[a] else -1.0 for a in self.agents}
        super()._accumulate_rewards()


def test_equal_rewards_in_a_row_are_no_leftovers() -> None:
    """A reward that each step makes anew stands there again without having stood there."""
    found = audited(lambda: Paid(ends=(8, 8, 8)))
    assert found.of("GK405").outcome == "passed"
    assert {each.id for each in found.failed} <= {"GK407"}


class Late(Traders):
    """Accumulates before it settles: what is paid comes with the next turn."""

    def _clear_rewards(self) -> None:
        for agent in self.rewards:
            self._cumulative_rewards[agent] += self.rewards[agent]
        super()._clear_rewards()

    def _accumulate_rewards(self) -> None:
        """Has been done."""


class Twice(Traders):
    """Accumulates twice."""

    def _accumulate_rewards(self) -> None:
        super()._accumulate_rewards()
        super()._accumulate_rewards()


class Forgets(Traders):
    """Clears what was accumulated for everybody, whoever acts."""

    def step(self, action: Any) -> None:
        """Forgets all before."""
        self._cumulative_rewards = dict.fromkeys(self._cumulative_rewards, 0.0)
        super().step(action)


class Next(Traders):
    """Clears what the next agent has been paid, not the one that acts."""

    def _accumulate_rewards(self) -> None:
        super()._accumulate_rewards()
        self._cumulative_rewards[self.agent_selection] = 0.0


class OnlyLast(Traders):
    """`last()` gives what the last step paid."""

    def last(self, observe: bool = True) -> Any:
        """With `rewards` in place of their sum."""
        observation, _, *rest = super().last(observe)
        return observation, self.rewards[self.agent_selection], *rest


class Coarse(Traders):
    """Keeps its books in tenths, and pays in twentieths: -0.1 of -0.05 looks like twice as much."""

    def settle(self) -> None:
        """A small fee of everybody's."""
        super().settle()
        self.rewards = {agent: reward - 0.05 for agent, reward in self.rewards.items()}

    def _accumulate_rewards(self) -> None:
        super()._accumulate_rewards()
        books = self._cumulative_rewards
        self._cumulative_rewards = {agent: round(books[agent], 1) for agent in books}


@pytest.mark.parametrize(
    ("game", "id"),
    [
        (Late, "GK403"),
        (Twice, "GK404"),
        (Forgets, "GK403"),
        (Next, "GK403"),
        (OnlyLast, "GK403"),
        (Coarse, "GK403"),
    ],
)
def test_what_is_told_is_what_is_owed(game: Any, id: str) -> None:
    """Rewards that come late, twice, to nobody, or not through `last()` are found."""
    assert broken(game, budget=900) == {id}


class Tiny(Forgets):
    """The same fault where a reward is next to nothing."""

    def settle(self) -> None:
        """Pays in a small unit."""
        super().settle()
        self.rewards = {agent: 1e-12 * reward for agent, reward in self.rewards.items()}


def test_what_is_owed_may_be_small() -> None:
    """A reward that is lost is found whatever its unit, and its program fails."""
    found = audited(Tiny, budget=900)
    assert {each.id for each in found.failed} == {"GK403"}
    with pytest.raises(AssertionError):
        exec(program_of(found, "GK403", Tiny), {})


class Undecided(Table):
    """Pays large sums that no seed determines."""

    def pay(self, agent: Any, won: float, before: dict[Any, Any]) -> None:
        """A cent or thousands, from another source of chance."""
        for each in self.agents:
            self.rewards[each] = float(CHANCE.choice([0.01, 5_000.0, 100_000.0]))


def test_rewards_that_no_seed_settles_are_no_marks() -> None:
    """Other rewards in a second episode aren't what was put there."""
    assert broken(Undecided, budget=900) == set()


class OwedInItsMidst(Traders):
    """A reset in mid-episode leaves what was owed; one after an end doesn't."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Forgets the debts of those who have ended."""
        books = (vars(self).get(name, {}) for name in ("terminations", "truncations"))
        is_over = any(any(book.values()) for book in books)
        book = {} if is_over else dict(getattr(self, "_cumulative_rewards", {}))
        super().reset(seed, options)
        self._cumulative_rewards.update(book)


def test_debts_before_any_end_are_looked_for_after_a_reset() -> None:
    """An episode is cut after its last payment, and where one agent is due most before an end."""
    assert audit_here(OwedInItsMidst, select=("GK406",), budget=400).of("GK406").outcome == "failed"


class Restless(Traders):
    """Rewards stand, and are large."""

    def settle(self) -> None:
        """Pays millions."""
        super().settle()
        self.rewards = {agent: 1e6 * reward for agent, reward in self.rewards.items()}

    def _clear_rewards(self) -> None:
        """Forgets to."""


def test_rewards_that_stand_are_found_at_any_size() -> None:
    """A reward of millions that isn't cleared is found, and its program fails."""
    found = audited(Restless, budget=900)
    assert "GK405" in {each.id for each in found.failed}
    with pytest.raises(AssertionError):
        exec(program_of(found, "GK405", Restless), {})


def program_of(found: AuditResult, id: str, build: Any) -> str:
    """The program of a check's first finding, told how to build the environment."""
    program = found.of(id).findings[0].reproducer
    assert "...  # your environment" in program
    at = f"__import__({build.__module__!r}, fromlist=['_']).{build.__name__}()"
    return program.replace("...  # your environment", at)


class Cleared(Traders):
    """Clears the reward of the agent that acts, and of nobody else."""

    def _clear_rewards(self) -> None:
        agent = self.agent_selection
        if agent in self.rewards:
            self.rewards[agent] = 0.0


def test_rewards_of_others_must_be_cleared_too() -> None:
    """What stands there of the others is paid again."""
    assert "GK405" in broken(Cleared, budget=900)


ZERO_SUM = {"rewards": {"score": {"kind": "zero-sum", "payee": "all"}}}
SHARED = {"rewards": {"score": {"kind": "shared", "payee": "all"}}}


@pytest.mark.parametrize(
    ("rewards", "contract", "found"),
    [
        ((1.0, -1.0), ZERO_SUM, set()),
        ((0.1 + 0.2, -0.3), ZERO_SUM, set()),
        ((0.1 / 3, float(np.float32(-0.1 / 3))), ZERO_SUM, set()),
        ((1.0, -0.5), ZERO_SUM, {"GK409"}),
        ((1e-9, -0.5e-9), ZERO_SUM, {"GK409"}),
        ((2.0, 2.0), SHARED, set()),
        ((2.0, 1.0), SHARED, {"GK409"}),
    ],
)
def test_a_single_term_is_the_reward(
    rewards: tuple[float, float], contract: dict[str, Any], found: set[str]
) -> None:
    """Where one term is declared, it is what `rewards` says, in both APIs."""

    def at_once(env: Any, out: Any) -> Any:
        if len(out[1]) == 2:
            out[1].update(zip(("a", "b"), rewards, strict=True))
        return out

    def in_turns(env: Any) -> None:
        env.rewards.update(zip(("a", "b"), rewards, strict=True))

    both = ("a", "b"), (999, 999)
    assert broken(lambda: Counting(*both, bend=at_once), contract=contract, budget=99) == found
    ids = broken(lambda: Turning(*both, bend=in_turns), contract=contract, budget=99)
    assert ids & {"GK408", "GK409"} == found


def test_terms_that_nobody_tells_are_not_judged() -> None:
    """Two terms are declared, and the environment tells of none."""
    terms = {"rewards": {name: {"kind": "shared", "payee": "all"} for name in ("one", "two")}}
    found = audited(Rovers, contract=terms)
    assert found.of("GK408").outcome == "not_applicable"
    assert found.of("GK409").outcome == "not_exercised"
