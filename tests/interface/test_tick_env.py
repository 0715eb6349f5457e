"""A Parallel environment of which the author wrote the rules alone."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from hypothesis import given
from hypothesis import strategies as st
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test
from pettingzoo.utils.conversions import parallel_to_aec

from gamekeeper.errors import ActionError, ContractError, OrderError
from gamekeeper.interface.tick_env import TickEnv
from tests.interface.relays import FinedTickTickets, TickRelay, TickTickets

NAMES = [f"agent_{i}" for i in range(8)]
SPACE = Discrete(3)


def test_relay_passes_the_tests_of_pettingzoo() -> None:
    """Parallel API and seed tests, and the AEC ones behind PettingZoo's converter."""
    parallel_api_test(TickRelay(), num_cycles=50)
    parallel_seed_test(TickRelay, num_cycles=20)
    api_test(parallel_to_aec(TickRelay()), num_cycles=20)


def rest_of(env: TickRelay) -> list[Any]:
    """All that is returned from here to the end."""
    seen = []
    while env.agents:
        returned = env.step(dict.fromkeys(env.agents, 1 + env.turns % 2))
        seen.append((repr(returned), copy.deepcopy((env.agents, env.terms, env.touched))))
    return seen


def test_actions_come_in_the_order_of_possible_agents() -> None:
    """Whatever order a caller's dictionary has, outcome and order are the same."""
    results = []
    for turn_round in (False, True):
        env = TickRelay()
        env.reset(seed=2)
        agents = reversed(env.agents) if turn_round else env.agents
        returned = env.step(dict.fromkeys(agents, 2))
        results.append(repr(returned))
        assert env.possible_agents == env.order
    assert results[0] == results[1]


@pytest.mark.parametrize(
    ("actions", "text"),
    [
        ({}, "no action of 'runner_0', 'runner_1', 'runner_2'"),
        ({"runner_0": 1, "runner_1": 1}, "no action of 'runner_2'"),
        ({"runner_0": 1, "runner_1": 1, "x": 1}, "of 'runner_2'; an action of nobody's: 'x'"),
        ({"runner_0": 1, "runner_1": 1, "runner_2": 1, "x": 1}, "an action of nobody's: 'x'"),
        ([1, 1, 1], "the actions of a tick are no dictionary"),
        (None, "the actions of a tick are no dictionary"),
    ],
)
def test_actions_that_are_not_the_live_agents_are_refused(actions: Any, text: str) -> None:
    """Who is missing and who shouldn't be there is named, and nothing has changed."""
    env = TickRelay()
    env.reset(seed=0)
    with pytest.raises(ActionError, match=text):
        env.step(actions)
    assert env.turns == 0
    env.step(dict.fromkeys(env.agents, 0))


def test_action_of_an_ended_agent_is_refused() -> None:
    """Who has ended may not act, and is named."""
    env = Scripted(3, [Tick(ends=((1, True),)), Tick()])
    env.reset()
    env.step(dict.fromkeys(env.agents, 0))
    assert env.agents == ["agent_0", "agent_2"]
    with pytest.raises(ActionError, match="an action of who has ended: 'agent_1'"):
        env.step(dict.fromkeys(NAMES[:3], 0))
    with pytest.raises(ActionError, match="an action of who hasn't joined: 'agent_5'"):
        env.step({"agent_0": 0, "agent_5": 0})


@pytest.mark.parametrize("action", [3, -1, None, 1.0, "1"])
def test_action_outside_its_space_is_refused(action: Any) -> None:
    """The error names agent, action and space, and nothing has changed."""
    env = TickRelay()
    env.reset(seed=0)
    with pytest.raises(ActionError, match="agent 'runner_1' did what is not in its action space"):
        env.step({"runner_0": 1, "runner_1": action, "runner_2": 1})
    assert (env.turns, list(env.cells.values())) == (0, [0.0] * 3)


def test_whole_numbers_reach_the_rules_as_int() -> None:
    """Rules get Python integers, whatever a policy's library made."""
    env = TickTickets()
    env.reset()
    env.step({"taker_0": np.int64(5), "taker_1": np.int8(6)})
    assert [int, int] == [type(action) for action in env.taken.values()]


def test_masks_stand_in_infos_and_observations() -> None:
    """Everybody's mask is in both, made once; masked actions are refused before the tick."""
    env = TickTickets()
    observations, infos = env.reset()
    observations, _, _, _, infos = env.step({"taker_0": 5, "taker_1": 7})
    for agent in env.agents:
        assert infos[agent]["action_mask"].tolist() == [0, 1, 0, 1]
        assert observations[agent]["action_mask"].tolist() == [0, 1, 0, 1]
        assert env.observation_space(agent).contains(observations[agent])
        assert infos[agent]["free"] == 2
    assert env.asked == 4
    with pytest.raises(ActionError, match="agent 'taker_1' did what is masked out"):
        env.step({"taker_0": 6, "taker_1": 5})
    assert env.taken == {"taker_0": 5, "taker_1": 7}


def test_rule_for_illegal_actions_takes_the_place_of_the_error() -> None:
    """A fine is paid; without another action in its place an agent isn't in the tick's actions."""
    env = FinedTickTickets()
    env.reset()
    env.step({"taker_0": 5, "taker_1": 6})
    _, rewards, *_ = env.step({"taker_1": 5, "taker_0": 6})
    assert rewards == {"taker_0": -1.0, "taker_1": -1.0}
    assert env.taken == {"taker_1": 8}
    assert env.terms == {"taker_0": {"fine": -1.0}, "taker_1": {"fine": -1.0}}


class Tick:
    """What one tick does. Numbers of agents are taken modulo the length of the roster."""

    def __init__(self, pays: Any = (), ends: Any = (), joins: tuple[int, ...] = ()) -> None:
        self.pays, self.ends, self.joins = pays, ends, joins

    def __repr__(self) -> str:
        return f"Tick({self.pays}, {self.ends}, {self.joins})"


TICKS = st.builds(
    Tick,
    st.lists(st.tuples(st.integers(0, 7), st.floats(-1e6, 1e6)), max_size=4),
    st.just(()) | st.lists(st.tuples(st.integers(0, 7), st.booleans()), max_size=3),
    st.just(()) | st.lists(st.integers(0, 7), max_size=2).map(tuple),
)


class Scripted(TickEnv):
    """Plays ticks from a script."""

    def __init__(self, n: int, script: list[Tick]) -> None:
        super().__init__()
        self.possible_agents = NAMES
        self.action_spaces = self.observation_spaces = dict.fromkeys(NAMES, SPACE)
        self.n, self.script = n, script

    def starting_agents(self) -> list[str]:
        return NAMES[: self.n][::-1]

    def observe(self, agent: str) -> int:
        return self.turns

    def tick(self, actions: dict[str, int]) -> None:
        self.order = list(actions)
        tick, roster = self.script[self.turns - 1], self.agents
        for index, amount in tick.pays:
            self.add_reward(roster[index % len(roster)], amount)
        for index, terminated in tick.ends:
            (self.terminate if terminated else self.truncate)(roster[index % len(roster)])
        for index in tick.joins:
            if NAMES[index] not in self.agents and NAMES[index] not in self.endings:
                self.join(NAMES[index])


@given(st.integers(1, 6), st.lists(TICKS, min_size=1, max_size=12))
def test_ticks_return_what_was_done_in_them(n: int, script: list[Tick]) -> None:
    """Rewards, flags, rosters and what was touched equal a plain account of the script."""
    env = Scripted(n, script)
    env.reset()
    live, gone = NAMES[:n], set[str]()
    for number, tick in enumerate(script):
        if not live:
            break
        rewards = dict.fromkeys(live, 0.0)
        flags = {agent: [False, False] for agent in live}
        for index, amount in tick.pays:
            rewards[live[index % len(live)]] += amount
        for index, terminated in tick.ends:
            flags[live[index % len(live)]][not terminated] = True
        joined = [
            name
            for name in dict.fromkeys(NAMES[index] for index in tick.joins)
            if name not in live and name not in gone
        ]
        ended = {agent for agent in live if any(flags[agent])}
        for name in joined:
            rewards[name], flags[name] = 0.0, [False, False]
        observations, paid, terminations, truncations, infos = env.step(
            dict.fromkeys(reversed(live), 0)
        )
        assert live == env.order
        assert rewards == paid
        assert {agent: flag[0] for agent, flag in flags.items()} == terminations
        assert {agent: flag[1] for agent, flag in flags.items()} == truncations
        assert dict.fromkeys(rewards, number + 1) == observations
        assert {agent: {} for agent in rewards} == infos
        assert (joined, ended) == (env.touched.joined, set(env.touched.ended))
        assert ended == set(env.touched.left)
        assert {agent for agent in paid if paid[agent]} <= set(env.touched.paid)
        gone |= ended
        live = [name for name in NAMES if name in rewards and name not in gone]
        assert live == env.agents


def test_returned_dictionaries_are_the_callers() -> None:
    """Whoever writes to what was returned doesn't disturb the next tick or an older one."""
    env = TickRelay()
    env.reset(seed=1)
    kept = env.step(dict.fromkeys(env.agents, 1))
    frozen = copy.deepcopy(kept)
    roster = env.agents
    for part in env.step(dict.fromkeys(env.agents, 2)):
        part.clear()  # type: ignore[attr-defined]  # each is a dictionary
    assert repr(frozen) == repr(kept)
    env.step(dict.fromkeys(roster, 0))
    assert env.turns == 3


@pytest.mark.parametrize("horizon", [1, 4])
def test_horizon_truncates_after_so_many_ticks(horizon: int) -> None:
    """Everybody left is truncated in tick `horizon`, with the reason; the rules' endings stand."""
    env = TickRelay(max_cycles=horizon)
    env.reset(seed=0)
    for _ in range(horizon):
        _, _, terminations, truncations, _ = env.step(dict.fromkeys(env.agents, 0))
    assert ([], {"horizon"}) == (env.agents, set(env.endings.values()))
    assert ({False}, {True}) == (set(terminations.values()), set(truncations.values()))


def test_calls_out_of_order_are_refused() -> None:
    """Before the first reset and after the end there is no tick."""
    env = Scripted(1, [Tick(ends=((0, True),))])
    with pytest.raises(OrderError, match=r"step\(\) came before reset"):
        env.step({})
    env.reset()
    env.step({"agent_0": 0})
    with pytest.raises(OrderError, match="after the last agent had left"):
        env.step({})


def test_rules_of_a_missing_tick_are_asked_for() -> None:
    """The method tick is the author's to write, and nobody may be paid by the first state."""

    class Empty(Scripted):
        tick = TickEnv.tick  # type: ignore[assignment]

        def start(self, rng: Any, options: Any) -> None:
            if options:
                self.add_reward("agent_0", 1.0)

    env = Empty(1, [])
    env.reset()
    with pytest.raises(NotImplementedError, match=r"Empty has no tick\(actions\)"):
        env.step({"agent_0": 0})
    with pytest.raises(ContractError, match="paid before anybody acted"):
        env.reset(options={"add_reward": True})


def test_reset_without_a_seed_plays_the_next_episode() -> None:
    """Episodes of a seed differ, and come back with it."""
    env = TickRelay()
    env.reset(seed=7)
    first = rest_of(env)
    env.reset()
    assert first != rest_of(env)
    env.reset(seed=7)
    assert first == rest_of(env)


@pytest.mark.parametrize("before", [0, 3])
def test_copies_of_a_running_environment_go_on_alike(before: int) -> None:
    """Snapshot, deep copy and pickle play the same rest, bit for bit."""
    env = TickRelay()
    env.reset(seed=11)
    for _ in range(before):
        env.step(dict.fromkeys(env.agents, 1))
    snapshot = env.snapshot()
    counterfactuals = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), TickRelay()]
    counterfactuals[2].restore(snapshot)
    expected = rest_of(env)
    env.restore(snapshot)
    assert [expected] * 4 == [rest_of(each) for each in (env, *counterfactuals)]


def test_human_mode_draws_by_itself() -> None:
    """Whoever watches sees the first state and every tick."""
    env = TickRelay(render_mode="human")
    env.reset(seed=0)
    env.step(dict.fromkeys(env.agents, 1))
    assert env.drawn == 2
