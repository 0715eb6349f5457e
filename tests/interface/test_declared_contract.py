"""A declared contract fits the environment that it is for."""

import pytest

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.errors import ContractError
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import open_env
from tests.interface.test_draft import Roster

AGENTS = ["picker_0", "picker_1", "carrier_0"]


def refused(text: str, env: object = None) -> ContractError:
    """The error that a contract meets in an environment."""
    opened = open_env(Roster(AGENTS) if env is None else env)
    with pytest.raises(ContractError) as caught:
        declared_contract(Contract.parse(text, source="c.toml"), opened)
    return caught.value


def test_role_that_matches_no_agent_is_refused() -> None:
    """The error names the pattern's line, the possible agents and the nearest of them."""
    error = refused('[roles.picker]\n[roles.dave]\nagents = "carier_*"')
    assert error.what == "role 'dave' matches no agent of the environment"
    assert error.where == "c.toml, line 3, roles.dave.agents"
    assert error.expected.endswith("possible agents: picker_0, picker_1, carrier_0")
    assert error.actual == "'carier_*'"
    assert "'carrier_0'" in error.fix


def test_role_that_stands_only_in_a_stage_is_refused_there() -> None:
    """Its place is the stage that names it; that its agents may join later excuses nothing."""
    error = refused('[schedule]\nstages = [["picker"],\n["dave"]]')
    assert error.where == "c.toml, line 3, schedule.stages[1][0]"
    assert "dave" in refused("[roles.dave]\nmay_join = true").what


def test_everything_that_does_not_fit_is_refused_together() -> None:
    """Roles without agents, and noops outside the action space: once for each role."""
    text = '[roles.dave]\nagents = "dave_*"\n[roles.picker]\nnoop = 9\n[roles.carrier]\nnoop = -1'
    error = refused(text)
    assert error.where.split("; ") == [
        "c.toml, line 2, roles.dave.agents",
        "c.toml, line 4, roles.picker.noop",
        "c.toml, line 6, roles.carrier.noop",
    ]
    assert "expected: an action in Discrete(3)   actual: 9" in error.what


@pytest.mark.parametrize(
    "text",
    [
        '[roles.robot]\nagents = ["picker_*", "carrier_*", "dave_*"]\nnoop = 2',
        "[roles.picker]\n[roles.carrier]",
        "",
    ],
)
def test_contract_of_a_larger_roster_fits(text: str) -> None:
    """A role fits if one of its patterns matches; agents may stand in no role."""
    contract = Contract.parse(text)
    assert declared_contract(contract, open_env(Roster(AGENTS))) == contract


def test_roster_that_is_unknown_before_reset_refuses_nothing() -> None:
    """Without possible agents nothing can be said of them."""
    contract = Contract.parse("[roles.dave]\nnoop = 9")
    assert declared_contract(contract, open_env(Roster([]))) == contract


def test_role_may_be_empty_by_an_argument() -> None:
    """Arguments may leave a role without agents, as long as all agents are in a role."""
    text = "[roles.{}]\n[roles.carrier]"

    def make(carriers: int = 1) -> Roster:
        return Roster(["picker_0", *(f"carrier_{n}" for n in range(carriers))])

    fits = Contract.parse(text.format("picker"))
    assert declared_contract(fits, open_env(make, carriers=0)) == fits
    with pytest.raises(ContractError, match="'dave' matches no agent"):
        declared_contract(Contract.parse(text.format("dave")), open_env(make, carriers=0))


def test_rollout_and_audit_refuse_what_does_not_fit() -> None:
    """No run is recorded, and nothing is judged, under a contract of another environment."""
    contract = Contract.parse("[roles.dave]")
    with pytest.raises(ContractError, match="dave"):
        gk.rollout("two_robot_line", episodes=1, contract=contract)
    with pytest.raises(ContractError, match="dave"):
        gk.audit("two_robot_line", budget=100, contract=contract)
