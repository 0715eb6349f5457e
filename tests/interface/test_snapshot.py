"""A running environment put aside and taken up again."""

import copy
from typing import Any

import pytest

from gamekeeper.errors import ContractError, SpecError
from gamekeeper.randomness.stream import Stream
from tests.interface.relays import TurnRelay, TurnTickets, played


def test_snapshot_goes_on_bit_for_bit_as_often_as_wanted() -> None:
    """The author's state, the stream and the books come back; what came later is forgotten."""
    env = TurnRelay()
    env.reset(seed=3)
    for _ in range(5):
        env.step(1)
    snapshot = env.snapshot()
    env.later = 1  # type: ignore[attr-defined]
    expected = played(env)
    for _ in range(2):
        env.restore(snapshot)
        assert not hasattr(env, "later")
        assert expected == played(env)
    env.restore(snapshot)
    env.reset()
    after = played(env)
    counterfactual = TurnRelay()
    counterfactual.restore(snapshot)
    assert expected == played(counterfactual)
    counterfactual.reset()
    assert after == played(counterfactual)


def test_snapshot_inside_a_loop_takes_up_the_turn() -> None:
    """A loop over agent_iter goes on after a restore."""
    env = TurnRelay()
    env.reset(seed=3)
    snapshot, agents = env.snapshot(), []
    for agent in env.agent_iter(6):
        agents.append(agent)
        env.step(0)
        if len(agents) == 2:
            env.restore(snapshot)
    assert [int(agent[-1]) for agent in agents] == [0, 1, 0, 1, 2, 0]


def test_snapshot_copies_what_cannot_be_pickled() -> None:
    """Objects of local classes are copied deeply; what the class names stays out."""

    class Cart:
        load = 0

    class Hauler(TurnRelay):
        snapshot_without = ("window",)

        def start(self, rng: Stream, options: dict[str, Any]) -> None:
            super().start(rng, options)
            self.cart, self.window = Cart(), object()

        def act(self, agent: str, action: int) -> None:
            self.cart.load += action

    env = Hauler()
    env.reset(seed=0)
    snapshot, window = env.snapshot(), env.window
    for _ in range(2):
        env.step(2)
        assert env.cart.load == 2
        env.restore(snapshot)
        assert env.cart.load == 0
    assert window is env.window


def test_snapshot_names_what_cannot_be_copied() -> None:
    """An attribute that is neither pickled nor copied is named, with what to do about it."""
    env = TurnRelay()
    env.reset(seed=0)
    env.pump = (each for each in [1])  # type: ignore[attr-defined]
    with pytest.raises(ContractError, match=r"self\.pump") as told:
        env.snapshot()
    assert "snapshot_without = ('pump',)" in str(told.value)


def test_snapshot_of_another_class_is_refused() -> None:
    """What wasn't taken of this class is no snapshot of it."""
    env = TurnRelay()
    env.reset()
    other = TurnTickets()
    other.reset()
    for thing in (other.snapshot(), b"bytes", None):
        with pytest.raises(SpecError, match="can't be restored"):
            env.restore(thing)  # type: ignore[arg-type]
    assert repr(other.snapshot()) == "<Snapshot of a TurnTickets>"


def test_deepcopy_shares_nothing_with_its_original() -> None:
    """What one plays, the other doesn't see."""
    env = TurnRelay()
    env.reset(seed=1)
    counterfactual = copy.deepcopy(env)
    before = [env.agents, env.rewards, env.turns, env.rng.state, env.cells]
    frozen = copy.deepcopy(before)
    played(counterfactual)
    assert frozen == before
