"""An AEC environment behind the Parallel interface."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from hypothesis import given
from hypothesis import strategies as st
from pettingzoo.classic import tictactoe_v3
from pettingzoo.test import parallel_api_test, parallel_seed_test
from pettingzoo.utils import wrappers
from pettingzoo.utils.conversions import aec_to_parallel

from gamekeeper.errors import ActionError
from gamekeeper.interface.conversion import to_parallel
from gamekeeper.interface.to_parallel import ToParallel
from tests.interface.relays import FinedTurnTickets, TurnRelay, TurnTickets
from tests.interface.ticking import (
    NAMES,
    SCRIPTS,
    Given,
    Round,
    Rows,
    Turns,
    aec_rows,
    parallel_rows,
    plain,
)

QUIET = Round((), (), 0, 0)


def by_agent(rows: Rows) -> Rows:
    """The same rows, those of a tick in the order of the names; endings after the turns."""
    return [sorted(tick, key=lambda row: (row[2] is None, row[0])) for tick in rows]


def by_sight(agent: str, given: Given) -> int:
    """An action that hangs on the observation alone."""
    return int(given[0][2] + NAMES.index(agent)) % 4


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_to_parallel_gives_everybody_what_last_gives(
    n: int, script: list[Round], seed: int
) -> None:
    """Where all changes with a round's last turn, each row equals, whatever order rounds have."""
    expected = plain(by_agent(aec_rows(Turns(n, script), seed)))
    assert expected == plain(by_agent(parallel_rows(ToParallel(Turns(n, script)), seed)))


@given(st.integers(1, 6), SCRIPTS, st.integers(0, 9))
def test_deaths_in_mid_round_lose_nothing(n: int, script: list[Round], seed: int) -> None:
    """All that the rules played and paid, and the last words of the dying, are those of the AEC."""
    aec, parallel = Turns(n, script, hasty=True), ToParallel(Turns(n, script, hasty=True))
    theirs = aec_rows(aec, seed, by_sight)
    ours = parallel_rows(parallel, seed, by_sight)
    assert (aec.past, aec.time) == (parallel.env.past, parallel.env.time)
    assert last_words(theirs) == last_words(ours)
    assert returns(theirs) == pytest.approx(returns(ours))


def last_words(rows: Rows) -> list[Any]:
    """Observation, flags and info of everybody's end, in order of the names."""
    ends = [
        (agent, got[0].tolist(), *got[2:])
        for tick in rows
        for agent, got, action in tick
        if action is None
    ]
    return sorted(ends, key=lambda end: end[0])


def returns(rows: Rows) -> dict[str, float]:
    """The sum of what everybody was given."""
    sums: dict[str, float] = {}
    for tick in rows:
        for agent, got, _ in tick:
            sums[agent] = sums.get(agent, 0.0) + got[1]
    return sums


@given(st.integers(1, 5), SCRIPTS, st.booleans())
def test_dictionaries_are_new_and_of_the_same_agents(
    n: int, script: list[Round], hasty: bool
) -> None:
    """What a step returned is never changed by the next one, and no list or book is shared."""
    env = ToParallel(Turns(n, script, hasty=hasty))
    env.reset()
    kept: list[Any] = []
    while env.agents:
        assert env.agents is not env.env.agents
        out = env.step(dict.fromkeys(env.agents, 1))
        assert [dict] * 5 == [type(part) for part in out]
        for part in out[1:]:
            assert part not in (env.env.rewards, env.env.infos) or part is not env.env.rewards
        kept.append((out[1:], copy.deepcopy(out[1:])))
    assert all(then == now for then, now in kept)


@given(st.integers(1, 5), SCRIPTS, st.integers(0, 4))
def test_copies_of_a_converted_environment_go_on_alike(
    n: int, script: list[Round], ticks: int
) -> None:
    """A deep copy and a pickled one episode the same rest."""
    env = ToParallel(Turns(n, script, hasty=True))
    env.reset(seed=1)
    for _ in range(ticks):
        env.step(dict.fromkeys(env.agents, 2))
    counterfactuals = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    assert [rest(env)] * 2 == [rest(counterfactual) for counterfactual in counterfactuals]


class Payers(Turns):
    """A fixed order; turns pay as a generator says: the actor, everybody, or what stands."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self.rng = np.random.default_rng(seed)
        super().reset(seed, options)

    def step(self, action: Any) -> None:
        actor, before = self.agent_selection, dict(self.rewards)
        super().step(action)
        if self.truncations.get(actor, True):
            return
        way = self.rng.integers(4)
        if way == 0:
            self.rewards = {agent: float(self.rng.normal()) for agent in self._shuffled()}
        elif way == 1:
            self.rewards = before
        else:
            self.rewards[actor] = float(self.rng.normal())

    def _shuffled(self) -> list[str]:
        return [str(agent) for agent in self.rng.permutation(self.agents)]

    def _order(self, agents: list[str]) -> list[str]:
        return list(agents)


@given(st.integers(1, 10), st.integers(1, 8), st.integers(0, 2**32))
def test_what_turns_pay_adds_up_to_the_last_digit_as_pettingzoo_adds(
    n: int, ticks: int, seed: int
) -> None:
    """However many a turn pays, and in whatever order it lists them, the sums are bit for bit."""
    script = [QUIET] * ticks
    ours, theirs = ToParallel(Payers(n, script)), aec_to_parallel(Payers(n, script))
    ours.reset(seed=seed)
    theirs.reset(seed=seed)
    while theirs.agents:
        actions = dict.fromkeys(theirs.agents, 1)
        assert dict(theirs.step(actions)[1]) == ours.step(actions)[1]


def rest(env: ToParallel) -> str:
    """All that is given from here to the end."""
    seen = []
    while env.agents:
        seen.append(env.step(dict.fromkeys(env.agents, 3)))
    return repr(seen)


# -- over our own base class


def test_relay_pays_the_sum_of_a_round() -> None:
    """Rewards, terms, flags and observations of a round of our own base class."""
    env, aec = to_parallel(TurnRelay(), order="as declared"), TurnRelay()
    env.reset(seed=4, options={"goal": 2})
    aec.reset(seed=4, options={"goal": 2})
    ticks = 0
    while env.agents:
        sums = dict.fromkeys(env.agents, 0.0)
        terms = {}
        acting = env.agents
        out = env.step(dict.fromkeys(env.agents, 2))
        for agent in acting:
            aec.step(2)
            for name in sums:
                sums[name] += aec.rewards.get(name, 0.0)
            terms |= {name: {} for name in aec.terms}
            if agent in aec.endings:
                assert out[0][agent].tolist() == aec.observe(agent).tolist()
                aec.step(None)
        assert pytest.approx(sums) == out[1]
        assert set(terms) == set(env.terms)
        assert {name: name in aec.endings for name in sums} == out[2]
        ticks += 1
    assert ticks > 1
    assert aec.agents == []


def test_masks_and_infos_of_a_round_are_new() -> None:
    """Our own base class tells infos one by one; here everybody has what holds now."""
    env = to_parallel(TurnTickets(), order="as declared")
    observations, infos = env.reset(seed=0)
    assert [infos[agent]["action_mask"].tolist() for agent in env.agents] == [[1, 1, 1, 1]] * 2
    observations, _, _, _, infos = env.step({"taker_0": 5, "taker_1": 7})
    for agent in env.agents:
        assert infos[agent]["action_mask"].tolist() == [0, 1, 0, 1]
        assert observations[agent]["action_mask"].tolist() == [0, 1, 0, 1]
        assert infos[agent]["free"] == 2


def test_masked_out_action_is_refused_before_anything_is_played() -> None:
    """All actions of a tick are looked at first; a rule for illegal ones is left to itself."""
    env = to_parallel(TurnTickets(), order="as declared")
    env.reset(seed=0)
    env.step({"taker_0": 5, "taker_1": 7})
    with pytest.raises(ActionError, match="'taker_1' did what is masked out"):
        env.step({"taker_0": 6, "taker_1": 5})
    assert env.env.free == [False, True, False, True]
    fined = to_parallel(FinedTurnTickets(), order="as declared")
    fined.reset(seed=0)
    assert fined.step({"taker_0": 5, "taker_1": 5})[1] == {"taker_0": 0.0, "taker_1": -1.0}


# -- one turn a tick


def test_style_turn_plays_one_turn() -> None:
    """Everybody is told of each turn; who isn't in turn needs no action; five values to the end."""
    env, aec = to_parallel(tictactoe_v3.raw_env(), style="turn"), tictactoe_v3.raw_env()
    observations, infos = env.reset(seed=0)
    aec.reset(seed=0)
    for cell in (0, 3, 1, 4, 2):
        actor = aec.agent_selection
        assert [actor] == env.to_move
        assert sum(observations[actor]["action_mask"]) > 0
        aec.step(cell)
        observations, rewards, terminations, truncations, infos = env.step({actor: cell})
        assert (aec.rewards, aec.terminations) == (rewards, terminations)
        assert (aec.truncations, aec.infos) == (truncations, infos)
        for agent in aec.agents:
            seen = aec.observe(agent)["observation"].tolist()
            assert seen == observations[agent]["observation"].tolist()
    assert (rewards, env.agents) == ({"player_1": 1, "player_2": -1}, [])
    assert env.to_move == []
    assert env.step({}) == ({},) * 5


def test_style_turn_looks_at_one_action() -> None:
    """The agent in turn needs one in its space, of others nothing is asked but that they live."""
    env = to_parallel(Turns(3, [QUIET] * 3), style="turn")
    env.reset()
    for actions in ({}, {"agent_1": 0}, {"agent_0": 9}, {"agent_0": 0, "agent_5": 0}, None):
        with pytest.raises(ActionError):
            env.step(actions)
    env.step({"agent_0": 0, "agent_1": None})
    assert env.to_move == ["agent_1"]


# -- what else is kept


def test_to_parallel_hands_on_spaces_state_and_picture() -> None:
    """Through PettingZoo's wrappers too, whose books are read where they are kept."""
    inner = TurnRelay(render_mode="ansi")
    env: Any = to_parallel(wrappers.OrderEnforcingWrapper(inner), order="as declared")
    agent = env.possible_agents[1]
    assert inner.observation_spaces[agent] is env.observation_space(agent)
    assert inner.action_spaces[agent] is env.action_spaces[agent]
    assert inner.state_space is env.state_space
    assert (env.render_mode, str(env), env.unwrapped) == ("ansi", "relay_v0", inner)
    env.reset(seed=1)
    assert inner.render() == env.render()
    assert inner.state().tolist() == env.state().tolist()


class Pays(Turns):
    """Pays what is no float."""

    amount: Any = None

    def _accumulate_rewards(self) -> None:
        self.rewards = dict.fromkeys(self.agents, self.amount)


@pytest.mark.parametrize("amount", [np.array([1.0, 2.0]), 3, np.float32(0.1), 0])
def test_rewards_keep_their_kind(amount: Any) -> None:
    """Arrays of several objectives are added as arrays, whole numbers stay whole."""
    env = to_parallel(Pays(3, [QUIET] * 2))
    env.env.amount = amount
    env.reset()
    rewards = env.step(dict.fromkeys(env.agents, 0))[1]
    assert [type(amount)] * 3 == [type(reward) for reward in rewards.values()]
    assert np.array_equal(amount + amount + amount, rewards["agent_1"])


def test_parallel_environment_stays_what_it_is() -> None:
    """No second conversion."""
    env = to_parallel(Turns(2, [QUIET]))
    assert to_parallel(env) is env


# -- PettingZoo's tests


class Ready(TurnRelay):
    """Says that it can be played all at once."""

    metadata = {**TurnRelay.metadata, "is_parallelizable": True}  # noqa: RUF012


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    "make",
    [
        Ready,
        lambda: Turns(4, [QUIET] * 9),
        lambda: Turns(4, [Round(((0, 1.0),), ((1, True),), 1, 3)] * 9, hasty=True),
    ],
)
def test_converted_environment_passes_the_tests_of_pettingzoo(make: Any) -> None:
    """The Parallel API test, and where the environment itself does, the seed test."""
    parallel_api_test(to_parallel(make()), num_cycles=60)
    if make is Ready:
        parallel_seed_test(lambda: to_parallel(make()), num_cycles=20)


def test_one_agent_may_end_the_other_before_its_turn() -> None:
    """The action of who is dead by then isn't played, and its last words are told."""

    class Duel(TurnRelay):
        def act(self, agent: str, action: int) -> None:
            for each in self.agents:
                if each != agent:
                    self.terminate(each, "shot")
                    self.add_reward(each, -1.0)

    env = to_parallel(Duel(2), order="as declared")
    env.reset(seed=0)
    _, rewards, terminations, _, _ = env.step({"runner_0": 0, "runner_1": 0})
    assert rewards == {"runner_0": 0.0, "runner_1": -1.0}
    assert terminations == {"runner_0": False, "runner_1": True}
    assert env.agents == ["runner_0"]


def test_action_spaces_of_joiners_are_learnt() -> None:
    """Who joins is checked against its own space from its first action on."""
    env = to_parallel(Turns(1, [Round((), (), 1, 0), QUIET]))
    env.reset()
    env.step({"agent_0": 0})
    assert Discrete(4) == env.action_space("agent_1")
    with pytest.raises(ActionError, match="'agent_1'"):
        env.step({"agent_0": 0, "agent_1": 4})
