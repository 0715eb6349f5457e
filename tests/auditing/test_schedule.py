"""Schedule: who is selected, how the dead leave, whether the declared order is kept."""

from typing import Any

import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.contract import Contract
from tests.auditing.roster_games import Turning
from tests.faults.traders import Traders


def audited(
    spec: object, *, contract: dict[str, Any] | None = None, budget: int = 300
) -> AuditResult:
    """The audit of a small game, by the checks of schedules."""
    declared = None if contract is None else Contract.from_json(contract)
    found = audit_here(spec, contract=declared, select=("GK30", "GK501"), budget=budget)
    assert [v.reason for v in found.verdicts if v.outcome == "error"] == []
    return found


def broken(spec: object, **options: Any) -> set[str]:
    """The ids of the checks that are broken."""
    return {verdict.id for verdict in audited(spec, **options).failed}


@pytest.mark.parametrize("ids", [("a", "b", "c"), (0, 1, 2), (("red", 0), 1, "b")], ids=str)
def test_agents_may_be_called_anything(ids: Any) -> None:
    """Numbers and tuples name agents as well as texts do."""
    assert broken(lambda: Turning(ids)) == set()


def test_several_may_end_at_once() -> None:
    """Each of those who end together has its own None turn."""
    found = audited(lambda: Traders(count=4, rounds=1))
    assert found.failed == ()
    assert found.of("GK302").outcome == found.of("GK303").outcome == "passed"


def test_one_agent_and_an_object_are_enough() -> None:
    """A game for one keeps every promise, also where only the object is there."""
    found = audited(Turning(("a",), (4,)))
    assert found.failed == ()
    assert found.of("GK303").outcome == "passed"


class Emptied(Turning):
    """All are taken out with the step that ends them."""

    def step(self, action: Any) -> None:
        """Nobody has a None turn."""
        super().step(action)
        if any(self.terminations.values()):
            self.agents = []


def test_an_emptied_roster_gives_nobody_a_turn() -> None:
    """Agents that end with the game have None turns too."""
    assert broken(Emptied) == {"GK302"}


class InTurn(Turning):
    """The dead have their None turn when their turn comes."""

    def step(self, action: Any) -> None:
        """After a None step whoever comes first goes on."""
        super().step(action)
        if self.agents and self.agent_selection not in self.agents:
            self.agent_selection = self.agents[0]

    def _deads_step_first(self) -> Any:
        return self.agent_selection


def test_the_dead_may_wait_for_their_turn() -> None:
    """A None turn that comes within the round is early enough."""
    assert broken(lambda: InTurn(ends=(3, 9, 9))) == set()


class Leaving(Turning):
    """The last agent leaves after a while, as its role may."""

    def step(self, action: Any) -> None:
        """Takes it out of all books."""
        super().step(action)
        if sum(self.counts.values()) == 4 and "c" in self.agents and self.agent_selection != "c":
            for book in (
                self.rewards,
                self._cumulative_rewards,
                self.terminations,
                self.truncations,
                self.infos,
            ):
                del book["c"]
            self.agents.remove("c")


@pytest.mark.parametrize(("may_leave", "found"), [(True, set()), (False, {"GK501"})])
def test_a_role_may_leave_where_it_is_declared(may_leave: bool, found: set[str]) -> None:
    """`may_leave` allows what is a fault without it."""
    roles = {"guest": {"agents": ["a", "b", "c"], "may_leave": may_leave}}
    assert broken(Leaving, contract={"roles": roles}) == found


class Stages(Turning):
    """Agents in an order that is told in advance."""

    def __init__(self, rounds: tuple[str, ...]) -> None:
        super().__init__(("p_0", "p_1", "c_0"), (999, 999, 999))
        self.rounds = rounds

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Begins with the first that is told."""
        super().reset(seed, options)
        self.agent_selection = self.called(0)

    def called(self, turn: int) -> str:
        """Whose turn it is."""
        names = {"0": "p_0", "1": "p_1", "c": "c_0"}
        order = [names[letter] for tick in self.rounds for letter in tick]
        return order[turn % len(order)]

    def step(self, action: Any) -> None:
        """Selects who is told to come next."""
        super().step(action)
        self.agent_selection = self.called(sum(self.counts.values()))


@pytest.mark.parametrize(
    ("rounds", "order", "is_kept"),
    [
        (("01c",), "fixed", True),
        (("01c", "10c"), "rotating", True),
        (("01c", "10c"), "fixed", False),
        (("01c",), "rotating", False),
        (("0c1",), "fixed", False),
        (("01c", "0c"), "fixed", False),
        (("01c", "10c"), "state", True),
        (("10c", "0c1"), "random", False),
    ],
)
def test_order_is_the_declared_one(rounds: tuple[str, ...], order: str, is_kept: bool) -> None:
    """Stages follow each other, and within them agents act in the declared order."""
    contract = {"schedule": {"stages": [["p"], ["c"]], "order": order}, "roles": {"p": {}, "c": {}}}
    found = audited(lambda: Stages(rounds), contract=contract)
    assert (found.of("GK306").outcome == "passed") is is_kept
    assert found.of("GK306").outcome in ("passed", "failed")


def test_order_is_not_judged_undeclared() -> None:
    """Without a declared order there is nothing to judge."""
    assert audited(Traders).of("GK306").outcome == "not_applicable"
