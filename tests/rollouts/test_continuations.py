"""Continuations of a recorded episode, by copies and by replays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from pettingzoo import ParallelEnv

from gamekeeper.contract import Contract
from gamekeeper.errors import EvidenceError
from gamekeeper.interface.generators import is_same_state
from gamekeeper.rollouts.continuations import Continuations, RecordedEpisode
from gamekeeper.rollouts.episode_loop import EpisodePlan, perform
from gamekeeper.runs.recording import joint_policy_of


class Walk(ParallelEnv):
    """Two walkers add up their steps and a draw, for six ticks."""

    metadata = {"name": "walk_v0"}  # noqa: RUF012  # as PettingZoo has it
    possible_agents = ["a", "b"]  # noqa: RUF012  # likewise
    shared = 0

    def __init__(self, *, refuses: bool = False, leaks: bool = False) -> None:
        self.refuses, self.leaks = refuses, leaks

    def observation_space(self, agent: str) -> Discrete:
        return Discrete(1000)

    def action_space(self, agent: str) -> Discrete:
        return Discrete(3)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.total, self.time = list(self.possible_agents), 0, 0
        Walk.shared = 0
        self.rng = np.random.default_rng(seed)
        return dict.fromkeys(self.agents, 0), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        Walk.shared += 1
        self.time += 1
        self.total += sum(int(each) for each in actions.values()) + int(self.rng.integers(3))
        seen = self.total + (100 * Walk.shared if self.leaks else 0)
        live, over = self.agents, self.time == 6
        self.agents = [] if over else live
        infos = {agent: {"total": self.total} for agent in live}
        return (
            dict.fromkeys(live, seen % 1000),
            dict.fromkeys(live, float(self.total)),
            dict.fromkeys(live, over),
            dict.fromkeys(live, False),
            infos,
        )

    def __deepcopy__(self, memo: Any) -> Walk:
        if self.refuses:
            raise TypeError("no copies")
        copied = Walk(leaks=self.leaks)
        copied.__dict__.update(self.__dict__)
        copied.rng = np.random.default_rng()
        copied.rng.bit_generator.state = self.rng.bit_generator.state
        memo[id(self)] = copied
        memo[id(self.rng)] = copied.rng
        copied.agents = list(self.agents)
        return copied


class Counting:
    """A policy that remembers how often it was asked."""

    def __init__(self) -> None:
        self.asked = 0

    def reset(self, seed: int) -> None:
        self.asked = 0

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        self.asked += 1
        return (self.asked + int(rng.integers(2))) % 3


def continuations(env: Any, policy: Any, **settings: Any) -> Continuations:
    """Continuations of an episode that was just played."""
    joint_policy = joint_policy_of(policy, env, None)
    played = perform(EpisodePlan(seed=3), env, joint_policy=joint_policy, policy_seed=5)
    base = RecordedEpisode(played.play, env, joint_policy, 5, Contract(), 1000)
    return Continuations(base, budget=10_000, **settings)


@pytest.mark.parametrize("policy", ["random", Counting()], ids=["random", "remembers"])
def test_continuations_by_copies_are_those_by_replays(policy: Any) -> None:
    """The same numbers give the same outcomes, whichever way, and other numbers others."""
    by_copies = continuations(Walk(), policy)
    by_replays = continuations(Walk(), policy, copies=False)
    assert (by_copies.by_copies, by_replays.by_copies) == (True, False)
    for turn in (4, 0, 2):
        one, two = (each.play(turn, range(6)) for each in (by_copies, by_replays))
        assert one == two
        assert len({outcome.infos["a"]["total"] for outcome in one}) > 1
    assert by_copies.steps < by_replays.steps


def test_continuations_at_the_end_are_the_recording() -> None:
    """From the last turn nothing is left to be drawn."""
    found = continuations(Walk(), "random")
    assert [found.recorded] * 2 == found.play(6, [1, 2])


def test_continuations_hold_the_actions_that_are_given() -> None:
    """Held actions are played at the turn; agents that aren't named choose theirs."""
    found = continuations(Walk(), "random")
    low, high = (found.play(5, range(8), held={"a": a, "b": a}) for a in (0, 2))
    sums = [[each.infos["a"]["total"] for each in outcomes] for outcomes in (low, high)]
    assert [each + 4 for each in sums[0]] == sums[1]


@pytest.mark.parametrize("fault", ["refuses", "leaks"])
def test_continuations_go_by_replays_where_copies_fail(fault: str) -> None:
    """An environment that refuses copies, or shares state with them, is played again instead."""
    found = continuations(Walk(**{fault: True}), "random")
    assert not found.by_copies
    assert len(found.play(3, range(4))) == 4


def test_continuations_stop_at_the_budget() -> None:
    """No continuation begins once the budget is spent."""
    found = continuations(Walk(), "random")
    found.budget = found.steps + 12
    assert len(found.play(0, range(10))) == 2


def test_continuations_refuse_an_episode_that_plays_otherwise() -> None:
    """A turn that doesn't come out as it did before is told."""
    found = continuations(Walk(), "random", copies=False)
    found.play(3, [1])
    found.base.env.reset = lambda seed=None, options=None: Walk.reset(found.base.env, 7)
    with pytest.raises(EvidenceError, match="doesn't play twice"):
        found.play(3, [1])


class Jamming:
    """A policy without a `reset`: at its third call of an episode it jams, four times of five."""

    calls, is_jammed = 0, False

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        self.calls = self.calls + 1 if info else 0
        self.is_jammed = self.calls >= 4 and (self.is_jammed or bool(rng.random() < 0.8))
        return 0 if self.is_jammed else 2


_jammed: dict[str, Any] = {}


def jams(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """`Jamming` as a function, whose memory stands in its module."""
    policy = _jammed[agent] if info else _jammed.setdefault(agent, Jamming())
    _jammed[agent] = policy
    return policy(observation, agent, info, rng)


def runs_on(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Counts its calls, and goes on counting in the next episode."""
    _jammed["calls"] = _jammed.get("calls", 0) + 1
    return int(_jammed["calls"] > 8)


@pytest.mark.parametrize("kind", ["object", "module"])
def test_continuations_begin_with_the_memory_of_their_turn(kind: str) -> None:
    """Without a reset, too: in an object by copies, in a module by playing from the reset."""
    found = continuations(Walk(), {"*": "random", "a": Jamming() if kind == "object" else jams})
    assert found.by_copies == (kind == "object")
    found.play(0, range(3))
    for turn in (0, 5, 3):
        alone = continuations(Walk(), {"*": "random", "a": Jamming()}, copies=False)
        assert alone.play(turn, range(4)) == found.play(turn, range(4))


def test_continuations_refuse_a_memory_that_outlives_an_episode() -> None:
    """A function that goes on counting can't be brought back to what it was at a turn."""
    with pytest.raises(EvidenceError, match="doesn't choose again"):
        continuations(Walk(), {"*": "random", "a": runs_on})


def test_continuations_hold_an_action_and_what_its_policy_remembers() -> None:
    """The policy of a held action has jammed on the recorded draws, whatever is drawn later."""
    found = continuations(Walk(), {"*": "random", "a": Jamming()})
    jams_at = [actions["a"] for actions in found.base.actions].index(0)
    held = dict(found.base.actions[jams_at])
    later = [episode.taken[-1]["a"] for episode in found._played(jams_at, range(8), held)]
    assert later == [0] * 8


def test_states_of_generators_are_compared_by_what_they_hold() -> None:
    """States of one draw are equal, of another not, also in lists of them."""
    one, two = ([np.random.RandomState(seed).get_state(legacy=True)] for seed in (3, 3))
    assert is_same_state(one, two)
    other = np.random.RandomState(3)
    other.normal()
    assert not is_same_state(one, [other.get_state(legacy=True)])
