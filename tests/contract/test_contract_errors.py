"""Mistakes in contracts: each is found where it stands, with what would have been right."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract import Contract
from gamekeeper.errors import ContractError
from tests.contract.test_contract import WAREHOUSE


def seen_error(text, **options):
    """The error that a text meets."""
    with pytest.raises(ContractError) as caught:
        Contract.parse(text, **options)
    return caught.value


def changed(old, new):
    """The warehouse's contract with one piece of its text replaced."""
    assert old in WAREHOUSE
    return WAREHOUSE.replace(old, new, 1)


WRONG = {
    "unknown key": ("why =", "wy =", 3, "wy", "write 'why'"),
    "unknown section": ("[seeds]", "[seed]", 30, "seed", "write 'seeds'"),
    "unknown inner key": ("shape = [2]", "shap = [2]", 33, "infos.position.shap", "write 'shape'"),
    "unknown word": ('"none"', '"nome"', 7, "schedule.order", "write 'none'"),
    "unknown api": ('"parallel"', '"Parallel"', 2, "api", "write 'parallel'"),
    "wrong type": (
        "symmetric = true",
        "symmetric = 1",
        14,
        "roles.picker.symmetric",
        "true or false",
    ),
    "quoted truth": (
        "may_join = true",
        'may_join = "true"',
        15,
        "roles.picker.may_join",
        "without quotes",
    ),
    "text for a number": (
        "horizon = 200",
        'horizon = "200"',
        10,
        "schedule.horizon",
        "whole number",
    ),
    "truth for a number": (
        "horizon = 200",
        "horizon = true",
        10,
        "schedule.horizon",
        "whole number",
    ),
    "no horizon": ("horizon = 200", "horizon = 0", 10, "schedule.horizon", "from 1 on"),
    "date": ('name = "warehouse_v0"', "name = 2026-01-01", 1, "name", "quotes"),
    "nan": ("noop = 4", "noop = [4, nan]", 17, "roles.picker.noop", "replace nan"),
    "infinite": ("ideal = 0.0", "ideal = inf", 36, "knobs.sensor_noise.ideal", "replace inf"),
    "long number": ("noop = 4", f"noop = {2**70}", 17, "roles.picker.noop", "64 bits"),
    "mask nowhere": (
        "infos.action_mask",
        "info.action_mask",
        18,
        "roles.picker.mask",
        "infos.action_mask",
    ),
    "earner unknown": (
        '"carrier"\np',
        '"carier"\np',
        23,
        "rewards.delivery.earner",
        "write 'carrier'",
    ),
    "payee unknown": (
        'payee = "all"',
        'payee = ["picker", "al"]',
        24,
        "rewards.delivery.payee[1]",
        "al",
    ),
    "owner unknown": (
        'owner = "agent"',
        'owner = "agents"',
        27,
        "endings.battery.owner",
        "write 'agent'",
    ),
    "stage misspelt": (
        '"picker", "carrier"]',
        '"pickr", "carrier"]',
        6,
        "schedule.stages[0][0]",
        "write 'picker'",
    ),
    "stage twice": (
        '"picker", "carrier"]',
        '"picker", "picker"]',
        6,
        "schedule.stages[0][1]",
        "leave the second out",
    ),
    "stage empty": ('["picker", "carrier"]', "[]", 6, "schedule.stages[0]", "fill it"),
    "stage no list": (
        '[["picker", "carrier"]]',
        '["picker", "carrier"]',
        6,
        "schedule.stages[0]",
        "put the items into [ ]",
    ),
    "label missing": (
        'label = "perception", ',
        "",
        36,
        "knobs.sensor_noise",
        "add knobs.sensor_noise.label",
    ),
    "patterns overlap": (
        'agents = "picker_*"',
        'agents = "*_1*"',
        13,
        "roles.picker.agents",
        "narrower",
    ),
    "reserved role": ("[roles.picker]", "[roles.all]", 12, "roles.all", "something else"),
    "waiver id": ("GK503", "gk503", 40, "waivers.gk503", "write GK503"),
    "waiver no id": ("GK503", "battery", 40, "waivers.battery", "audit's report"),
    "waiver no reason": (
        '"battery death is announced one tick late on purpose"',
        '" "',
        40,
        "waivers.GK503",
        "why it is so",
    ),
    "failure": ("deliveries < 3", "deliveries <", 38, "failure.team", "deliveries < 3"),
    "failure of whom": ("team = ", "pikcer = ", 38, "failure.pikcer", "write 'picker'"),
    "observe in vain": ('"after tick"', '"after turn"', 8, "schedule.observe", 'api = "aec"'),
    "order in vain": ('"joint rule"', '"ordered"', 9, "schedule.conflicts", "schedule.order"),
    "turns of simultaneous agents": (
        'api = "parallel"',
        'api = "aec"  # and below: after turn',
        8,
        "schedule.observe",
        "order of turns",
    ),
    "order in a joint tick": (
        'order = "none"',
        'order = "rotating"',
        7,
        "schedule.order",
        'order = "none"',
    ),
    "role in no stage": ("[roles.picker]", "[roles.dog]\n[roles.picker]", 12, "roles.dog", "add"),
    "illegal without a mask": (
        'mask = "infos.action_mask"',
        'mask = "none"\nillegal = "end"',
        19,
        "roles.picker.illegal",
        "leave illegal out",
    ),
    "horizon that terminates": (
        "[endings]",
        '[endings]\nhorizon = { kind = "termination", owner = "all" }',
        27,
        "endings.horizon.kind",
        'kind = "truncation"',
    ),
    "horizon of one": (
        "[endings]",
        '[endings]\nhorizon = { kind = "truncation", owner = "agent" }',
        27,
        "endings.horizon.owner",
        'owner = "all"',
    ),
    "after_end": (
        "[rewards.delivery]",
        '[rewards]\nafter_end = "no"\n[rewards.delivery]',
        22,
        "rewards.after_end",
        "listed",
    ),
    "blank": ('"warehouse_v0"', '""', 1, "name", "leave the key out"),
    "table for text": ('"warehouse_v0"', "{ a = 1 }", 1, "name", "quotes"),
    "text for a table": ("{ volatile = true }", '"volatile"', 34, "infos.wall_s", "section"),
}


@pytest.mark.parametrize("case", WRONG)
def test_contract_error_names_line_key_and_fix(case):
    """Each mistake is found where it stands, with what would have been right."""
    old, new, line, key, fix = WRONG[case]
    text = changed(old, new)
    if "after turn" in new:
        text = text.replace('"after tick"', '"after turn"')
    error = seen_error(text, source="warehouse.toml")
    assert error.where == f"warehouse.toml, line {line}, {key}"
    assert fix in error.fix or fix in error.expected
    assert error.expected
    assert error.actual
    assert str(error.what) in str(error)


def test_contract_reports_all_its_mistakes_together():
    """Unknown keys, wrong values and contradictions stand in one error, each with its fix."""
    text = changed("why =", "wy =").replace('"none"', '"nome"').replace("shape", "shap")
    text = text.replace('earner = "carrier"', 'earner = "carier"').replace("noop = 4", "nop = 4")
    error = seen_error(text, source="c.toml")
    assert error.where.split("; ") == [
        "c.toml, line 3, wy",
        "c.toml, line 7, schedule.order",
        "c.toml, line 17, roles.picker.nop",
        "c.toml, line 23, rewards.delivery.earner",
        "c.toml, line 33, infos.position.shap",
    ]
    assert error.what.startswith("the contract has 5 mistakes\n  1. 'wy' is no key")
    for fix in ("'why'", "'none'", "'noop'", "'carrier'", "'shape'"):
        assert f"fix: write {fix}" in error.what
    assert all((error.expected, error.actual, error.fix))


def test_contract_blames_no_name_whose_own_declaration_is_wrong():
    """A role, a knob or a stage that can't be read doesn't make its name unknown elsewhere."""
    text = changed('label = "perception", ', "")
    text = text.replace("[roles.picker]", "[roles]\ncarrier = 3\n[roles.picker]")
    text = text.replace("stages = [[", "stages = [[], [").replace("[knobs]", "[knobs]\nx = {}")
    keys = ["schedule.stages[0]", "roles.carrier", "knobs.x", "knobs.sensor_noise"]
    assert [each.split(", ")[-1] for each in seen_error(text).where.split("; ")] == keys


@pytest.mark.parametrize(
    ("text", "line", "seen"),
    [
        ('a = 1\nname = "x', 2, "name"),
        ("[schedule\norder = 1", 1, "[schedule"),
        ("api parallel", 1, "api parallel"),
        ("[roles.a]\nnoop = 01", 2, "noop"),
        ('name = "a"\n\n\nwhy = \\', 4, "why"),
    ],
)
def test_contract_syntax_error_names_the_line(text, line, seen):
    """What isn't TOML is shown with its line."""
    error = seen_error(text, source="c.toml")
    assert f"c.toml, line {line}" in error.where
    assert seen in error.actual


@pytest.mark.parametrize(
    ("text", "line", "key"),
    [
        ('[waivers]\nGK101 = "a"\nGK101 = "b"', 3, "GK101"),
        ("[roles.a]\nnoop = 1\n[roles.a]\nnoop = 2", 3, "roles.a"),
        ("name = 'a'\nname = 'b'", 2, "name"),
    ],
)
def test_contract_refuses_what_is_declared_twice(text, line, key):
    """A second declaration of a key is named with its line."""
    error = seen_error(text)
    assert f"line {line}" in error.where
    assert f"{key!r} is declared twice" == error.what


@pytest.mark.parametrize(
    "term",
    [
        'kind = "zero-sum"\npayee = "a"',
        'kind = "zero-sum"\npayee = "earner"',
        'kind = "shared"\npayee = "earner"',
        'kind = "individual"\nearner = "a"\npayee = "all"',
        'kind = "shared"\npayee = ["a", "all"]',
    ],
)
def test_reward_terms_that_contradict_themselves_are_refused(term):
    """A zero-sum needs two payees, a shared term all, an individual one its earner."""
    text = f'[roles.a]\nagents = "a"\n[roles.b]\nagents = "b_*"\n[rewards.t]\n{term}'
    assert "rewards.t.payee" in seen_error(text).where


TURNS = 'api = "aec"\n[schedule]\nstages = {}\norder = "{}"\n{}[roles.a]\nagents = "{}"\n'


@pytest.mark.parametrize(
    ("stages", "order", "rest", "agents", "key"),
    [
        ('[["a"]]', "none", 'observe = "after turn"\n', "a_*", "schedule.observe"),
        ('[["a"], ["b"]]', "none", 'observe = "after turn"\n', "a_*", None),
        ('[["a"]]', "rotating", "", "a", "schedule.order"),
        ('[["a"], ["b"]]', "random", "[roles.b]\nagents = 'b'\n", "a", "schedule.order"),
        ('[["a"], ["b"]]', "random", "", "a", None),
        ('[["a", "b"]]', "state", "", "a", None),
        ('[["a"]]', "fixed", "", "a", None),
    ],
)
def test_schedules_that_contradict_themselves_are_refused(stages, order, rest, agents, key):
    """Simultaneous agents show no turns, and one agent has no order; others are as they should."""
    error = complaint(Contract.parse, TURNS.format(stages, order, rest, agents))
    assert key == (None if error is None else error.where.split(", ")[-1])


@pytest.mark.parametrize(("order", "refused"), [("fixed", True), ("rotating", False)])
def test_role_isnt_symmetric_where_its_first_agent_always_wins(order, refused):
    """A fixed order in which the first wins prefers one agent by its name."""
    text = f'[schedule]\norder = "{order}"\nconflicts = "ordered"\n[roles.a]\nsymmetric = true'
    error = complaint(Contract.parse, text)
    assert refused is (error is not None)
    if error is not None:
        assert error.where == "<text>, line 5, roles.a.symmetric"


def test_contract_error_from_plain_data_names_the_key():
    """Without a text there are no lines, but the source and the key path are named."""
    with pytest.raises(ContractError) as caught:
        Contract.from_json({"schedule": {"horizon": -1}})
    assert caught.value.where == "<json>, schedule.horizon"


@pytest.mark.parametrize("data", [None, [], "x", {1: 2}, {"roles": []}, {"name": None}])
def test_contract_refuses_data_of_another_form(data):
    """Anything but a table of the right form is a ContractError, never another error."""
    with pytest.raises(ContractError):
        Contract.from_json(data)


def complaint(read, value):
    """The ContractError that reading the value meets, if any; another error comes through."""
    try:
        read(value)
    except ContractError as error:
        return error
    return None


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)
SECTIONS = ["name", "schedule", "roles", "rewards", "infos", "knobs", "failure", "waivers", "x"]


@given(anything, st.sampled_from(SECTIONS))
def test_contract_meets_any_data_with_its_own_error(data, section):
    """No value makes reading fail in a way that isn't explained."""
    error = complaint(Contract.from_json, {section: data})
    assert error is None or (error.where and error.fix)


@given(st.text() | st.text("[]{}=,.\"'#\n ab1", max_size=60))
def test_contract_meets_any_text_with_its_own_error(text):
    """No text makes parsing fail in a way that isn't explained."""
    error = complaint(Contract.parse, text)
    assert error is None or (error.where and error.fix)


@pytest.mark.parametrize("text", ["a = " + "[" * 5_000, "a = " + "9" * 5_000, "[" * 3_000])
def test_contract_survives_texts_made_to_break_it(text):
    """Deep nesting and endless numbers are refused like any other mistake."""
    assert seen_error(text).fix


def test_contract_bounds_the_nesting_of_a_noop():
    """A value nested beyond measure is refused before it can exhaust the stack."""
    noop = []
    for _ in range(100_000):
        noop = [noop]
    with pytest.raises(ContractError, match="nested"):
        Contract.from_json({"roles": {"a": {"noop": noop}}})
    while noop:
        noop = noop.pop()
