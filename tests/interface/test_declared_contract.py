"""A declared contract fits the environment that it is for."""

import pytest
from gymnasium.spaces import Discrete

import gamekeeper as gk
from gamekeeper.contract import Contract, Schedule
from gamekeeper.errors import ContractError
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.tick_env import TickEnv
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
        'name = "roster-v0"\napi = "parallel"',
        '[schedule]\norder = "random"\nstages = [["picker"], ["carrier"]]',
        "",
    ],
)
def test_contract_of_a_larger_roster_fits(text: str) -> None:
    """A role fits if one of its patterns matches; a contract may leave out its roles."""
    contract = Contract.parse(text)
    assert declared_contract(contract, open_env(Roster(AGENTS))) == contract


@pytest.mark.parametrize(
    ("text", "where", "fix"),
    [
        ("[roles.picker]\n", "line 1, roles", '[roles.carrier] with agents = "carrier_*"'),
        ('[schedule]\nstages = [["picker"]]', "roles", "widen a pattern"),
        ('\nname = "farm_v0"', "line 2, name", "contract of 'roster_v0'"),
        ('\n\napi = "aec"', "line 3, api", 'write api = "parallel"'),
        (
            "[roles.picker]\nsymmetric = true\n[roles.carrier]",
            "line 2, roles.picker.symmetric",
            "symmetric = false",
        ),
        (
            '[roles.picker]\n[roles.carrier]\n[rewards.x]\nkind = "zero-sum"\npayee = "carrier"',
            "line 5, rewards.x.payee",
            "other payees",
        ),
    ],
)
def test_declaration_that_contradicts_the_environment_is_refused(
    text: str, where: str, fix: str
) -> None:
    """Agents in no role, another name or API, unlike agents, a zero sum of one agent."""
    error = refused(text, Roster(AGENTS, acts={"picker_1": Discrete(9)}))
    assert error.where == f"c.toml, {where}"
    assert fix in error.fix


def test_order_of_one_agent_is_refused() -> None:
    """A changing order takes two agents in one stage."""
    text = '[schedule]\nstages = [["a"], ["b"]]\norder = "rotating"'
    error = refused(text, Roster(["a_0", "b_0"]))
    assert error.where == "c.toml, line 3, schedule.order"
    assert error.fix == 'write order = "fixed"'


@pytest.mark.parametrize(
    ("spec", "api", "fits"),
    [
        ("two_robot_line", "parallel", True),
        ("aec:two_robot_line", "parallel", True),
        ("two_robot_line", "aec", False),
        ("aec:two_robot_line", "aec", True),
        ("tictactoe", "aec", True),
        ("tictactoe", "parallel", False),
        ("mpe2.simple_v3:parallel_env", "parallel", True),
        ("mpe2.simple_v3:parallel_env", "aec", True),
        ("mpe2.simple_v3:env", "parallel", True),
    ],
)
def test_api_is_the_environments_own_or_the_one_it_is_used_with(
    spec: str, api: str, fits: bool
) -> None:
    """A converted environment keeps its contract; one of the other API doesn't take it."""
    contract, opened = Contract(api=api), open_env(spec)
    if fits:
        assert declared_contract(contract, opened) == contract
    else:
        with pytest.raises(ContractError, match="declares api"):
            declared_contract(contract, opened)


class Limited(TickEnv):
    """Two agents that do nothing, for 20 ticks unless told otherwise."""

    metadata = {"name": "limited_v0"}  # noqa: RUF012 (PettingZoo's way)
    contract = Contract(schedule=Schedule(horizon=20))

    def __init__(self, horizon: int | None = None) -> None:
        super().__init__(horizon=horizon)
        self.possible_agents = ["a_0", "a_1"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, Discrete(2))
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(2))

    def start(self, rng: object, options: object) -> None:
        """Nothing begins."""

    def tick(self, actions: object) -> None:
        """Nothing happens."""

    def observe(self, agent: str) -> int:
        """Nothing."""
        return 0


def test_horizon_that_the_environment_does_not_keep_is_refused() -> None:
    """A contract handed over has the horizon that the class keeps; an argument excuses another."""
    error = refused("[schedule]\nhorizon = 60", Limited)
    assert error.where == "c.toml, line 2, schedule.horizon"
    assert "horizon = 20" in error.fix
    for text, kwargs in (("20", {}), ("60", {"horizon": 60}), ("60", {"horizon": 5})):
        contract = Contract.parse(f"[schedule]\nhorizon = {text}")
        assert declared_contract(contract, open_env(Limited, **kwargs)) == contract
    assert declared_contract(None, open_env(lambda: Limited(horizon=5))) == Limited.contract


def test_everything_that_contradicts_the_environment_is_told_at_once() -> None:
    """One error lists them all, in the order of their lines."""
    text = (
        'name = "farm_v0"\napi = "aec"\n[roles.drone]\nagents = "drone_*"\n[roles.picker]\n'
        "noop = 9\n"
    )
    keys = [place.split(", ")[-1] for place in refused(text).where.split("; ")]
    assert keys == ["name", "api", "roles.drone.agents", "roles.picker.noop"]


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
