"""What each perturbation of planning, control and timing has an agent do, turn by turn."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Space, Text

from gamekeeper.contract import Contract
from gamekeeper.rollouts.interventions.action_perturbations import (
    ActionDropout,
    ActionNoise,
    ActionSaturation,
    Frozen,
    StickyActions,
)
from gamekeeper.rollouts.interventions.delays import ActionDelay, SlowerAgent
from gamekeeper.rollouts.interventions.perturbation import Perturbation
from gamekeeper.rollouts.interventions.tick_order import LaterPlace

ALL = np.ones(6, np.int8)


class One:
    """As much of an environment as a perturbation asks."""

    possible_agents = ("a_0", "a_1")

    def __init__(self, space: Space[Any]) -> None:
        self.space = space

    def action_space(self, agent: Any) -> Space[Any]:
        return self.space


def idle(noop: Any) -> Contract:
    """A contract with an action that does nothing."""
    return Contract.from_json({"roles": {"a": {"noop": noop}}})


def done(
    change: Perturbation,
    space: Space[Any],
    chosen: list[Any],
    *,
    contract: Contract | None = None,
    masks: list[Any] | None = None,
) -> list[Any]:
    """What one agent does of what it chooses."""
    hooks = change.start(np.random.default_rng(0))
    hooks.declared(contract or Contract())
    hooks.before_reset(One(space))
    found = []
    for turn, action in enumerate(chosen):
        info = {} if masks is None else {"action_mask": masks[turn]}
        hooks.given(turn, "a_0", None, info)
        found.append(hooks.acts(turn, {"a_0": action})["a_0"])
    return found


def only(*legal: int) -> Any:
    """A mask of six actions."""
    mask = np.zeros(6, np.int8)
    mask[list(legal)] = 1
    return mask


def test_frozen_repeats_the_first_action() -> None:
    """Where it is illegal the noop stands in, else the first legal action; types stay."""
    chosen = [np.int64(3), np.int64(1), np.int64(2), np.int64(5)]
    masks = [ALL, ALL, only(2, 4), only(5)]
    found = done(Frozen(), Discrete(6), chosen, masks=masks)
    assert found == [3, 3, 2, 5]
    assert {type(each) for each in found} == {np.int64}
    assert done(Frozen(), Discrete(6), [3, 1, 2, 5], masks=masks, contract=idle(4)) == [3, 3, 4, 5]


def test_an_illegal_choice_stays_the_policys_own() -> None:
    """What an agent itself chose is done though it is illegal, as without a change."""
    assert done(Frozen(), Discrete(6), [3, 4], masks=[only(1), only(3)]) == [3, 3]
    assert done(StickyActions(strength=1e-9), Discrete(6), [3], masks=[only(1)]) == [3]


def test_a_mask_that_leaves_nothing_counts_as_none() -> None:
    """As for policies: there would be nothing to choose."""
    assert done(Frozen(), Discrete(6), [3, 4], masks=[only(), only()]) == [3, 3]


def test_action_noise_takes_other_legal_actions_alike() -> None:
    """At so many turns, each other legal action as often as any other."""
    masks = [only(0, 2, 3, 5)] * 3000
    found = np.array(done(ActionNoise(strength=0.3), Discrete(6), [2] * 3000, masks=masks))
    counts = np.bincount(found, minlength=6)
    assert counts[1] == counts[4] == 0
    assert counts[2] == pytest.approx(2100, rel=0.05)
    assert counts[[0, 3, 5]] == pytest.approx(np.full(3, 300), rel=0.2)


def test_action_noise_with_a_single_legal_action_does_it() -> None:
    """There is no other."""
    assert done(ActionNoise(strength=1.0), Discrete(6), [4], masks=[only(4)]) == [4]


def test_action_noise_befalls_each_whole_number_by_itself() -> None:
    """A MultiDiscrete action is changed in about half of its numbers, within its mask."""
    mask = (np.array([1, 1, 0], np.int8), np.ones(50, np.int8))
    found = np.array(
        done(
            ActionNoise(strength=0.5),
            MultiDiscrete([3, 50]),
            [np.array([1, 9])] * 400,
            masks=[mask] * 400,
        )
    )
    assert set(found[:, 0]) == {0, 1}
    assert (found[:, 1] != 9).mean() == pytest.approx(0.5, abs=0.1)
    assert ((found[:, 0] != 1) & (found[:, 1] != 9)).mean() == pytest.approx(0.25, abs=0.1)


def test_action_noise_of_a_box_is_normal_and_stays_inside() -> None:
    """Its deviation is a part of the range."""
    space = Box(-10, 10, (2,), np.float64)
    found = np.array(done(ActionNoise(strength=0.05), space, [np.array([0.0, 10.0])] * 2000))
    assert found[:, 0].std() == pytest.approx(1, rel=0.1)
    assert found[:, 1].max() == 10
    assert np.array(done(ActionNoise(), space, [[0.0, 1.0]])[0]).shape == (2,)


def test_sticky_action_is_what_was_done_before() -> None:
    """Certain stickiness is the first action for ever; what stood in for it sticks, too."""
    masks = [ALL, ALL, only(1, 4), ALL]
    found = done(
        StickyActions(strength=1.0), Discrete(6), [3, 0, 0, 0], masks=masks, contract=idle(4)
    )
    assert found == [3, 3, 4, 4]


def test_dropout_does_nothing() -> None:
    """The declared noop; without one, the last own choice; first of all, the choice itself."""
    chosen = list(range(6)) * 50
    always = ActionDropout(strength=1.0)
    assert done(always, Discrete(6), chosen, contract=idle(4)) == [4] * 300
    assert done(always, Discrete(6), chosen) == chosen
    found = done(ActionDropout(strength=0.5), Discrete(6), chosen)
    repeats = sum(one != other for one, other in zip(found, chosen, strict=True))
    assert 100 < repeats < 200
    assert done(always, Discrete(6), [0], masks=[only(1)], contract=idle(4)) == [1]


def test_saturation_shrinks_the_range_towards_the_noop() -> None:
    """Towards 0 where none is declared; numbers without bounds stay."""
    space = Box(np.float32([-2, 0, -np.inf]), np.float32([2, 1, np.inf]))
    chosen = [np.float32([-2, 1, 1000]), np.float32([0.5, 0.25, -7])]
    found = done(ActionSaturation(strength=0.5), space, chosen)
    assert [each.tolist() for each in found] == [[-1, 0.5, 1000], [0.5, 0.25, -7]]
    assert found[1] is chosen[1]
    at_one = done(ActionSaturation(strength=1.0), space, chosen, contract=idle([1.0, 1.0, 0.0]))
    assert [each.tolist() for each in at_one] == [[1, 1, 1000], [1, 1, -7]]
    assert "bounds" in str(ActionSaturation.applies(Contract(), One(Discrete(3)), "a_0"))
    assert ActionSaturation.applies(Contract(), One(space), "a_0") is None


def test_delay_carries_out_what_was_chosen_before() -> None:
    """At first the noop, or the first legal action; 0 for a Box."""
    delay = ActionDelay(strength=2.0)
    assert done(delay, Discrete(6), [5, 4, 3, 2], contract=idle(1)) == [1, 1, 5, 4]
    masks = [only(3), ALL, ALL, only(2, 3)]
    assert done(delay, Discrete(6), [5, 4, 3, 2], masks=masks) == [3, 0, 5, 2]
    found = done(delay, Box(-1, 1, (1,), np.float64), [np.ones(1)] * 3)
    assert [float(each[0]) for each in found] == [0, 0, 1]


def test_delayed_arrays_are_kept_from_their_giver() -> None:
    """A policy that writes into its action later doesn't change what is carried out."""
    hooks = ActionDelay(strength=1.0).start(np.random.default_rng(0))
    hooks.before_reset(One(Box(-1, 1, (1,), np.float64)))
    buffer = np.ones(1)
    hooks.acts(0, {"a_0": buffer})
    buffer[:] = -1
    assert hooks.acts(1, {"a_0": buffer})["a_0"] == 1


def test_slower_agent_waits_after_each_action() -> None:
    """Two turns of nothing after each; without a noop it can't be tried."""
    slow = SlowerAgent(strength=2.0)
    found = done(slow, Discrete(6), [5, 5, 5, 3, 3, 3, 2], contract=idle(0))
    assert found == [5, 0, 0, 3, 0, 0, 2]
    assert "nothing" in str(SlowerAgent.applies(Contract(), One(Discrete(6)), "a_0"))
    assert SlowerAgent.applies(idle(0), One(Discrete(6)), "a_0") is None


def test_dead_agents_do_nothing() -> None:
    """The None of an agent that ended stays, and counts as no turn."""
    assert done(SlowerAgent(), Discrete(6), [5, None, 5, 5], contract=idle(0)) == [5, None, 0, 5]


def test_actions_of_many_parts_are_disturbed_part_by_part() -> None:
    """A stand-in for a Dict is made of its parts; texts are as short as can be."""
    space = Dict({"move": Box(1.0, 2.0, (1,), np.float64), "say": Text(5), "to": Discrete(3)})
    chosen = {"move": np.array([1.5]), "say": "hello", "to": np.int64(2)}
    first = done(ActionDelay(strength=1.0), space, [chosen])[0]
    assert (first["move"].tolist(), len(first["say"]), first["to"]) == ([1.0], 1, 0)
    assert chosen["say"] == "hello"
    mask = {"to": np.array([0, 1, 0], np.int8)}
    assert done(ActionDelay(strength=1.0), space, [chosen], masks=[mask])[0]["to"] == 1


def test_later_place_moves_to_the_end() -> None:
    """Named agents go last, or first where they are last; everybody named is turned round."""

    def order(*agents: str) -> list[str]:
        change = LaterPlace(agents=agents or None)
        hooks = change.start(np.random.default_rng(0))
        return list(hooks.acts(0, {"a": 1, "b": 2, "c": 3}))

    assert order("a") == ["b", "c", "a"]
    assert order("c") == ["c", "a", "b"]
    assert order("a", "b") == ["c", "a", "b"]
    assert order() == ["c", "b", "a"]
    assert LaterPlace.applies(Contract(), One(Discrete(2)), "a_0") is None
