"""An AEC environment of which the author wrote the rules alone."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from pettingzoo.test import api_test, max_cycles_test, render_test, seed_test, state_test
from pettingzoo.utils import wrappers
from pettingzoo.utils.conversions import aec_to_parallel

from gamekeeper.errors import ActionError, ContractError, DrawError, OrderError
from gamekeeper.interface.turn_env import TurnEnv
from gamekeeper.randomness.stream import Stream
from tests.interface import relays
from tests.interface.relays import TickRelay, TurnRelay, TurnTickets, played


def test_relay_passes_the_tests_of_pettingzoo() -> None:
    """api, seed, render, state and max-cycles tests, as PettingZoo ships them."""
    api_test(TurnRelay(), num_cycles=50)
    seed_test(TurnRelay, num_cycles=20)
    render_test(TurnRelay)
    state_test(TurnRelay(), TickRelay())
    max_cycles_test(relays)


def test_masked_task_passes_the_tests_of_pettingzoo() -> None:
    """A Dict observation with a mask, and a mask in infos, satisfy the same tests."""
    with pytest.warns(UserWarning, match="render|Box|Observation"):
        api_test(TurnTickets(), num_cycles=50)
    seed_test(TurnTickets, num_cycles=20)


def test_wrappers_of_pettingzoo_change_nothing() -> None:
    """The documented wrapper stack finds what it needs, and every turn is the same."""
    env = TurnRelay()
    wrapped = wrappers.OrderEnforcingWrapper(wrappers.AssertOutOfBoundsWrapper(TurnRelay()))
    for each in (env, wrapped):
        each.reset(seed=5)
    assert played(env) == played(wrapped)


def test_cycle_of_turns_converts_to_parallel() -> None:
    """PettingZoo's own converter plays the relay, while nobody drops out."""
    env = TurnRelay(max_cycles=3)
    env.metadata = {**env.metadata, "is_parallelizable": True}
    parallel = aec_to_parallel(env)
    parallel.reset(seed=1)
    ticks = 0
    while parallel.agents:
        *_, truncations, _ = parallel.step(dict.fromkeys(parallel.agents, 0))
        ticks += 1
    assert ticks == 3
    assert {True} == set(truncations.values())


# -- seeds


def test_reset_without_a_seed_plays_the_next_episode() -> None:
    """Episodes of a seed differ, come back with it, and don't hang on how long the last one was."""
    env = TurnRelay()
    env.reset(seed=7)
    first = played(env)
    env.reset()
    second = played(env)
    env.reset(seed=7)
    assert first == played(env, turns=200)
    env.reset(seed=7)
    env.step(2)
    env.reset()
    assert second == played(env)
    assert first != second
    assert Stream(7, 1).seed == env.rng.seed
    assert env.rng.episode == 1


def test_seed_zero_is_a_seed_and_none_is_not() -> None:
    """Seed 0 restarts; a first reset without a seed draws one, which can be told and given."""
    env, counterfactual = TurnRelay(), TurnRelay()
    env.reset(seed=0)
    assert (env.rng.seed, env.rng.episode) == (0, 0)
    env.reset(seed=np.int64(3))
    assert (env.rng.seed, env.rng.episode) == (3, 0)
    counterfactual.reset()
    seen = played(counterfactual)
    env.reset(seed=counterfactual.rng.seed)
    assert seen == played(env)


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "1"])
def test_seed_out_of_range_is_refused(seed: Any) -> None:
    """Nothing is cut or rounded into a seed."""
    with pytest.raises(DrawError, match="seed"):
        TurnRelay().reset(seed=seed)


def test_options_reach_the_start() -> None:
    """`start` gets what reset was given, and a dictionary where it was given nothing."""
    env = TurnRelay()
    env.reset(seed=1, options={"goal": 8})
    assert env.goal == 8.0
    env.reset(seed=1)
    assert Stream(1).integers(6, 10) == env.goal


# -- infos, observations, pictures


def test_infos_are_new_at_each_turn() -> None:
    """An info that somebody kept stays as it was given."""
    env = TurnTickets()
    env.reset()
    kept = [env.last()[4]]
    for action in (5, 6):
        env.step(action)
        kept.append(env.last()[4])
    assert [info["free"] for info in kept] == [4, 3, 2]


def test_agents_that_join_have_their_info_at_once() -> None:
    """Whoever reads infos after a step finds those who came in it."""

    class Growing(TurnTickets):
        def starting_agents(self) -> list[str]:
            return ["taker_0"]

        def act(self, agent: str, action: int) -> None:
            super().act(agent, action)
            if self.turns == 1:
                self.join("taker_1")

        def next_agent(self, agent: str) -> str:
            return "taker_0"

    env = Growing()
    env.reset()
    env.step(5)
    env.step(6)
    assert {agent: info["free"] for agent, info in env.infos.items()} == {
        "taker_0": 2,
        "taker_1": 3,
    }
    assert env.infos["taker_1"]["action_mask"].tolist() == [0, 1, 1, 1]


def test_observe_state_and_render_wait_for_a_reset() -> None:
    """The author's methods are guarded, and keep their names and texts."""
    env = TurnRelay(render_mode="ansi")
    for call in (lambda: env.observe("runner_0"), env.state, env.render):
        with pytest.raises(OrderError, match="before reset"):
            call()
    env.reset(seed=0)
    assert env.state_space.contains(env.state())
    assert env.render() == "0.0 0.0 0.0"
    assert TurnRelay.render.__name__ == "render"


def test_human_mode_draws_by_itself() -> None:
    """Whoever watches sees the first state and every turn."""
    env = TurnRelay(render_mode="human")
    env.reset(seed=0)
    env.step(1)
    env.step(1)
    assert env.drawn == 3


def test_subclass_may_build_on_the_author_s_methods() -> None:
    """super().observe() and a mask that only the subclass has both work."""

    class Doubled(TurnTickets):
        def observe(self, agent: str) -> dict[str, Any]:
            seen = super().observe(agent)
            return {**seen, "observation": seen["observation"] * 0 + 1}

    class Relay(TurnRelay):
        def mask(self, agent: str) -> list[int]:
            return [0, 1, 1]

    env = Doubled()
    env.reset()
    assert env.last()[0]["observation"].tolist() == [1.0]
    assert env.last()[0]["action_mask"].tolist() == [1, 1, 1, 1]
    relay = Relay()
    relay.reset(seed=0)
    with pytest.raises(ActionError, match="masked out"):
        relay.step(0)


def test_task_without_rules_says_what_is_missing() -> None:
    """The methods act and observe are the author's to write; a class that wasn't built says so."""

    class Empty(TurnEnv):
        def __init__(self, *, built: bool) -> None:
            if built:
                super().__init__()
                self.possible_agents = ["a_0"]
                self.action_spaces = self.observation_spaces = {"a_0": Discrete(1)}

    env = Empty(built=True)
    env.reset()
    with pytest.raises(NotImplementedError, match=r"Empty has no observe\(agent\)"):
        env.last()
    with pytest.raises(NotImplementedError, match=r"Empty has no act\(agent, action\)"):
        env.step(0)
    with pytest.raises(ContractError, match="Empty wasn't built completely"):
        Empty(built=False).reset()
