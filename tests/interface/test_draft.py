import tomllib

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from pettingzoo import AECEnv, ParallelEnv

import gamekeeper as gk
from gamekeeper.contract import Contract, Ending, Role, Schedule
from gamekeeper.errors import ContractError
from gamekeeper.interface.contract_draft import (
    agent_specs,
    draft_contract,
    draft_questions,
    open_questions,
)
from gamekeeper.interface.declared_contract import declared_contract
from gamekeeper.interface.opening import open_env
from gamekeeper.interface.tick_env import TickEnv
from gamekeeper.interface.turn_env import TurnEnv

SEEN = spaces.Box(0, 1, (2,), np.float32)
MASKED = spaces.Dict(observation=SEEN, action_mask=spaces.MultiBinary(3))


class Roster(ParallelEnv):
    """Agents with spaces, which fail the test when they are reset or stepped."""

    def __init__(self, agents, *, seen=None, acts=None, metadata=None):
        self.possible_agents = agents
        self.metadata = {"name": "roster_v0"} if metadata is None else metadata
        self.seen, self.acts = seen or {}, acts or {}

    def observation_space(self, agent):
        return self.seen.get(agent, SEEN)

    def action_space(self, agent):
        return self.acts.get(agent, spaces.Discrete(3))

    def reset(self, seed=None, options=None):
        pytest.fail("a draft resets nothing")

    def step(self, actions):
        pytest.fail("a draft steps nothing")


class Turns(Roster, AECEnv):
    """The same, one agent after the other."""


class OnlyTurns(AECEnv):
    metadata = {"name": "turns_v0", "is_parallelizable": False}  # noqa: RUF012 (PettingZoo's way)
    possible_agents = ("a",)

    def observation_space(self, agent):
        raise RuntimeError("not before reset")

    def action_space(self, agent):
        raise KeyError(agent)


def roles(agents, **options):
    """The drafted roles, as the patterns of their agents."""
    drafted = draft_contract(Roster(agents, **options)).roles
    return {name: role.agents for name, role in drafted.items()}


def test_draft_declares_only_what_is_seen():
    """Name, API and roles are seen; everything else stays open."""
    drafted = draft_contract(Roster(["picker_0", "picker_1", "carrier_0"]))
    expected = Contract(
        name="roster_v0",
        api="parallel",
        roles={"picker": Role(agents="picker_*"), "carrier": Role(agents="carrier_*")},
    )
    assert drafted == expected


@pytest.mark.parametrize(
    ("agents", "expected"),
    [
        (["picker", "carrier"], {"picker": ("picker",), "carrier": ("carrier",)}),
        (["a_0", "a_0b"], {"a": ("a_0",), "a_0b": ("a_0b",)}),
        (["a_0", "a_1", "a_1x"], {"a": ("a_0", "a_1"), "a_1x": ("a_1x",)}),
        (["a_0", "a_xy"], {"a": ("a_[0-9]*",), "a_xy": ("a_xy",)}),
        (["a_0", "a_x"], {"a": ("a_*",)}),
        (["wolf_a", "wolf_b", "sheep_x"], {"wolf": ("wolf_*",), "sheep_x": ("sheep_x",)}),
        (["wolf_a", "wolf_b", "wolf_dog"], {"wolf": ("wolf_[A-Za-z]",), "wolf_dog": ("wolf_dog",)}),
        (["wolfA", "wolfB", "dog"], {"wolf": ("wolf[A-Z]",), "dog": ("dog",)}),
        (["adversary_0", "adversary_1"], {"adversary": ("adversary_*",)}),
        (["red_1_0", "red_1_1"], {"red_1": ("red_1_*",)}),
        (["robot0", "robot1"], {"robot": ("robot[0-9]*",)}),
        (["0", "1"], {"agent": ("[0-9]*",)}),
        ([0, 1], {"agent": ("[0-9]*",)}),
        (["all", "team_1"], {"alls": ("all",), "teams": ("team_*",)}),
        (["x[1]_0", "x*"], {"x[1]": ("x[[]1]_*",), "x*": ("x[*]",)}),
        ([], {}),
    ],
)
def test_draft_names_roles_after_their_agents(agents, expected):
    """Agents numbered alike are a role, whose patterns cover nobody else."""
    assert roles(agents) == expected


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("mpe2.simple_tag_v3:parallel_env", {"adversary": ("adversary_*",), "agent": ("agent_*",)}),
        ("pettingzoo.classic.tictactoe_v3:env", {"player": ("player_*",)}),
        ("warehouse", {"picker": ("picker_*",), "carrier": ("carrier_*",)}),
    ],
)
def test_draft_of_known_environments_has_a_role_for_each_kind(spec, expected):
    """Agents of one kind are one role with one pattern, also where another kind has one agent."""
    pytest.importorskip(spec.partition(".")[0] if "." in spec else "gamekeeper")
    drafted = draft_contract(open_env(spec).env).roles
    assert {name: role.agents for name, role in drafted.items()} == expected


def test_draft_parts_agents_whose_spaces_differ():
    """Equal names with unequal spaces are no role: each group is called by its first agent."""
    found = roles(["agent_0", "agent_1", "agent_2"], acts={"agent_1": spaces.Discrete(9)})
    assert found == {"agent_0": ("agent_0", "agent_2"), "agent_1": ("agent_1",)}


def test_draft_holds_every_agent_in_one_role():
    """Each agent of the roster is in the role that was drafted for it."""
    agents = ["a", "a_0", "a_1", "a_b_0", "b0", "b1", "b_1", "7", "8", "a-1", "ü_1", "agent"]
    drafted = draft_contract(Roster(agents))
    held = [drafted.role_of(agent) for agent in agents]
    assert None not in held
    assert set(held) == set(drafted.roles)


@given(st.lists(st.text("ab_-01*[é", max_size=5), unique=True, max_size=8), st.data())
def test_draft_of_any_roster_is_a_contract(agents, data):
    """Whatever agents are called, each that has a name is in exactly the role it was put in."""
    sizes = {agent: data.draw(st.sampled_from([2, 3])) for agent in agents}
    env = Roster(agents, acts={agent: spaces.Discrete(n) for agent, n in sizes.items()})
    drafted = draft_contract(env)
    held = {agent: drafted.role_of(agent) for agent in agents if agent}
    assert None not in held.values()
    for one in held:
        for other in held:
            assert held[one] != held[other] or sizes[one] == sizes[other]
    assert Contract.parse(drafted.to_toml(draft_questions(env, drafted))) == drafted


def test_draft_sees_masks_that_stand_in_observations():
    """A Dict observation with PettingZoo's key has its mask there; elsewhere it stays open."""
    drafted = draft_contract(Roster(["a_0", "b_0"], seen={"a_0": MASKED}))
    assert drafted.mask_of("a_0") == "observation.action_mask"
    assert not drafted.declared("roles", "b", "mask")


def test_draft_tells_the_api_apart():
    """An environment that plays in turns is drafted as such."""
    assert draft_contract(OnlyTurns()).api == "aec"
    assert draft_contract(Roster([])).api == "parallel"


def test_draft_survives_an_environment_that_does_not_tell():
    """Spaces, names or rosters that can't be had before reset stay open."""
    env = OnlyTurns()
    drafted = draft_contract(env)
    assert drafted.roles == {"a": Role(agents=("a",))}
    (spec,) = agent_specs(env, drafted)
    assert spec.observation_space is None
    nameless = Roster(["a"], metadata={"name": 7})
    del nameless.possible_agents
    assert draft_contract(nameless) == Contract(api="parallel")
    assert draft_contract(Roster(["a"], metadata=0)).name is None


def test_draft_of_what_is_no_environment_says_what_it_is():
    """Anything else is refused by its type."""
    with pytest.raises(ContractError, match="PettingZoo") as caught:
        draft_contract(object())
    assert caught.value.actual == "builtins.object"


def test_draft_asks_for_the_noop_by_name_where_it_goes():
    """The TOML of a draft holds the questions and reads back equal to the draft."""
    env = Roster(["picker_0", "picker_1"])
    drafted = draft_contract(env)
    text = drafted.to_toml(draft_questions(env, drafted))
    lines = text.splitlines()
    at = lines.index("# noop = 0                        # N")
    assert lines[at - 1].startswith("## which action of role 'picker' does nothing? (N in 0 to 2")
    assert "[roles.picker]" in lines[:at]
    assert Contract.parse(text) == drafted


def test_draft_becomes_a_contract_by_answering_its_questions():
    """Uncommented and filled in, the questions' lines are declarations."""
    env = Roster(["picker_0", "picker_1"])
    text = draft_contract(env).to_toml(draft_questions(env, draft_contract(env)))
    answered = text.replace("# noop = 0", "noop = 1").replace(
        "# may_join = true", "may_join = false"
    )
    contract = Contract.parse(answered)
    assert contract.noop_of("picker_1") == 1
    left = {question.key for question in open_questions(contract)}
    assert not left & {"roles.picker.noop", "roles.picker.may_join"}


@pytest.mark.parametrize(
    "spec",
    [
        "handover",
        "mpe2.simple_world_comm_v3:parallel_env",
        OnlyTurns(),
        Roster(["a_0", "a_1"], acts={"a_0": spaces.Dict(go=SEEN, say=spaces.MultiBinary(2))}),
        Roster(["a"], acts={"a": spaces.Tuple([spaces.MultiDiscrete([3, 2], start=[1, 0])])}),
        Roster(["a"], acts={"a": spaces.Box(1, 2, (3,), np.float32)}, metadata={}),
        Roster(["a"], acts={"a": spaces.Graph(SEEN, None)}),
        Roster([]),
    ],
    ids=lambda spec: spec if isinstance(spec, str) else type(spec).__name__,
)
def test_draft_is_toml_whichever_line_is_uncommented(spec):
    """Each line that loses one sign, and all of them together: tomllib reads it."""
    env = open_env(spec).env
    drafted = draft_contract(env)
    lines = drafted.to_toml(draft_questions(env, drafted)).splitlines()
    marked = [place for place, line in enumerate(lines) if line.startswith("#")]
    assert len(marked) > 10
    for places in [[place] for place in marked] + [marked]:
        text = "\n".join(
            line[1:].removeprefix(" ") if place in places else line
            for place, line in enumerate(lines)
        )
        tomllib.loads(text)


@pytest.mark.parametrize(
    ("space", "noop"),
    [
        (spaces.Discrete(5, start=2), 2),
        (spaces.MultiDiscrete([3, 2]), (0, 0)),
        (spaces.Box(-1, 1, (2, 2), np.float32), ((0.0, 0.0), (0.0, 0.0))),
        (spaces.Dict(go=spaces.Discrete(3)), {"go": 0}),
        (spaces.Box(1, 2, (2,), np.float32), "none"),
        (spaces.Box(-1, 1, (100,), np.float32), "none"),
        (spaces.Text(3), "none"),
    ],
)
def test_draft_shows_a_noop_that_the_space_has(space, noop):
    """The example of a noop is an action of the space where one is short enough to be read."""
    env = Roster(["a"], acts={"a": space})
    text = draft_contract(env).to_toml(draft_questions(env, draft_contract(env)))
    contract = Contract.parse(text.replace("# noop = ", "noop = "))
    assert contract.roles["a"].noop == noop
    agent_specs(env, contract)


def test_draft_asks_why_with_what_the_environment_says():
    """What an AEC environment says of being parallelizable stands beside the question."""
    env = OnlyTurns()
    why = draft_questions(env, draft_contract(env))[0]
    assert why.key == "why"
    assert why.hint == "it calls itself not parallelizable"


def test_agent_specs_check_a_contract_against_the_environment():
    """A noop that no agent has is found without a step."""
    contract = Contract.parse("[roles.picker]\nnoop = 3", source="a.toml")
    with pytest.raises(ContractError, match="picker_0"):
        agent_specs(Roster(["picker_0"]), contract)


@pytest.mark.parametrize("name", ["foraging", "handover"])
def test_draft_of_a_kernel_declares_its_terms_endings_and_horizon(name):
    """They are named as its contract names them, and only their kinds and owners are asked for."""
    env = gk.make(name)
    declared, drafted = declared_contract(None, open_env(name)), draft_contract(env)
    asked = {question.key for question in draft_questions(env, drafted)}
    assert set(drafted.rewards) == set(declared.rewards)
    assert set(drafted.endings) == set(declared.endings)
    assert drafted.schedule.horizon == env.unwrapped.horizon
    assert drafted.endings["horizon"] == Ending(kind="truncation", owner="all")
    assert not asked & {"schedule.horizon", "rewards.TERM", "endings.REASON", "endings.horizon"}
    assert {f"rewards.{term}.kind" for term in declared.rewards} <= asked
    assert Contract.parse(drafted.to_toml(draft_questions(env, drafted))) == drafted


@pytest.mark.parametrize(
    ("given", "contract", "ticks"),
    [(7, None, 7), (None, Contract(schedule=Schedule(horizon=9)), 9), (None, None, None)],
)
@pytest.mark.parametrize("base", [TickEnv, TurnEnv])
def test_draft_of_written_rules_declares_their_horizon(base, given, contract, ticks):
    """The one handed over, else the one of the contract that the class names; else it is asked."""
    env = type("Rules", (base,), {"contract": contract, "observe": lambda self, agent: 0})(
        horizon=given
    )
    env.possible_agents, env.metadata = [], {"name": "rules_v0", "render_modes": []}
    drafted = draft_contract(env)
    asked = {question.key for question in draft_questions(env, drafted)}
    assert drafted.schedule.horizon == ticks
    assert ("schedule.horizon" in asked) == (ticks is None)
