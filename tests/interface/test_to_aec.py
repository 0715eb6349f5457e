"""A Parallel environment behind the AEC interface."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from hypothesis import given
from hypothesis import strategies as st
from pettingzoo import AECEnv
from pettingzoo.test import api_test, seed_test, state_test
from pettingzoo.test.example_envs import (
    generated_agents_parallel_cust_agentid_v0,
    generated_agents_parallel_v0,
)

from gamekeeper.errors import ActionError, ContractError, OrderError, SpecError
from gamekeeper.interface.conversion import to_aec
from gamekeeper.interface.to_aec import ToAEC
from tests.auditing.lucky_games import Pushed
from tests.interface.relays import TickRelay, TickTickets
from tests.interface.ticking import NAMES, SCRIPTS, Round, Ticks, aec_rows, parallel_rows, plain
from tests.interface.toys import Pair

QUIET = Round((), (), 0, 0)


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_to_aec_gives_everybody_what_the_ticks_give(n: int, script: list[Round], seed: int) -> None:
    """Rewards, deaths, joins and rosters that turn: every row of every tick, in the same order."""
    assert plain(parallel_rows(Ticks(n, script), seed)) == plain(
        aec_rows(ToAEC(Ticks(n, script)), seed)
    )


@given(st.integers(1, 6), SCRIPTS)
def test_to_aec_pays_a_tick_at_its_last_turn(n: int, script: list[Round]) -> None:
    """The rewards of all turns add up to what the ticks pay, and nothing is paid in between."""
    env = ToAEC(Ticks(n, script))
    env.reset()
    while env.agents:
        turns = len(env.env.agents)
        for turn in range(turns):
            env.step(0)
            assert turn == turns - 1 or not any(env.rewards.values())
        _, rewards, *_ = replayed(n, script, env.env.time)
        assert rewards == env.rewards
        while env.agents and (
            env.terminations[env.agent_selection] or env.truncations[env.agent_selection]
        ):
            env.step(None)
            assert not any(env.rewards.values())


def test_to_aec_reads_an_array_of_actions_in_its_turn() -> None:
    """All agents' actions may come in one array that is written over from turn to turn."""
    env, action = ToAEC(Pushed()), np.zeros(1, np.float32)
    env.reset(seed=1)
    for push in (0.25, 0.5):
        action[:] = push
        env.step(action)
    assert env.rewards == {"a": 0.25, "b": 0.5}


def replayed(n: int, script: list[Round], ticks: int) -> Any:
    """What the last of some ticks gives, all actions 0."""
    env = Ticks(n, script)
    env.reset()
    return [env.step(dict.fromkeys(env.agents, 0)) for _ in range(ticks)][-1]


@given(st.integers(1, 5), SCRIPTS)
def test_to_aec_keeps_the_roster_of_the_environment(n: int, script: list[Round]) -> None:
    """Before each tick the rosters are equal, order included, and no list is shared."""
    env = ToAEC(Ticks(n, script))
    env.reset()
    for agent in env.agent_iter():
        if env.terminations[agent] or env.truncations[agent]:
            env.step(None)
            continue
        assert env.env.agents == env.agents
        assert env.agents is not env.env.agents
        for each in env.env.agents[:]:
            assert each == env.agent_selection
            env.step(0)


@given(st.integers(1, 5), SCRIPTS, st.integers(0, 8))
def test_copies_of_a_converted_environment_go_on_alike(
    n: int, script: list[Round], turns: int
) -> None:
    """A deep copy and a pickled one, taken in mid-tick, play the same rest."""
    env = ToAEC(Ticks(n, script))
    env.reset(seed=2)
    for _ in range(turns):
        if env.agents:
            _, _, terminated, truncated, _ = env.last()
            env.step(None if terminated or truncated else 1)
    counterfactuals = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    assert [rest(env)] * 2 == [rest(counterfactual) for counterfactual in counterfactuals]


def rest(env: AECEnv[Any, Any, Any]) -> list[Any]:
    """All that is given from here to the end."""
    seen = []
    for agent in env.agent_iter():
        observation, *others = env.last()
        seen.append((agent, observation.tolist(), others, list(env.agents)))
        env.step(None if others[1] or others[2] else 2)
    return seen


# -- what else is kept


def test_to_aec_hands_on_spaces_state_and_picture() -> None:
    """Spaces are the same objects, state and pictures the environment's own; both APIs agree."""
    env = to_aec(TickRelay(render_mode="ansi"))
    agent = env.possible_agents[0]
    assert env.observation_space(agent) is env.env.observation_space(agent)
    assert env.action_space(agent) is env.action_spaces[agent]
    assert env.env.state_space is env.state_space
    assert (env.render_mode, str(env)) == ("ansi", "relay_v0")
    assert env.metadata == {**TickRelay.metadata, "is_parallelizable": True}
    env.reset(seed=3)
    assert env.env.render() == env.render()
    assert env.unwrapped is env.env
    state_test(to_aec(TickRelay()), TickRelay())


def test_to_aec_keeps_terms_and_reasons() -> None:
    """Reward terms stand at the turn that pays them, endings by their reason."""
    env = to_aec(TickRelay(max_cycles=1))
    env.reset()
    for _ in range(2):
        env.step(0)
        assert env.terms == {}
    env.step(0)
    assert {agent: {"time": -0.1} for agent in env.possible_agents} == env.terms
    assert dict.fromkeys(env.possible_agents, "horizon") == env.endings


def test_to_aec_keeps_masks() -> None:
    """Masks in observations and infos are those of the tick before."""
    env, parallel = to_aec(TickTickets()), TickTickets()
    env.reset(seed=0)
    parallel.reset(seed=0)
    _, _, _, _, infos = parallel.step({"taker_0": 5, "taker_1": 7})
    env.step(5)
    env.step(7)
    observation, *_, info = env.last()
    assert infos["taker_0"]["action_mask"].tolist() == info["action_mask"].tolist()
    assert observation["action_mask"].tolist() == [0, 1, 0, 1]


class Aside(Pair):
    """Hands infos out that are by no agent, in part or whole."""

    def __init__(self, infos: dict[str, Any]) -> None:
        super().__init__()
        self.infos = infos

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        return super().reset()[0], self.infos


@pytest.mark.parametrize(
    ("infos", "expected"),
    [
        ({}, [{}, {}]),
        ({"wind": 3}, [{"wind": 3}, {"wind": 3}]),
        ({"a_1": {"own": 1}, "wind": 3}, [{"wind": 3}, {"own": 1}]),
    ],
)
def test_infos_that_are_by_no_agent_go_to_everybody(infos: Any, expected: Any) -> None:
    """No info is lost, whatever its keys."""
    env = to_aec(Aside(infos))
    env.reset()
    assert expected == [env.infos["a_0"], env.infos["a_1"]]


class Faulty(Pair):
    """Breaks one promise at its second tick."""

    def __init__(self, fault: str) -> None:
        super().__init__(3)
        self.fault = fault

    def step(self, actions: dict[str, Any]) -> Any:
        agents = self.agents
        out = [dict.fromkeys(agents, value) for value in (np.int64(0), 0.0, False, False)]
        if self.fault == "leaves":
            self.agents = agents[1:]
            out = [{agent: part[agent] for agent in self.agents} for part in out]
        if self.fault == "paid as it leaves":
            self.agents = agents[1:]
            out[1][agents[0]] = 1.0
        if self.fault == "lingers":
            out[2][agents[0]] = True
        if self.fault == "comes back":
            out[2] = {agent: agent == agents[-1] and len(agents) == 3 for agent in agents}
            self.agents = agents[:-1] if len(agents) == 3 else self.possible_agents
        if self.fault in ("observations", "rewards", "terminations", "truncations"):
            part = ("observations", "rewards", "terminations", "truncations").index(self.fault)
            del out[part][agents[1]]
        if self.fault == "pays nothing":
            out[1][agents[1]] = None
        return (*out, {agent: {} for agent in agents})


def ticks(fault: str, count: int) -> ToAEC:
    """A faulty environment after some ticks."""
    env = ToAEC(Faulty(fault))
    env.reset()
    for _ in range(count):
        tick = env.env.agents
        while env.env.agents is tick and not (
            env.terminations[env.agent_selection] or env.truncations[env.agent_selection]
        ):
            env.step(0)
            if fault not in ("leaves", "comes back") and env.agent_selection == "a_0":
                break
    return env


def test_agent_that_leaves_without_an_ending_is_gone() -> None:
    """The roster is the environment's, and the others play on."""
    env = ticks("leaves", 1)
    assert env.agents == ["a_1", "a_2"]
    assert env.touched.left == ["a_0"]
    assert {"a_1", "a_2"} == set(env.rewards) == set(env.infos) == set(env.terminations)
    env.step(0)
    assert env.agent_selection == "a_2"


def test_ended_agent_that_stays_in_the_roster_has_no_more_turns() -> None:
    """It takes its last turn once, and the ticks go on without it."""
    env = ticks("lingers", 1)
    env.step(None)
    for expected in ("a_1", "a_2"):
        assert expected == env.agent_selection
        env.step(0)
    assert env.agents == ["a_1", "a_2"]
    assert not any(env.terminations.values())


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("observations", "gave no observations for agent 'a_1'"),
        ("rewards", "gave no rewards for agent 'a_1'"),
        ("terminations", "gave no terminations for agent 'a_1'"),
        ("truncations", "gave no truncations for agent 'a_1'"),
        ("pays nothing", "'a_1' was paid what is no number"),
        ("paid as it leaves", "'a_0' was paid as it left without an ending"),
    ],
)
def test_to_aec_refuses_what_aec_cannot_hold(fault: str, said: str) -> None:
    """The error names the dictionary and the agent, and how to fix it."""
    with pytest.raises(ContractError, match=said) as caught:
        ticks(fault, 1)
    assert caught.value.fix


def test_to_aec_refuses_an_agent_that_comes_back() -> None:
    """An identity is used once in an episode."""
    env = ticks("comes back", 1)
    env.step(None)
    env.step(0)
    with pytest.raises(ContractError, match="'a_2' came back after it had ended"):
        env.step(0)


# -- order and actions


def test_calls_before_reset_and_after_the_end_are_refused() -> None:
    """As in our own environments: OrderError, which is the AttributeError of the wrapper."""
    env = to_aec(Pair())
    for call in (lambda: env.step(0), env.last, env.state, env.render, lambda: env.observe("a_0")):
        with pytest.raises(OrderError, match="before reset"):
            call()
    env.reset()
    for action in (0, 0, None, None):
        env.step(action)
    with pytest.raises(OrderError, match="after the last agent had left"):
        env.step(None)


@pytest.mark.parametrize("action", [2, -1, 0.5, None, np.int64(7), "0"])
def test_action_outside_its_space_changes_nothing(action: Any) -> None:
    """It is refused before the environment sees it, and the agent is still in turn."""
    env = to_aec(Pair())
    env.reset()
    env.step(np.int64(1))
    with pytest.raises(ActionError, match="'a_1'"):
        env.step(action)
    assert (env.agent_selection, env.turns) == ("a_1", 1)
    env.step(0)
    assert all(env.terminations.values())


class Handed(Pair):
    """Keeps what it is handed."""

    def action_space(self, agent: str) -> Any:
        return Discrete(2) if agent == "a_0" else Box(-1, 1, (2,), np.float32)

    def step(self, actions: dict[str, Any]) -> Any:
        self.handed = actions
        return super().step(actions)


def test_actions_are_handed_on_as_they_came() -> None:
    """In the order of the roster, no type changed."""
    env = to_aec(Handed())
    env.reset()
    actions = {"a_0": np.int8(1), "a_1": np.zeros(2, np.float32)}
    for action in actions.values():
        env.step(action)
    assert list(actions) == list(env.env.handed)
    assert repr(actions) == repr(env.env.handed)
    assert actions["a_0"].dtype == env.env.handed["a_0"].dtype


def test_to_aec_keeps_what_is_aec_and_refuses_what_is_nothing() -> None:
    """No second conversion; an error for what is no environment."""
    env = to_aec(Pair())
    assert to_aec(env) is env
    with pytest.raises(SpecError, match="only a PettingZoo environment"):
        to_aec(object())


# -- PettingZoo's tests


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    "make",
    [
        TickRelay,
        TickTickets,
        generated_agents_parallel_v0.parallel_env,
        generated_agents_parallel_cust_agentid_v0.parallel_env,
        lambda: Ticks(4, [QUIET] * 5),
    ],
)
def test_converted_environment_passes_the_tests_of_pettingzoo(make: Any) -> None:
    """The API test, and where the environment itself does, the seed test."""
    api_test(to_aec(make()), num_cycles=100)
    if make in (TickRelay, TickTickets):
        seed_test(lambda: to_aec(make()), num_cycles=20)


def test_agents_that_were_never_possible_are_listed_as_they_come() -> None:
    """An environment without possible agents has those that have been seen."""
    env = to_aec(generated_agents_parallel_v0.parallel_env())
    env.reset(seed=1)
    for agent in env.agent_iter(500):
        assert set(env.agents) <= set(env.possible_agents)
        _, _, terminated, truncated, _ = env.last()
        env.step(None if terminated or truncated else int(env.action_space(agent).sample()))
    assert len(env.possible_agents) > 5


def test_late_joiners_begin_with_a_first_turn() -> None:
    """Who joins has a turn in the next tick, with what the tick before gave it."""
    env = ToAEC(Ticks(2, [Round(((2, 5.0),), (), 1, 0), QUIET]))
    env.reset()
    env.step(0)
    env.step(0)
    assert env.touched.joined == [NAMES[2]]
    seen = {}
    for agent in env.agent_iter(3):
        seen[agent] = env.last()[1]
        env.step(0)
    assert seen == {NAMES[0]: 0.0, NAMES[1]: 0.0, NAMES[2]: 5.0}
