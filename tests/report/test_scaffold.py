import pytest

from gamekeeper.core.contract import Contract
from gamekeeper.core.contract.questions import open_questions
from gamekeeper.errors import ContractError
from gamekeeper.report.scaffold.advice import advise
from gamekeeper.report.scaffold.answers import Answers, plan_of
from gamekeeper.report.scaffold.form import contract_of, noop_of
from gamekeeper.report.scaffold.plan import Form, read_form, read_stages
from gamekeeper.report.scaffold.project import files_of

TOGETHER, STAGED = (("picker", "carrier"),), (("picker",), ("carrier",))


@pytest.mark.parametrize(
    ("stages", "order", "observe", "conflicts", "api", "why"),
    [
        (TOGETHER, "none", "after tick", "joint rule", "parallel", "by one joint rule"),
        (TOGETHER, "none", "after tick", "random", "parallel", "by a draw"),
        (STAGED, "none", "after tick", "joint rule", "parallel", "group after group"),
        (TOGETHER, "fixed", "after tick", "joint rule", "parallel", "a fixed order inside it"),
        (STAGED, "fixed", "after turn", "joint rule", "aec", "carrier must see what picker did"),
        (TOGETHER, "rotating", "after turn", "joint rule", "aec", "an order that rotates"),
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
    assert noop_of(Form("discrete", (4,))) == 0
    assert noop_of(Form("box", (2, 3))) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert noop_of(Form("multidiscrete", (4, 5, 6))) == (0, 0, 0)
    assert noop_of(Form("multibinary", (2,))) == (0, 0)


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
