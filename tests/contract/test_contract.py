import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract import (
    Contract,
    Ending,
    Failure,
    InfoField,
    Knob,
    Question,
    RewardTerm,
    Role,
    Schedule,
    Seeds,
)
from gamekeeper.contract.reader import DTYPES
from gamekeeper.contract.sections import (
    AFTER_END,
    CONFLICTS,
    ENDING_KINDS,
    ILLEGAL,
    KINDS,
    ORDERS,
    RESERVED,
)
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import ContractError

WAREHOUSE = """\
name = "warehouse_v0"
api = "parallel"
why = "all robots move once a tick; the tick resolves their joint action"

[schedule]
stages = [["picker", "carrier"]]        # roles that act together
order = "none"
observe = "after tick"
conflicts = "joint rule"
horizon = 200

[roles.picker]
agents = "picker_*"
symmetric = true
may_join = true
may_leave = true
noop = 4
mask = "infos.action_mask"
messages = []

[rewards.delivery]
kind = "shared"
earner = "carrier"
payee = "all"

[endings]
battery = { kind = "truncation", owner = "agent" }
cleared = { kind = "termination", owner = "all" }

[seeds]
deterministic = true
[infos]
position = { dtype = "int64", shape = [2] }
wall_s = { volatile = true }
[knobs]
sensor_noise = { label = "perception", ideal = 0.0 }
[failure]
team = "deliveries < 3"
[waivers]
GK503 = "battery death is announced one tick late on purpose"
"""

# Strategies: plain data of contracts that don't contradict themselves.
words = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=8).filter(
    lambda text: bool(text.strip())
)
numbers = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
plain_values = st.recursive(
    st.booleans() | numbers | st.text(st.characters(exclude_categories=["Cs"]), max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)


def some(**optional):
    """Tables with any of the keys."""
    return st.fixed_dictionaries({}, optional=optional)


@st.composite
def contracts(draw):
    """Plain data of a contract, each declaration there or not."""
    names = draw(st.lists(words.filter(lambda name: name not in RESERVED), max_size=3, unique=True))
    roles = {}
    for number, name in enumerate(names):
        roles[name] = draw(
            some(
                symmetric=st.booleans(),
                may_join=st.booleans(),
                may_leave=st.booleans(),
                noop=plain_values,
                mask=st.sampled_from(["infos.action_mask", "observation.action_mask", "none"]),
                messages=st.lists(words, max_size=2, unique=True),
                illegal=st.sampled_from(ILLEGAL),
            )
        )
        if roles[name].get("mask") == "none":
            roles[name].pop("illegal", None)
        roles[name]["agents"] = draw(st.sampled_from([f"{number}_*", [f"{number}a", f"{number}b"]]))
    owners = st.sampled_from(["agent", "all", *names])
    term = st.fixed_dictionaries(
        {"kind": st.sampled_from(KINDS)}, optional={"earner": st.sampled_from([*names, "all"])}
    )
    data = draw(
        some(
            name=words,
            why=words,
            api=st.sampled_from(["aec", "parallel"]),
            rewards=st.dictionaries(words.filter("after_end".__ne__), term, max_size=2),
            endings=st.dictionaries(
                words,
                st.fixed_dictionaries(
                    {"kind": st.sampled_from(ENDING_KINDS)}, optional={"owner": owners}
                ),
                max_size=2,
            ),
            seeds=some(deterministic=st.booleans()),
            infos=st.dictionaries(
                words,
                some(
                    dtype=st.sampled_from(DTYPES),
                    shape=st.lists(st.integers(0, 99), max_size=3),
                    volatile=st.booleans(),
                ),
                max_size=2,
            ),
            knobs=st.dictionaries(
                words,
                st.fixed_dictionaries({"label": words}, optional={"ideal": plain_values}),
                max_size=2,
            ),
            failure=st.dictionaries(
                st.sampled_from(["team", "agent", *names]), st.just("a.b < 3 and not c"), max_size=2
            ),
            waivers=st.dictionaries(st.sampled_from(["GK101", "GK999", "MY1234"]), words),
            schedule=some(
                order=st.sampled_from(ORDERS),
                observe=st.just("after tick"),
                conflicts=st.sampled_from([word for word in CONFLICTS if word != "ordered"]),
                horizon=st.integers(1, 2**63 - 1),
                **({"stages": st.permutations(names).map(lambda order: [order])} if names else {}),
            ),
        )
    )
    if data.get("api") == "parallel" and data.get("schedule", {}).get("order") != "none":
        data["schedule"] = data.get("schedule", {}) | {"conflicts": "priority"}
    if draw(st.booleans()):
        data["rewards"] = {"after_end": draw(st.sampled_from(AFTER_END)), **data.get("rewards", {})}
    return {**data, "roles": roles} if roles else data


def test_contract_reads_every_section():
    """Each section of the documented example becomes its frozen data."""
    contract = Contract.parse(WAREHOUSE)
    assert contract.name == "warehouse_v0"
    assert contract.schedule == Schedule(
        stages=(("picker", "carrier"),),
        order="none",
        observe="after tick",
        conflicts="joint rule",
        horizon=200,
    )
    assert contract.roles["picker"] == Role(
        agents=("picker_*",),
        symmetric=True,
        may_join=True,
        may_leave=True,
        noop=4,
        mask="infos.action_mask",
        messages=(),
    )
    assert contract.rewards == {
        "delivery": RewardTerm(kind="shared", earner=("carrier",), payee=("all",))
    }
    assert contract.endings["battery"] == Ending(kind="truncation", owner="agent")
    assert contract.seeds == Seeds(deterministic=True)
    assert contract.infos["position"] == InfoField(dtype="int64", shape=(2,))
    assert contract.knobs["sensor_noise"] == Knob(label="perception", ideal=0.0)
    assert contract.failure["team"] == Failure("deliveries < 3")
    assert contract.waivers == {"GK503": "battery death is announced one tick late on purpose"}


def test_contract_writes_the_layout_it_is_documented_in():
    """The written TOML is the documented text, but for comments and blank lines."""
    bare = [line.split("   ")[0] for line in WAREHOUSE.splitlines() if line]
    written = [line for line in Contract.parse(WAREHOUSE).to_toml().splitlines() if line]
    assert bare == [line for line in written if line != "[roles.carrier]"]


@given(contracts())
def test_contract_round_trips_through_toml_and_json(data):
    """What is written reads back equal, with every value of the same type."""
    contract = Contract.from_json(data)
    for again in (
        Contract.parse(contract.to_toml()),
        Contract.from_json(contract.to_json()),
        pickle.loads(pickle.dumps(contract)),
        copy.deepcopy(contract),
    ):
        assert again == contract
        assert hash(again) == hash(contract)
        assert repr(again.to_json()) == repr(contract.to_json())
    assert contract.to_toml().encode("utf-8")
    assert Contract.parse(contract.to_toml(open_questions(contract))) == contract


@given(contracts())
def test_contract_keeps_every_declaration(data):
    """Plain data comes back as it went in, apart from tables that say nothing."""
    back = Contract.from_json(data).to_json()
    assert {key: value for key, value in data.items() if value != {}} == back


def test_contract_of_nothing_declares_nothing():
    """An empty text is a valid contract in which nothing can be judged."""
    contract = Contract.parse("")
    assert contract == Contract()
    assert contract.to_json() == {}
    assert contract.to_toml().strip() == ""
    assert contract.schedule.order is None
    assert not contract.declared("schedule", "order")
    assert contract.role_of("picker_0") is None
    assert contract.noop_of("picker_0") is None


def test_contract_tells_declared_from_false_and_empty():
    """False, 0 and an empty list are declarations."""
    contract = Contract.parse("[roles.a]\nmay_join = false\nnoop = 0\nmessages = []")
    for key in ("may_join", "noop", "messages"):
        assert contract.declared("roles", "a", key)
    assert not contract.declared("roles", "a", "may_leave")
    assert not contract.declared("roles", "a", "noop", "deeper")


def test_contract_made_in_python_is_checked_like_a_file():
    """Dictionaries and lists stand for tables and tuples, and wrong ones are refused."""
    made = Contract(
        roles={"a": Role(agents="a_*", noop=[np.int64(1), np.float32(0.5)])},
        schedule=Schedule(stages=[["a"]], horizon=np.int32(5)),
    )
    assert made == Contract.parse(
        '[schedule]\nstages = [["a"]]\nhorizon = 5\n[roles.a]\nagents = "a_*"\nnoop = [1, 0.5]'
    )
    assert type(made.schedule.horizon) is int
    with pytest.raises(ContractError, match=r"schedule.horizon"):
        Contract(schedule=Schedule(horizon=0))
    with pytest.raises(ContractError, match=r"roles"):
        Contract(roles=3)


def test_contract_never_changes_after_it_was_made():
    """Neither its fields nor its tables can be set, nor the dictionary it was made of matter."""
    roles = {"a": Role()}
    contract = Contract(roles=roles)
    roles["b"] = Role()
    assert list(contract.roles) == ["a"]
    with pytest.raises(AttributeError):
        contract.name = "other"
    with pytest.raises(TypeError):
        contract.roles["b"] = Role()


def test_role_of_follows_patterns_and_names():
    """Patterns tell upper from lower case; without them a role holds what is called like it."""
    contract = Contract.parse('[roles.arm]\nagents = ["left", "right_?"]\n[roles.picker]\n')
    expected = {
        "left": "arm",
        "right_1": "arm",
        "right_12": None,
        "Left": None,
        "picker": "picker",
        "picker_3": "picker",
        "picker_x": None,
        "pickers": None,
        7: None,
    }
    assert {agent: contract.role_of(agent) for agent in expected} == expected


def test_noop_and_mask_of_an_agent_are_its_roles():
    """An agent gets its role's noop and mask; 'none' is none, though it is declared."""
    contract = Contract.parse(
        '[roles.a]\nnoop = [0, 1]\nmask = "infos.m"\n[roles.b]\nnoop = "none"'
    )
    assert contract.noop_of("a_0") == (0, 1)
    assert contract.mask_of("a_0") == "infos.m"
    assert contract.noop_of("b_0") is None
    assert contract.declared("roles", "b", "noop")
    assert contract.mask_of("c") is None


def test_volatile_infos_are_those_declared_so():
    """Only fields that say volatile = true are left out of fingerprints."""
    text = "[infos]\na = { volatile = true }\nb = { volatile = false }\nc = {}"
    assert Contract.parse(text).volatile_infos() == {"a"}


def test_role_in_a_stage_needs_no_section():
    """Standing in a stage declares a role, of which nothing else is declared."""
    contract = Contract.parse(WAREHOUSE)
    assert contract.roles["carrier"] == Role()
    assert contract.role_of("carrier_1") == "carrier"


def test_zero_sum_between_agents_of_one_role_is_allowed():
    """Players of one role can play a zero-sum game against each other."""
    text = '[roles.a]\nagents = "a_*"\n[rewards.t]\nkind = "zero-sum"\nearner = "a"\npayee = "a"'
    assert Contract.parse(text).rewards["t"].payee == ("a",)


def test_questions_stand_where_their_answers_go():
    """A question is a comment in its section, and the text still reads back equal."""
    contract = Contract.parse("[roles.a]\nmay_join = true\nmask = 'none'\n[seeds]")
    questions = (
        Question(("why",), "why so?", '"…"'),
        Question(("roles", "a", "noop"), "which action does nothing?", "N", example="0"),
        Question(("rewards", "TERM"), "which terms?", "…", lines=("[rewards.TERM]", 'kind = "…"')),
        Question(("seeds", "deterministic"), "the same?", "X", hint="often", measured="true"),
    )
    text = contract.to_toml(questions)
    assert text.splitlines() == [
        "## why so?",
        '# why = "…"',
        "",
        "[roles.a]",
        "may_join = true",
        "## which action does nothing?",
        "# noop = 0                        # N",
        'mask = "none"',
        "",
        "[rewards]",
        "## which terms?",
        "# [rewards.TERM]",
        '# kind = "…"',
        "",
        "[seeds]",
        "## the same? (often)",
        "# deterministic = true            # measured; else X",
    ]
    assert Contract.parse(text) == contract


def test_contract_says_where_it_declares_a_key():
    """A check that reads a declaration later can name its line."""
    contract = Contract.parse(WAREHOUSE, source="warehouse.toml")
    assert contract.at("roles", "picker", "noop") == "warehouse.toml, line 17, roles.picker.noop"
    assert contract == Contract.parse("\n\n" + WAREHOUSE, source="elsewhere")


def test_contract_loads_without_numpy():
    """Reading a contract costs none of the heavy imports."""
    code = "import sys, gamekeeper.contract; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
