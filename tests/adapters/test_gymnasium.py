"""Gymnasium's forms: one agent, all agents, every agent of many copies."""

from __future__ import annotations

import itertools
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import gamekeeper as gk
from gamekeeper.adapters.gymnasium import joint, single_agent, vector
from gamekeeper.errors import OrderError, SpecError
from gamekeeper.interface.policy import EVERYONE
from tests.adapters.streams import ByWhatIsSeen, Stream, bare, chosen, of_episode, same

SPREAD = "mpe2.simple_spread_v3:parallel_env"
WORLDS = str(Path(__file__).parent.parent / "vector" / "worlds.py")
SLOTS = str(Path(__file__).with_name("test_slots.py"))
FOUR = "pettingzoo.classic.connect_four_v3:env"


@pytest.mark.parametrize(
    ("spec", "agent"),
    [
        ("two_robot_line", "picker"),
        ("handover", "receiver_0"),
        ("warehouse", "carrier_0"),
        ("warehouse_turns", "picker_0"),
        ("reference", "agent_1"),
        ("tag", "adversary_0"),
        (SPREAD, "agent_2"),
        (f"{WORLDS}:Camp", "cook"),
        (f"{WORLDS}:Walk", "a"),
        (f"{WORLDS}:LateTurns", "cook"),
    ],
)
def test_single_agent_passes_gymnasiums_check(spec: str, agent: str) -> None:
    """Seeds, spaces, types: all that `check_env` looks at, of Parallel and of AEC."""
    env = single_agent(spec, agent, others="random")
    _check(env)
    env.close()


def _check(env: Any) -> None:
    """All of `check_env`: it samples without looking at masks; by this seed, what is legal."""
    env.action_space.seed(0)
    with warnings.catch_warnings():
        # what it thinks of a Box's bounds or of its own taste isn't about this wrapper
        warnings.filterwarnings("ignore", "(?s).*infinity|.*not symmetric|.*image", UserWarning)
        check_env(env, skip_render_check=True)


@pytest.mark.parametrize(
    ("spec", "agent", "others"),
    [
        ("two_robot_line", "picker", {"carrier": "greedy"}),
        ("warehouse", "picker_0", {"picker": "reference", "carrier": "reference"}),
        ("handover", "giver_0", "reference"),
        ("handover", "receiver_0", {"giver": "reference"}),
        (FOUR, "player_1", "random"),
        (f"{WORLDS}:Camp", "scout_0", "random"),
        (f"{WORLDS}:Late", "cook", "random"),
        (f"{WORLDS}:LateTurns", "cook", "random"),
        (f"{WORLDS}:Walk", "b", "random"),
    ],
)
def test_single_agent_shows_what_is_recorded(spec: str, agent: str, others: Any) -> None:
    """Observations, masks, actions, rewards by decision and end of the same episode."""
    env = single_agent(spec, agent, others=others)
    mine = ByWhatIsSeen(env.action_space)
    named = others if isinstance(others, dict) else {EVERYONE: others}
    played = gk.rollout(spec, policies={**named, agent: mine}, episodes=1, seed=3)
    recorded = of_episode(played.episodes[0], agent)
    assert recorded is not None
    recorded.before = 0.0  # lost, as its table says

    env._policies = _Began(
        env._policies, run=3
    )  # else the others draw as in a run of the episode's seed
    observation, info = env.reset(seed=int(played.episode_table.to_pylist()[0]["seed"]))
    stream = Stream()
    while True:
        mask = info.get("action_mask")
        mask = observation.get("action_mask", mask) if isinstance(observation, dict) else mask
        action = chosen(env.action_space, bare(observation), mask)
        stream.seen.append(bare(observation))
        stream.masks.append(None if mask is None else _flat(mask))
        stream.did.append(action)
        observation, reward, terminated, truncated, info = env.step(action)
        stream.paid.append(reward)
        if terminated or truncated:
            break
    stream.end, stream.final = (terminated, truncated), bare(observation)
    same(recorded, stream)
    env.close()


def _flat(mask: Any) -> Any:
    return np.concatenate(mask) if isinstance(mask, tuple) else mask


class _Began:
    """Policies that play episode 0 of a run, whatever they are told."""

    def __init__(self, policies: Any, run: int) -> None:
        self.act, self._policies, self._run = policies.act, policies, run

    def begin(self, seed: int, episode: int) -> None:
        self._policies.begin(self._run, episode)


def test_single_agent_names_who_has_no_policy() -> None:
    """Nobody is played by chance without being told."""
    with pytest.raises(SpecError, match="have no policy"):
        single_agent("two_robot_line", "picker")
    with pytest.raises(SpecError, match="have no policy"):
        single_agent("warehouse", "picker_0", others={"carrier": "reference"})
    with pytest.raises(SpecError, match="no agent called"):
        single_agent("two_robot_line", "pilot", others="random")


def test_single_agent_that_leaves_is_shown_its_last_observation() -> None:
    """It left without an ending: terminated, and there is no further step before a reset."""
    env = single_agent(f"{SLOTS}:Leaves", "a", others="random")
    first, _ = env.reset(seed=1)
    assert first == [1]
    following, *_ = env.step(0)
    assert following == [1]
    last, _, terminated, truncated, _ = env.step(0)
    assert (last.tolist(), terminated, truncated) == ([1], True, False)
    with pytest.raises(OrderError, match="reset"):
        env.step(0)
    env.close()


def test_single_agent_that_never_comes_is_refused() -> None:
    """A spare that nobody needs has nothing to decide, in any episode."""
    spare = gk.make("warehouse").possible_agents[-1]
    few = {"battery": 1_000, "horizon": 3}
    env = single_agent("warehouse", spare, others="noop", env_kwargs=few)
    with pytest.raises(SpecError, match="nothing to decide"):
        env.reset(seed=0)
    env.close()


def test_joint_shows_everybody_and_sums_rewards() -> None:
    """The sum is the reward, its parts stand in the info."""
    env = joint(SPREAD)
    _check(env)
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(25):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert sum(info["rewards"].values()) == pytest.approx(reward, abs=0)
    assert (terminated, truncated) == (False, True)
    assert set(observation) == set(map(str, env.agents))


@pytest.mark.parametrize("spec", ["two_robot_line", "warehouse", f"{WORLDS}:Walk"])
def test_joint_passes_gymnasiums_check(spec: str) -> None:
    """Masks, agents that end and join, continuous actions."""
    env = joint(spec)
    _check(env)
    env.close()


@pytest.mark.parametrize("spec", ["warehouse", f"{WORLDS}:Late", f"{WORLDS}:Camp"])
def test_joint_shows_what_is_recorded(spec: str) -> None:
    """Tick by tick: observations and rewards by agent, who lives, and how it ends."""
    env = joint(spec)
    policies = {a: ByWhatIsSeen(env.action_space[str(a)]) for a in env.agents}
    played = gk.rollout(spec, policies=policies, episodes=1, seed=4)
    turns = list(played.episodes[0].turns)
    observation, info = env.reset(seed=int(played.episode_table.to_pylist()[0]["seed"]))
    for now, then in itertools.pairwise(turns):
        for agent, seen in now.observations.items():
            if agent in now.live:
                assert str(seen) == str(observation[agent])
        assert [a in now.live for a in env.agents] == info["live"].tolist()
        action = {str(a): now.actions.get(a, env.action_space[str(a)].sample()) for a in env.agents}
        observation, reward, terminated, truncated, info = env.step(action)
        paid = {a: r for a, r in now.rewards.items() if r}
        assert paid == {a: r for a, r in info["rewards"].items() if r}
        assert sum(now.rewards.values()) == pytest.approx(reward)
        assert (terminated or truncated) == (then is turns[-1])
    assert terminated == any(turns[-1].terminated.values())
    env.close()


def test_joint_refuses_turns() -> None:
    """An AEC environment has no joint action, and there are two views."""
    with pytest.raises(SpecError, match="no joint action"):
        joint("handover")
    with pytest.raises(SpecError, match="no such view"):
        joint("two_robot_line", observe="all")
    with pytest.raises(SpecError, match="state_space"):
        joint(f"{WORLDS}:Camp", observe="state")


def test_joint_may_see_the_state() -> None:
    """A centralised controller is shown what `state()` gives."""
    env = joint("two_robot_line", observe="state")
    _check(env)
    state, _ = env.reset(seed=0)
    assert np.asarray(state).tolist() == [0, 4]


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_vector_counts_as_gymnasiums_own_wrapper_does(mode: Any) -> None:
    """Returns and lengths of every agent's episodes are those of the recorded run."""
    evidence = gk.rollout(SPREAD, policies=lambda *told: 0, episodes=4, seed=2)
    truth = [
        [
            sum(turn.rewards.get(agent, 0.0) for turn in episode.turns)
            for episode in evidence.episodes
        ]
        for agent in ("agent_0", "agent_1", "agent_2")
    ]
    venv = vector(SPREAD, 2, autoreset=mode, seed=2)
    assert venv.num_envs == 6
    assert venv.metadata["autoreset_mode"] in AutoresetMode
    counted = RecordEpisodeStatistics(venv)
    counted.reset()
    found: dict[int, list[float]] = {place: [] for place in range(6)}
    for _ in range(54):
        *_, infos = counted.step(np.zeros(6, int))
        for place in np.flatnonzero(infos.get("_episode", ())):
            assert infos["episode"]["l"][place] == 25
            found[int(place)].append(float(infos["episode"]["r"][place]))
    for place, returns in found.items():
        copy, agent = divmod(place, 3)
        np.testing.assert_allclose(returns, truth[agent][copy::2], rtol=1e-5)
    counted.close()


def test_vector_keeps_each_agents_own_end() -> None:
    """Terminated apart from truncated, the last observation beside it, seeds by run."""
    venv = vector(f"{WORLDS}:Walk", 3, seed=8, absent="zeros")
    obs, infos = venv.reset()
    again, _ = venv.reset(seed=8)
    assert np.array_equal(obs, again)
    assert infos["live"].all()
    fell = cut = 0
    venv.action_space.seed(0)
    for _ in range(40):
        obs, _, terminated, truncated, infos = venv.step(venv.action_space.sample())
        fell, cut = fell + terminated.sum(), cut + truncated.sum()
        assert not (terminated & truncated).any()
        assert not obs[~infos["live"] & ~terminated & ~truncated].any()
        ended = terminated | truncated
        assert np.array_equal(ended, infos.get("_final_obs", np.zeros_like(ended)))
        for place in np.flatnonzero(ended):
            assert infos["final_obs"][place].shape == (2,)
    assert fell
    assert cut
    venv.close()


def test_vector_refuses_who_ends_before_its_copy() -> None:
    """Gymnasium's wrappers would count the steps in between, and learners learn from them."""
    venv = RecordEpisodeStatistics(vector(f"{WORLDS}:Early", 2))
    venv.reset()
    for _ in range(3):
        venv.step(np.zeros(4, int))
    with pytest.raises(SpecError, match=r"copy 0, agent 'a'(.|\n)*absent='zeros'"):
        venv.step(np.zeros(4, int))
    venv.close()
    late = vector("warehouse", 1)
    with pytest.raises(SpecError, match="plays on"):
        late.reset()
    late.close()
    with pytest.raises(SpecError, match="refuse or zeros"):
        vector(f"{WORLDS}:Early", 2, absent="hidden")


@pytest.mark.parametrize("mode", ["same_step", "next_step"])
def test_vector_gives_who_ends_early_its_last_observation(mode: Any) -> None:
    """In the step that ended it, and nobody else's; then zeros until its copy begins anew."""
    venv = vector(f"{WORLDS}:Early", 1, absent="zeros", autoreset=mode)
    venv.reset()
    finals = []
    for step in range(1, 11):
        _, rewards, terminated, truncated, infos = venv.step(np.zeros(2, int))
        for place in np.flatnonzero(infos.get("_final_obs", ())):
            assert (terminated | truncated)[place]
            finals.append((step, int(place), float(infos["final_obs"][place][0]), rewards[place]))
        assert infos["live"][0] == (step < 4 or (step == 10 and mode == "same_step"))
    assert finals == [(4, 0, 4.0, 10.0), (10, 1, 10.0, 0.0)]
    venv.close()
