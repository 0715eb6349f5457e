"""One face in the place of the wrappers that environments ship in."""

import copy
import importlib
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from hypothesis import given
from hypothesis import strategies as st
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.classic import rps_v2, tictactoe_v3
from pettingzoo.test import api_test, parallel_api_test
from pettingzoo.utils import wrappers
from pettingzoo.utils.conversions import aec_to_parallel, parallel_to_aec
from pettingzoo.utils.env_logger import EnvLogger

from gamekeeper.errors import ActionError, OrderError
from gamekeeper.interface.slim import SlimParallel, SlimToAEC, described_slim, slim
from gamekeeper.interface.slim_aec import SlimAEC
from tests.interface.relays import TickRelay, TurnRelay
from tests.interface.ticking import SCRIPTS, Round, Ticks, Turns, aec_rows, parallel_rows, plain
from tests.interface.toys import Pair

QUIET = Round((), (), 0, 0)
MOST_TURNS = 400


def exact(value: Any) -> Any:
    """A value whose equality is that of every bit and type."""
    if isinstance(value, dict):
        return {key: exact(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.str, value.shape, value.tobytes()
    return (type(value), value.hex()) if isinstance(value, float) else value


def action_of(space: Any, seen: Any, rng: np.random.Generator, legal: float) -> Any:
    """A random action: mostly legal where there is a mask, sometimes out of a Box's bounds."""
    if not isinstance(space, Discrete):
        return rng.uniform(-1.3, 1.3, space.shape).astype(space.dtype)
    mask = seen.get("action_mask") if isinstance(seen, dict) else None
    if mask is not None and rng.random() < legal:
        return int(rng.choice(np.flatnonzero(mask)))
    return rng.integers(space.n)


def aec_story(env: Any, seed: int, legal: float) -> list[Any]:
    """All that an episode shows, every book at every turn."""
    rng, story = np.random.default_rng(seed), []
    env.reset(seed=seed)
    for agent in env.agent_iter(MOST_TURNS):
        observation, reward, terminated, truncated, info = env.last()
        names = ("rewards", "_cumulative_rewards", "terminations", "truncations", "infos")
        books = [exact(dict(getattr(env, name))) for name in names]
        flags = terminated, truncated
        given = exact(observation), exact(reward), flags, exact(info)
        story.append((agent, given, books, list(env.agents), env.num_agents))
        space = env.action_space(agent)
        env.step(None if any(flags) else action_of(space, observation, rng, legal))
    return story


def parallel_story(env: Any, seed: int, legal: float) -> list[Any]:
    """All that an episode shows."""
    rng = np.random.default_rng(seed)
    observations, infos = env.reset(seed=seed)
    story: list[Any] = [(exact(observations), exact(infos))]
    for _ in range(MOST_TURNS // 10):
        if not env.agents:
            break
        actions = {
            agent: action_of(env.action_space(agent), observations[agent], rng, legal)
            for agent in env.agents
        }
        out = env.step(actions)
        observations = out[0]
        story.append(([exact(dict(part)) for part in out], list(env.agents)))
    return story


def factory(name: str) -> Callable[..., Any]:
    """What `module:factory` names."""
    module, _, maker = name.partition(":")
    return getattr(importlib.import_module(module), maker)  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("name", "kwargs", "episodes", "legal"),
    [
        ("mpe2.simple_spread_v3:parallel_env", {}, 12, 1.0),
        ("mpe2.simple_spread_v3:parallel_env", {"continuous_actions": True}, 4, 1.0),
        ("mpe2.simple_tag_v3:env", {}, 3, 1.0),
        ("pettingzoo.classic.tictactoe_v3:env", {}, 60, 0.95),
        ("pettingzoo.classic.connect_four_v3:env", {}, 20, 0.99),
        ("pettingzoo.classic.rps_v2:env", {}, 3, 1.0),
        ("pettingzoo.classic.rps_v2:parallel_env", {}, 3, 1.0),
        ("pettingzoo.butterfly.pistonball_v6:parallel_env", {"max_cycles": 8}, 1, 1.0),
        ("pettingzoo.butterfly.knights_archers_zombies_v11:parallel_env", {}, 1, 1.0),
    ],
)
def test_slim_environment_gives_the_rows_of_the_shipped_one(
    name: str, kwargs: dict[str, Any], episodes: int, legal: float
) -> None:
    """Bit for bit, illegal and clipped actions with what they bring included."""
    make = factory(name)
    shipped, ours = make(**kwargs), slim(make(**kwargs))
    assert type(ours) in (SlimAEC, SlimParallel)
    story = parallel_story if isinstance(shipped, ParallelEnv) else aec_story
    for seed in range(episodes):
        assert story(shipped, seed, legal) == story(ours, seed, legal)


class Shuffled(Ticks):
    """Takes actions in any order, and what it does hangs on it."""

    in_order = False


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_slim_turns_of_ticks_equal_the_shipped_ones(n: int, script: list[Round], seed: int) -> None:
    """`parallel_to_aec`: turns, actions in the order it has them in, the dying, the joining."""
    # it can't let go of who ends in the tick in which it joins
    script = [replace(play, ends=() if play.joins else play.ends) for play in script]
    script[-1] = replace(script[-1], joins=0)
    shipped, ours = parallel_to_aec(Shuffled(n, script)), slim(parallel_to_aec(Shuffled(n, script)))
    assert type(ours) is SlimToAEC
    assert plain(aec_rows(shipped, seed)) == plain(aec_rows(ours, seed))


class Fixed(Turns):
    """Rounds in the order of the roster, as PettingZoo's converter must have them."""

    def _order(self, agents: list[str]) -> list[str]:
        return list(agents)


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_slim_ticks_of_turns_equal_the_shipped_ones(n: int, script: list[Round], seed: int) -> None:
    """`aec_to_parallel`: rewards and the dying; it can't do joining."""
    script = [replace(play, joins=0) for play in script]
    shipped, ours = aec_to_parallel(Fixed(n, script)), slim(aec_to_parallel(Fixed(n, script)))
    assert plain(parallel_rows(shipped, seed)) == plain(parallel_rows(ours, seed))


@pytest.mark.parametrize(
    ("name", "kwargs"),
    [
        ("pettingzoo.classic.tictactoe_v3:env", {"screen_height": 60}),
        ("mpe2.simple_spread_v3:parallel_env", {}),
    ],
)
def test_slim_environment_draws_the_same_pictures(name: str, kwargs: dict[str, Any]) -> None:
    """Frames are equal, and so are render mode, metadata, spaces and state."""
    make = factory(name)
    shipped, ours = (each(make(render_mode="rgb_array", **kwargs)) for each in (lambda e: e, slim))
    assert (shipped.render_mode, str(shipped)) == (ours.render_mode, str(ours))
    assert shipped.metadata == ours.metadata
    assert shipped.possible_agents == ours.possible_agents
    for env in (shipped, ours):
        env.reset(seed=1)
    assert np.array_equal(shipped.render(), ours.render())
    for agent in shipped.agents:
        assert shipped.observation_space(agent) == ours.observation_space(agent)
        assert ours.action_space(agent) is ours.unwrapped.action_space(agent)
    if hasattr(shipped, "state_space"):
        assert shipped.state_space == ours.state_space
        assert np.array_equal(shipped.state(), ours.state())


def test_reward_terms_are_told_where_the_shipped_environment_tells_them() -> None:
    """Wrappers hand them through, converters don't."""
    assert slim(wrappers.OrderEnforcingWrapper(TurnRelay())).terms == {}
    for env in (parallel_to_aec(TickRelay()), aec_to_parallel(Ready())):
        assert not hasattr(env, "terms")
        assert not hasattr(slim(env), "terms")


class Ready(TurnRelay):
    """Says that it can be played all at once."""

    metadata = {**TurnRelay.metadata, "is_parallelizable": True}  # noqa: RUF012


# -- promises


@pytest.mark.parametrize(
    "call",
    [
        lambda env: env.step(0),
        lambda env: env.observe("player_1"),
        lambda env: env.last(),
        lambda env: env.render(),
        lambda env: env.state(),
        lambda env: env.agent_iter(),
        lambda env: env.agents,
        lambda env: env.rewards,
        lambda env: env.agent_selection,
        lambda env: env.num_agents,
    ],
)
def test_calls_before_reset_are_refused(call: Callable[[Any], Any]) -> None:
    """With an error that is also what the wrapper raises."""
    env = slim(tictactoe_v3.env())
    with pytest.raises(OrderError, match="before reset") as caught:
        call(env)
    assert isinstance(caught.value, AssertionError | AttributeError)
    with pytest.raises((AssertionError, AttributeError)):
        call(tictactoe_v3.env())


def test_loop_without_a_step_is_refused() -> None:
    """As the wrapper does."""
    env = slim(tictactoe_v3.env())
    env.reset()
    with pytest.raises(AssertionError, match="without a step"):
        list(env.agent_iter())


@pytest.mark.parametrize("action", [9, -1, np.int64(9), None, 1.5])
def test_action_outside_its_space_is_refused(action: Any) -> None:
    """With an error that is also the AssertionError of the wrapper; nothing has changed."""
    env = slim(tictactoe_v3.env())
    env.reset()
    with pytest.raises(ActionError, match="'player_1' did what is not in its action space") as seen:
        env.step(action)
    assert isinstance(seen.value, AssertionError)
    assert env.agent_selection == "player_1"


def test_masked_out_action_ends_the_game() -> None:
    """Its player is paid the penalty, everybody ends, and it is logged."""
    env = slim(tictactoe_v3.env())
    env.reset()
    env.step(4)
    EnvLogger.flush()
    env.step(4)
    assert any("Illegal move" in line for line in EnvLogger.mqueue)
    assert env.rewards == {"player_1": 0, "player_2": -1.0}
    assert all(env.terminations.values())
    assert all(env.truncations.values())
    for _ in range(2):
        env.step(None)
    EnvLogger.flush()
    env.step(None)
    assert any("step() called after" in line for line in EnvLogger.mqueue)
    EnvLogger.flush()


def test_clipped_action_is_logged_and_a_nan_refused() -> None:
    """As the wrapper does."""
    make = factory("mpe2.simple_spread_v3:env")
    env = slim(make(continuous_actions=True))
    env.reset(seed=0)
    EnvLogger.flush()
    env.step(np.full(5, 2.0, np.float32))
    assert any("clipping to space" in line for line in EnvLogger.mqueue)
    assert env.unwrapped.current_actions[0].tolist() == [1.0] * 5
    EnvLogger.flush()
    for action in (np.full(5, np.nan, np.float32), np.zeros(4, np.float32)):
        with pytest.raises(AssertionError):
            env.step(action)


class Talker(Turns):
    """Prints its picture."""

    render_mode = "human"
    metadata = {"name": "talker_v0", "render_modes": ["human"]}  # noqa: RUF012

    def render(self) -> None:
        print("a picture")  # noqa: T201  # that is what it does


def test_captured_picture_is_what_is_printed() -> None:
    """The text comes back, and nothing is printed."""
    env = slim(wrappers.OrderEnforcingWrapper(wrappers.CaptureStdoutWrapper(Talker(2, [QUIET]))))
    assert (type(env), env.render_mode) == (SlimAEC, "ansi")
    env.reset()
    assert env.render() == "a picture\n"


# -- what is replaced and what stays


class Foreign(wrappers.BaseWrapper):  # type: ignore[misc, type-arg]
    """A wrapper that nobody knows."""


def test_unknown_wrapper_stays_with_all_that_is_inside_it() -> None:
    """What stands around it is replaced; where it is outermost, nothing is."""
    inside = Foreign(wrappers.AssertOutOfBoundsWrapper(tictactoe_v3.raw_env()))
    env = slim(wrappers.OrderEnforcingWrapper(inside))
    assert (type(env), env.env) == (SlimAEC, inside)
    assert slim(inside) is inside
    assert "stays: tests.interface.test_slim.Foreign" in described_slim(env)
    assert described_slim(inside)[0] == "replaced: nothing"
    for seed in range(3):
        shipped = wrappers.OrderEnforcingWrapper(
            Foreign(wrappers.AssertOutOfBoundsWrapper(tictactoe_v3.raw_env()))
        )
        assert aec_story(shipped, seed, 1.0) == aec_story(env, seed, 1.0)


def test_wrappers_in_another_order_stay_inside() -> None:
    """A promise is only kept in the place where it was made."""
    inside = wrappers.OrderEnforcingWrapper(tictactoe_v3.raw_env())
    env = slim(wrappers.AssertOutOfBoundsWrapper(inside))
    assert (env.env, env.replaced) == (inside, ("AssertOutOfBoundsWrapper",))


def test_what_is_not_wrapped_is_handed_back() -> None:
    """The same object."""
    for env in (Pair(), tictactoe_v3.raw_env(), slim(tictactoe_v3.env()), 3):
        assert slim(env) is env


def test_lines_tell_what_was_replaced() -> None:
    """Of an environment as shipped and of one that is slim already, the same."""
    expected = (
        "replaced: aec_to_parallel_wrapper (all agents at once)",
        "replaced: OrderEnforcingWrapper (the order of calls)",
        "replaced: AssertOutOfBoundsWrapper (actions outside their space are refused)",
        "environment: pettingzoo.classic.rps.rps.raw_env",
    )
    assert expected == described_slim(rps_v2.parallel_env())
    assert expected == described_slim(slim(rps_v2.parallel_env()))
    assert described_slim(Pair()) == ("replaced: nothing", "environment: tests.interface.toys.Pair")
    assert described_slim(parallel_to_aec(Pair())) == (
        "replaced: OrderEnforcingWrapper (the order of calls)",
        "replaced: parallel_to_aec_wrapper (one agent after the other)",
        "environment: tests.interface.toys.Pair",
    )


def test_public_attributes_are_handed_through_and_private_ones_are_not() -> None:
    """As the wrappers do."""
    env = slim(tictactoe_v3.env())
    assert env.board is env.unwrapped.board
    for name in ("_agent_selector", "nothing"):
        with pytest.raises(AttributeError):
            getattr(env, name)
    assert not hasattr(slim(wrappers.OrderEnforcingWrapper(Turns(1, [QUIET]))), "state_space")


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_go_on_alike(copied: Callable[[Any], Any]) -> None:
    """Where the environment inside can be copied while it runs."""
    stacks: list[AECEnv[Any, Any, Any]] = [
        wrappers.OrderEnforcingWrapper(
            wrappers.AssertOutOfBoundsWrapper(Turns(3, [QUIET] * 4, hasty=True))
        ),
        parallel_to_aec(Shuffled(3, [QUIET] * 4)),
    ]
    for stack in stacks:
        env = slim(stack)
        env.reset(seed=1)
        for _ in range(4):
            env.step(1)
        counterfactual = copied(env)
        for _ in range(6):
            assert exact(dict(enumerate(env.last()))) == exact(
                dict(enumerate(counterfactual.last()))
            )
            env.step(2)
            counterfactual.step(2)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_slim_environment_passes_the_tests_of_pettingzoo() -> None:
    """Both API tests."""
    api_test(slim(tictactoe_v3.env()), num_cycles=30)
    api_test(slim(factory("mpe2.simple_spread_v3:env")()), num_cycles=30)
    parallel_api_test(slim(factory("mpe2.simple_spread_v3:parallel_env")()), num_cycles=30)
    parallel_api_test(slim(rps_v2.parallel_env()), num_cycles=30)


def test_step_after_the_end_plays_nothing() -> None:
    """Five empty dictionaries of the converter's; a line in the log of the wrapper's."""
    env = slim(rps_v2.parallel_env(max_cycles=1))
    env.reset()
    env.step(dict.fromkeys(env.agents, 0))
    assert env.step({}) == ({},) * 5
    turns = slim(parallel_to_aec(Pair()))
    turns.reset()
    for action in (0, 0, None, None, None):
        turns.step(action)
    assert any("step() called after" in line for line in EnvLogger.mqueue)
    EnvLogger.flush()
