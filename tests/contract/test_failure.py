import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract.failure import Failure
from gamekeeper.errors import ContractError

VALUES = {"deliveries": 2, "return": -1.5, "picker.grasps": 4, "met": True, "ending": "battery"}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("deliveries < 3", True),
        ("deliveries >= 3", False),
        ("0 < deliveries <= 2", True),
        ("0 < deliveries < 2", False),
        ("return < 0 and deliveries == 2", True),
        ("return > 0 or deliveries != 2", False),
        ("return > 0 or deliveries == 2 and met", True),
        ("not met or ending == 'battery'", True),
        ('not (met or ending == "cleared")', False),
        ("not not met", True),
        ("deliveries * 2 - picker.grasps == 0", True),
        ("deliveries + 2 * 3 == 8", True),
        ("(deliveries + 2) * 3 == 12", True),
        ("8 / 2 / 2 == 2", True),
        ("8 - 2 - 2 == 4", True),
        ("-return > 1e0", True),
        ("--1 == 1", True),
        ("met", True),
    ],
)
def test_failure_holds_as_arithmetic_has_it(text, expected):
    """Operators bind as they do in arithmetic and logic."""
    assert Failure(text).holds(VALUES) is expected


@pytest.mark.parametrize("text", ["return", "deliveries + 1", "ending"])
def test_failure_is_no_figure(text):
    """A condition that comes to a number or a text is neither true nor false."""
    with pytest.raises(ContractError, match="neither true nor false"):
        Failure(text).holds(VALUES)


def test_failure_names_what_it_asks_for():
    """The names are known before any episode was run."""
    expected = frozenset({"a", "b.c", "return"})
    assert Failure("a < 3 and (b.c > 1 or not return)").names == expected


def test_failure_on_what_is_not_measured_lists_each_name_once():
    """With thirty agents the names are as many as with one, with an example of one agent's."""
    values = {
        "return": 0.0,
        **{f"a_{k}.{name}": 0.0 for k in range(30) for name in ("return", "x")},
    }
    with pytest.raises(ContractError, match=r"isn't measured") as raised:
        Failure("b_0.return < 0").check(values)
    assert raised.value.expected == "return, a_0.x; of an agent or a role: a_0.return"


@pytest.mark.parametrize(
    ("text", "at"),
    [
        ("", 1),
        ("deliveries <", 13),
        ("< 3", 1),
        ("a b", 3),
        ("(a < 3", 7),
        ("a < 3)", 6),
        ("a = 3", 3),
        ("a < 3 and", 10),
        ("a.b() < 1", 4),
        ("__import__('os')", 11),
        ("a < 'x", 5),
        ("3 $ 4", 3),
        ("and", 1),
        ("a;b", 2),
        ("[1]", 1),
    ],
)
def test_failure_that_is_no_condition_says_where(text, at):
    """The error names the character at which reading stopped."""
    with pytest.raises(ContractError, match=rf"at character {at}\b") as caught:
        Failure(text)
    assert caught.value.expected
    assert caught.value.fix


@pytest.mark.parametrize("text", ["(" * 400 + "a" + ")" * 400, "-" * 500 + "a", "not " * 200 + "a"])
def test_failure_bounds_how_deep_it_is_nested(text):
    """Nesting is refused before it can exhaust the stack."""
    with pytest.raises(ContractError, match="levels"):
        Failure(text)


def test_failure_bounds_its_length():
    """A condition longer than anyone writes is refused."""
    with pytest.raises(ContractError, match="characters"):
        Failure("a" * 2_000)


@pytest.mark.parametrize(
    ("text", "what"),
    [("missing < 3", "missing"), ("ending < 3", "can't be worked out"), ("1 / 0 > 1", "zero")],
)
def test_failure_that_cannot_be_worked_out_says_why(text, what):
    """A missing figure or a comparison of two kinds is an error, never false."""
    with pytest.raises(ContractError, match=what):
        Failure(text).holds(VALUES)


@given(st.text(max_size=30) | st.text("ab.<>=()+-*/ 01'not ", max_size=30))
def test_failure_meets_any_text_with_its_own_error(text):
    """No text makes reading fail in a way that isn't explained, and none runs code."""
    try:
        condition = Failure(text)
    except ContractError:
        return
    assert Failure(condition.text) == condition
