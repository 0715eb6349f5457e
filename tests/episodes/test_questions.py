import numpy as np
import pytest
from gymnasium import spaces

from gamekeeper.contract import Contract
from gamekeeper.episodes.agent_spec import AgentSpec
from gamekeeper.episodes.contract_questions import open_questions

WHOLE = """
name = "a_v0"
api = "aec"
why = "turns"
[schedule]
stages = [["a"]]
order = "fixed"
observe = "after turn"
conflicts = "ordered"
[roles.a]
symmetric = false
may_join = false
may_leave = false
noop = "none"
mask = "none"
messages = []
[rewards.r]
kind = "shared"
earner = "a"
payee = "all"
[endings]
won = { kind = "termination", owner = "all" }
[seeds]
deterministic = true
[failure]
team = "r < 1"
"""


def keys(contract, agents=()):
    """The key paths that are asked for."""
    return [question.key for question in open_questions(contract, agents)]


def test_questions_about_nothing_ask_for_all_of_the_game_form():
    """An empty contract is asked for its roles, rewards and endings, too."""
    expected = [
        "name",
        "api",
        "why",
        "schedule.stages",
        "schedule.order",
        "schedule.observe",
        "schedule.conflicts",
        "schedule.horizon",
        "roles.ROLE",
        "rewards.TERM",
        "endings.REASON",
        "seeds.deterministic",
        "failure.team",
    ]
    assert keys(Contract()) == expected


def test_questions_end_when_all_is_declared():
    """Every question has an answer: a contract can be complete."""
    assert keys(Contract.parse(WHOLE)) == []


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ('why = "turns"', "why"),
        ('order = "fixed"', "schedule.order"),
        ('noop = "none"', "roles.a.noop"),
        ("may_join = false", "roles.a.may_join"),
        ("messages = []", "roles.a.messages"),
        ('payee = "all"', "rewards.r.payee"),
        ("deterministic = true", "seeds.deterministic"),
        ('team = "r < 1"', "failure.team"),
    ],
)
def test_question_asks_for_what_is_missing_alone(line, key):
    """One declaration less is one question more."""
    assert keys(Contract.parse(WHOLE.replace(line, ""))) == [key]


def test_question_about_a_noop_names_role_and_key():
    """The noop is asked for by name, with the actions it can be."""
    contract = Contract.parse('[roles.picker]\nagents = "picker_*"')
    agents = [AgentSpec(name="picker_0", role="picker", action_space=spaces.Discrete(5, start=1))]
    asked = {question.key: question for question in open_questions(contract, agents)}
    noop = asked["roles.picker.noop"]
    assert noop.ask == "which action of role 'picker' does nothing?"
    assert str(noop).startswith(f"{noop.ask} -> roles.picker.noop = N")
    assert "1 to 5" in noop.hint


@pytest.mark.parametrize(
    ("space", "answer", "hint"),
    [
        (spaces.Box(0, 1, (2, 3), np.float32), "[N, …]", "2 by 3 numbers"),
        (spaces.MultiDiscrete([2, 2]), "[N, …]", "2 numbers"),
        (spaces.Dict(go=spaces.Discrete(2)), "{ KEY = N, … }", "go"),
        (spaces.Text(3), "N", "none"),
    ],
)
def test_question_about_a_noop_shows_its_form(space, answer, hint):
    """The form of the answer follows the action space."""
    contract = Contract.parse("[roles.a]")
    agents = [AgentSpec(name="a", role="a", action_space=space)]
    noop = next(q for q in open_questions(contract, agents) if q.key == "roles.a.noop")
    assert noop.answer == answer
    assert hint in noop.hint


def test_question_about_symmetry_is_not_asked_of_one_agent():
    """A role of one agent has nobody to be interchangeable with."""
    assert "roles.a.symmetric" not in keys(Contract.parse('[roles.a]\nagents = "a"'))
    assert "roles.a.symmetric" in keys(Contract.parse('[roles.a]\nagents = "a_*"'))


def test_question_about_an_illegal_action_follows_a_mask():
    """Only where some actions are illegal it matters what they do."""
    assert "roles.a.illegal" in keys(Contract.parse('[roles.a]\nmask = "infos.m"'))
    assert "roles.a.illegal" not in keys(Contract.parse('[roles.a]\nmask = "none"'))


def test_question_about_an_ending_stands_below_it():
    """An ending whose owner is open keeps its line, and the question stands under it."""
    rows = ('out = {owner = "all"}', 'won = {kind = "termination"}', "x = {}")
    contract = Contract.parse("\n".join(["[endings]", *rows]))
    text = contract.to_toml(open_questions(contract))
    lines = text.splitlines()
    at = lines.index("[endings.won]")
    assert lines[at + 1 : at + 3] == ['kind = "termination"', "## whom does 'won' end?"]
    assert lines[at + 3].startswith('# owner = "agent" ')
    assert Contract.parse(text) == contract
    asked = text[text.index("[endings.out]") :]
    answered = Contract.parse(asked.replace("\n# owner", "\nowner").replace("\n# kind", "\nkind"))
    assert [each.kind for each in answered.endings.values()] == ["termination"] * 3
    assert answered.endings["x"].owner == "agent"
