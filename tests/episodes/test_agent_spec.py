import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.contract import Contract
from gamekeeper.contract.sections import frozen
from gamekeeper.episodes.agent_spec import AgentSpec, agent_spec, as_action
from gamekeeper.errors import ContractError

BOX = spaces.Box(-1, 1, (2,), np.float32)

GOOD = [
    (spaces.Discrete(3), 1, 1),
    (spaces.Discrete(3, start=-1), -1, -1),
    (BOX, [0, 0.5], np.array([0, 0.5], np.float32)),
    (spaces.Box(0, 1, (), np.float64), 0.25, np.array(0.25)),
    (spaces.Box(0, 255, (2, 2), np.uint8), [[1, 2], [3, 4]], np.array([[1, 2], [3, 4]], np.uint8)),
    (spaces.MultiDiscrete([2, 3]), [1, 2], np.array([1, 2])),
    (spaces.MultiBinary(3), [0, 1, 0], np.array([0, 1, 0], np.int8)),
    (spaces.Text(5), "wait", "wait"),
    (spaces.Tuple([spaces.Discrete(2), spaces.Text(3)]), [1, "a"], (1, "a")),
    (spaces.Dict(a=spaces.Discrete(2)), {"a": 1}, {"a": 1}),
    (spaces.OneOf([spaces.Discrete(2), spaces.Discrete(9)]), [1, 8], (1, 8)),
    (spaces.Sequence(spaces.Discrete(4)), [1, 3], (1, 3)),
]
BAD = [
    (spaces.Discrete(3), 3),
    (spaces.Discrete(3), True),
    (spaces.Discrete(3), 1.0),
    (spaces.Discrete(3), [1]),
    (BOX, [0, 2]),
    (BOX, [0]),
    (BOX, 0),
    (BOX, [0, "x"]),
    (BOX, [0, [1]]),
    (BOX, [True, False]),
    (spaces.Box(0, 255, (1,), np.uint8), [256]),
    (spaces.Box(0, 255, (1,), np.uint8), [-1]),
    (spaces.Box(0, 9, (1,), np.int64), [0.5]),
    (spaces.MultiDiscrete([2, 3]), [1, 3]),
    (spaces.Text(5), 3),
    (spaces.Tuple([spaces.Discrete(2)]), [1, 1]),
    (spaces.Tuple([spaces.Discrete(2)]), [2]),
    (spaces.Dict(a=spaces.Discrete(2)), {"b": 1}),
    (spaces.Dict(a=spaces.Discrete(2)), {}),
    (spaces.OneOf([spaces.Discrete(2)]), [1, 0]),
    (spaces.Graph(spaces.Discrete(2), None), [1]),
]


@pytest.mark.parametrize(("space", "value", "expected"), GOOD)
def test_declared_action_takes_the_types_of_its_space(space, value, expected):
    """Numbers, lists and tables become the action that the space itself would sample."""
    action = as_action(space, frozen(value))
    assert type(action) is type(expected)
    assert np.array_equal(action, expected) if isinstance(expected, np.ndarray) else True
    assert getattr(action, "dtype", None) == getattr(expected, "dtype", None)
    assert space.contains(action)


@pytest.mark.parametrize(("space", "value"), BAD)
def test_declared_action_is_never_bent_into_its_space(space, value):
    """What would have to be rounded, cut or broadcast is refused."""
    with pytest.raises(ValueError, match=r"form|fit|outside|numbers"):
        as_action(space, frozen(value))


plain_values = st.recursive(
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from([space for space, _, _ in GOOD]), plain_values)
def test_declared_action_is_in_its_space_or_refused(space, value):
    """Whatever was declared, an action that comes back is one of the space's."""
    try:
        made = as_action(space, frozen(value))
    except ValueError:
        return
    assert space.contains(made)


def test_agent_spec_joins_declarations_and_spaces():
    """An agent's line is its role's declarations beside its own spaces."""
    contract = Contract.parse(
        '[roles.picker]\nnoop = [0, 0]\nmask = "infos.m"\nmessages = ["say"]\nmay_join = true'
    )
    spec = agent_spec(contract, "picker_1", observation_space=BOX, action_space=BOX)
    assert spec == AgentSpec(
        name="picker_1", role="picker", observation_space=BOX, action_space=BOX, noop=(0, 0)
    )
    assert hash(spec) == hash(spec)
    first, second = spec.noop_action(), spec.noop_action()
    assert first is not second
    assert np.array_equal(first, np.zeros(2, np.float32))


def test_agent_without_a_role_has_a_line_of_its_spaces():
    """Nothing is declared of an agent whom no role holds."""
    expected = AgentSpec(name="wolf", action_space=BOX)
    assert agent_spec(Contract(), "wolf", action_space=BOX) == expected
    assert expected.noop_action() is None


def test_noop_outside_the_action_space_names_its_line():
    """The error leads to the contract's line, not to the environment."""
    contract = Contract.parse("name = 'a'\n[roles.a]\n\nnoop = 5", source="a.toml")
    with pytest.raises(ContractError, match="no action of agent 'a_0'") as caught:
        agent_spec(contract, "a_0", action_space=spaces.Discrete(5))
    assert caught.value.where == "a.toml, line 4, roles.a.noop"
    assert caught.value.actual == "5"
    assert "Discrete(5)" in caught.value.expected


def test_noop_none_is_no_action():
    """A role may declare that none of its actions does nothing."""
    contract = Contract.parse('[roles.a]\nnoop = "none"')
    assert agent_spec(contract, "a", action_space=spaces.Discrete(5)).noop_action() is None


@pytest.mark.parametrize(
    ("mask", "fix"),
    [("observation.actionmask", "'action_mask'"), ("observation.action_mask.deep", "none")],
)
def test_mask_missing_in_the_observation_names_its_line(mask, fix):
    """A mask that can't stand where it is declared is found before the first step."""
    space = spaces.Dict(action_mask=spaces.MultiBinary(3), observation=BOX)
    contract = Contract.parse(f'[roles.a]\nmask = "{mask}"', source="a.toml")
    with pytest.raises(ContractError) as caught:
        agent_spec(contract, "a", observation_space=space)
    assert caught.value.where == "a.toml, line 2, roles.a.mask"
    assert fix in caught.value.fix
