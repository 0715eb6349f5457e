import ast
import itertools
import tomllib

import pytest

from gamekeeper.contract import Contract
from gamekeeper.episodes.contract_questions import open_questions
from gamekeeper.errors import SpecError
from gamekeeper.scaffold.interview import Answers, plan_of
from gamekeeper.scaffold.package_files import contract_of, files_of
from gamekeeper.scaffold.task_plan import Form, read_form, read_stages
from gamekeeper.scaffold.timing import Timing, advise

TOGETHER, STAGED = (("picker", "carrier"),), (("picker",), ("carrier",))


def timing(stages, order, observe, conflicts):
    """The answers about time of a task with two agents in each role."""
    sizes = [2 * len(stage) for stage in stages]
    return Timing(stages=stages, sizes=sizes, order=order, observe=observe, conflicts=conflicts)


@pytest.mark.parametrize(
    ("stages", "order", "observe", "conflicts", "api", "why"),
    [
        (TOGETHER, "none", "after tick", "joint rule", "parallel", "by one joint rule"),
        (TOGETHER, "none", "after tick", "random", "parallel", "at random"),
        (STAGED, "none", "after tick", "joint rule", "parallel", "group after group"),
        (STAGED, "fixed", "after turn", "joint rule", "aec", "must observe the actions of picker"),
        (TOGETHER, "rotating", "after turn", "joint rule", "aec", "a rotating order"),
        (TOGETHER, "state", "after tick", "joint rule", "aec", "depends on the state"),
        (TOGETHER, "fixed", "after tick", "ordered", "aec", "fixed order that exclude each other"),
    ],
)
def test_advice_follows_from_the_answers(stages, order, observe, conflicts, api, why):
    """AEC where somebody depends on what others did in the same round, else Parallel."""
    advice = advise(timing(stages, order, observe, conflicts))
    assert advice.api == api
    assert why in advice.why


def test_advice_gives_every_reason():
    """All that speaks for AEC is said."""
    advice = advise(timing(STAGED, "state", "after turn", "ordered"))
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


CONTRADICTIONS = [
    ({"sees": "yes", "api": "parallel"}, "before its tick is over", "--api aec"),
    ({"sees": "yes", "order": "none"}, "can't observe each other", "--order fixed"),
    ({"sees": "yes", "agents": ["a"]}, "one agent has no others", "--sees no"),
    *(
        ({"sees": sees, "order": order} | rest, "has no effect", "--conflicts ordered")
        for order in ("fixed", "rotating", "random")
        for sees in (None, "no")
        for rest in ({}, {"conflicts": "joint rule"}, {"conflicts": "priority"}, {"api": "aec"})
    ),
    ({"conflicts": "ordered"}, "the first can't win", "--order fixed"),
    ({"order": "none", "conflicts": "ordered", "api": "aec"}, "can't win", "--order fixed"),
    ({"agents": ["a"], "order": "state"}, "one agent", "--order fixed"),
    (
        {"agents": ["a", "b"], "stages": "a,b", "order": "rotating", "sees": "yes"},
        "each group has one agent",
        "with a +",
    ),
    ({"order": "state", "api": "parallel"}, "isn't one of turns", "--api aec"),
    ({"order": "random", "conflicts": "ordered", "api": "parallel"}, "all actions", "--api aec"),
]


@pytest.mark.parametrize(("answers", "what", "fix"), CONTRADICTIONS)
def test_answers_that_contradict_each_other_are_refused(answers, what, fix):
    """With the reason, the options that say so, and answers that are true together."""
    with pytest.raises(SpecError) as caught:
        plan_of(Answers(name="x", **answers))
    assert what in caught.value.what
    assert fix in caught.value.fix
    assert "--" in caught.value.where


TIMES = [
    {"sees": sees, "order": order, "conflicts": conflicts, "api": api, "stages": stages}
    for sees in ("no", "yes")
    for order in ("none", "fixed", "rotating", "state", "random")
    for conflicts in ("joint rule", "priority", "random", "ordered")
    for api in (None, "aec", "parallel")
    for stages in ("a+b", "b,a")
]


def test_answers_are_refused_or_declared_as_they_were_given():
    """No answer is replaced in silence: a contract has what was answered, or there is none."""
    accepted = 0
    for answers in TIMES:
        try:
            plan, advice = plan_of(Answers(name="x", agents=["a=2", "b=2"], **answers))
        except SpecError:
            continue
        accepted += 1
        schedule = contract_of(plan).schedule
        seen = "after turn" if answers["sees"] == "yes" else "after tick"
        assert (schedule.order, schedule.observe) == (answers["order"], seen)
        assert schedule.conflicts == answers["conflicts"]
        assert plan.api == (answers["api"] or advice.api)
    assert 50 < accepted < len(TIMES)


def test_user_is_asked_again_where_an_answer_contradicts_another():
    """The question comes again, and nothing that was answered before is lost."""
    given = iter(["robot=2", "yes", "none", "fixed"])
    refused = []

    def ask(question, answer, read):
        while True:
            try:
                return read(next(given, answer))
            except SpecError as error:
                refused.append(error.what)

    plan, _ = plan_of(Answers(name="x"), ask)
    assert (plan.order, plan.observe) == ("fixed", "after turn")
    assert len(refused) == 1


MUCH = {
    "reward": ["one=individual", "two=shared:b:a", "three=zero-sum:a:a"],
    "ending": ["over=truncation:agent", "done=termination:b", "out=truncation"],
}
LITTLE = {"reward": ["one=shared"], "ending": ["alone=truncation:a"]}
GRID = [
    {"agents": ["a=2", "b"], "stages": stages, "observes": seen} | time | rest
    for stages, time, seen, rest in itertools.product(
        ["a+b", "b,a"],
        [
            {"conflicts": "priority"},
            {"api": "aec", "conflicts": "random"},
            {"sees": "yes", "order": "fixed"},
            {"order": "rotating", "conflicts": "ordered"},
            {"order": "state"},
            {"sees": "yes", "order": "random", "conflicts": "ordered"},
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
