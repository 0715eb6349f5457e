"""Changes of the action dictionary's order, of one action, and in unison."""

import numpy as np
import pytest

from gamekeeper.checks.timing.turn_order import ORDERS
from gamekeeper.rollouts.interventions.action_substitutes import InUnison, ReplacedAction
from gamekeeper.rollouts.interventions.tick_order import ActionOrder, reordered

ACTIONS = {"a": 1, "b": 2, "c": 3}
RNG = np.random.default_rng(0)


@pytest.mark.parametrize("order", ORDERS)
def test_action_order_keeps_every_action(order: str) -> None:
    """Only the order of the dictionary changes, never who does what."""
    hooks = ActionOrder(order).start(RNG)
    assert all(hooks.acts(turn, dict(ACTIONS)) == ACTIONS for turn in range(5))


@pytest.mark.parametrize("order", ORDERS)
def test_action_order_is_what_its_expression_says(order: str) -> None:
    """The program in a finding hands actions over in the same order as the audit did."""
    import random

    for turn in range(5):
        names = {"agents": list(ACTIONS), "turn": turn, "random": random}
        assert eval(ORDERS[order], names) == reordered(order, list(ACTIONS), turn)


def test_reversed_order_changes_every_pair() -> None:
    """Who came before another comes after it."""
    assert reordered("reversed", list(ACTIONS), 0) == ["c", "b", "a"]


def test_unknown_order_is_refused() -> None:
    """An order that nobody knows is an error."""
    with pytest.raises(KeyError):
        reordered("sideways", ["a"], 0)


def test_replaced_action_is_replaced_once() -> None:
    """One agent does something else at one turn, nobody else and at no other."""
    hooks = ReplacedAction(2, "b", 9).start(RNG)
    seen = [hooks.acts(turn, dict(ACTIONS)) for turn in range(4)]
    assert seen == [ACTIONS, ACTIONS, {**ACTIONS, "b": 9}, ACTIONS]


def test_replaced_action_leaves_the_dead_alone() -> None:
    """A dead agent's None stays None, and an absent agent absent."""
    hooks = ReplacedAction(0, "b", 9).start(RNG)
    assert hooks.acts(0, {"b": None}) == {"b": None}
    assert hooks.acts(0, {"a": 1}) == {"a": 1}


def test_in_unison_all_do_what_one_does() -> None:
    """With the share 1 every turn is played in unison, by what one of them would have done."""
    hooks = InUnison(share=1.0).start(np.random.default_rng(1))
    for turn in range(10):
        found = set(hooks.acts(turn, dict(ACTIONS)).values())
        assert len(found) == 1
        assert found < {1, 2, 3}


def test_in_unison_leaves_turns_alone() -> None:
    """With the share 0 nothing changes."""
    hooks = InUnison(share=0.0).start(RNG)
    assert hooks.acts(0, dict(ACTIONS)) == ACTIONS


def test_changes_are_told_as_plain_data() -> None:
    """Each names its kind and its parameters."""
    assert ActionOrder("rotated").to_json() == {"change": "ActionOrder", "order": "rotated"}
    assert ReplacedAction(1, "a", 0).to_json() == {
        "change": "ReplacedAction",
        "turn": 1,
        "agent": "a",
        "action": 0,
    }
