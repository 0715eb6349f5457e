import ast
import itertools
import tomllib

import pytest

from gamekeeper.contract import Contract
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import ContractError
from gamekeeper.scaffold.interview import Answers, plan_of
from gamekeeper.scaffold.package_files import contract_of, files_of
from gamekeeper.scaffold.task_plan import Form, advise, read_form, read_stages

TOGETHER, STAGED = (("picker", "carrier"),), (("picker",), ("carrier",))


@pytest.mark.parametrize(
    ("stages", "order", "observe", "conflicts", "api", "why"),
    [
        (TOGETHER, "none", "after tick", "joint rule", "parallel", "by one joint rule"),
        (TOGETHER, "none", "after tick", "random", "parallel", "at random"),
        (STAGED, "none", "after tick", "joint rule", "parallel", "group after group"),
        (TOGETHER, "fixed", "after tick", "joint rule", "parallel", "a fixed order inside it"),
        (STAGED, "fixed", "after turn", "joint rule", "aec", "must observe the actions of picker"),
        (TOGETHER, "rotating", "after turn", "joint rule", "aec", "a rotating order"),
        (TOGETHER, "none", "after turn", "joint rule", "aec", "before it acts"),
        (TOGETHER, "state", "after tick", "joint rule", "aec", "depends on the state"),
        (TOGETHER, "fixed", "after tick", "ordered", "aec", "the earlier one counts"),
    ],
)
def test_advice_follows_from_the_answers(stages, order, observe, conflicts, api, why):
    """AEC where somebody depends on what others did in the same round, else Parallel."""
    advice = advise(stages, order=order, observe=observe, conflicts=conflicts)
    assert advice.api == api
    assert why in advice.why


def test_advice_gives_every_reason():
    """All that speaks for AEC is said."""
    advice = advise(STAGED, order="state", observe="after turn", conflicts="ordered")
    assert len(advice.reasons) == 3
    assert all(reason in advice.why for reason in advice.reasons)


@pytest.mark.parametrize("text", ["discrete:5", "box:3x3", "box:7", "multidiscrete:3,2"])
def test_form_says_what_it_read(text):
    """A space is written as it was typed."""
    assert text == str(read_form(text, "--acts"))


def test_noop_has_the_shape_of_its_space():
    """Zeros in the space's own shape."""
    assert Form("discrete", (4,)).noop == 0
    assert Form("box", (2, 3)).noop == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert Form("multidiscrete", (4, 5, 6)).noop == (0, 0, 0)
    assert Form("multibinary", (2,)).noop == (0, 0)


def test_stages_are_read():
    """+ joins, a comma stands before who acts after."""
    assert read_stages("a+b , c") == (("a", "b"), ("c",))


def test_contract_of_a_new_task_leaves_nothing_open():
    """Every question of a contract is answered, and it survives its TOML."""
    for stages, sees in (("a+b", "no"), ("b,a", "yes")):
        plan, _ = plan_of(Answers(name="x", agents=["a=2", "b"], stages=stages, sees=sees))
        contract = contract_of(plan)
        assert open_questions(contract, ()) == ()
        assert Contract.parse(contract.to_toml()) == contract
        assert contract.schedule.stages == plan.stages


def test_contract_refuses_what_contradicts_itself():
    """A Parallel environment can't show turns."""
    plan, _ = plan_of(Answers(name="x", sees="yes", api="parallel"))
    with pytest.raises(ContractError, match="before its tick is over"):
        files_of(plan)


MUCH = {
    "reward": ["one=individual", "two=shared:b:a", "three=zero-sum:a:a"],
    "ending": ["over=truncation:agent", "done=termination:b", "out=truncation"],
}
LITTLE = {"reward": ["one=shared"], "ending": ["alone=truncation:a"]}
GRID = [
    {"agents": ["a=2", "b"], "stages": stages, "api": api, "order": order, "observes": seen} | rest
    for stages, (api, order), seen, rest in itertools.product(
        ["a+b", "b,a"],
        [
            ("parallel", "none"),
            *(("aec", each) for each in ("fixed", "rotating", "state", "random")),
        ],
        [["discrete:5"], ["a=multidiscrete:3,2", "b=box:3x3"], ["a=multibinary:4", "b=discrete:2"]],
        [MUCH, LITTLE],
    )
]


@pytest.mark.parametrize("answers", GRID, ids=map(str, range(len(GRID))))
def test_files_are_whole_and_number_their_rules(answers):
    """For all answers: programs parse, no tag is left, and each rule has one test of its number."""
    plan, _ = plan_of(Answers(name="x", **answers))
    files = files_of(plan)
    programs = {path: ast.parse(text) for path, text in files.items() if path.endswith(".py")}
    assert all(tomllib.loads(text) for path, text in files.items() if path.endswith(".toml"))
    assert not any(tag in text for text in files.values() for tag in ("{%", "%}", "{#", "\n\n\n\n"))
    tests = [
        node.name
        for node in programs["tests/test_rules.py"].body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ]
    numbers = [int(name.split("_")[1][1:]) for name in tests]
    assert numbers == list(range(1, len(numbers) + 1))
    assert f"R{numbers[-1]}. After" in files["src/x/env.py"]
    assert f"\n{numbers[-1]}. After" in files["README.md"]
