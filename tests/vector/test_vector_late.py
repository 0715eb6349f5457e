"""Agents that join late, of other spaces, with masks that come and go; seeds of episodes."""

from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import gamekeeper as gk
from gamekeeper.randomness.seeds import EpisodeSeeds, episode_seed
from gamekeeper.vector import make
from tests.vector import worlds

HERE = worlds.__file__


@given(st.integers(0, 2**200), st.integers(0, 2**40))
def test_episode_seeds_are_those_of_rollouts(run_seed: int, episode: int) -> None:
    """The short way gives the same as the long one."""
    assert EpisodeSeeds(run_seed)[episode] == episode_seed(run_seed, episode)


def test_agents_join_late() -> None:
    """Who hasn't joined is not live and holds zeros; from its tick on it is like the others."""
    with make(f"{HERE}:Late", 3) as venv:
        _obs, infos = venv.reset(seed=1)
        env = gk.make(f"{HERE}:Late")
        env.reset(seed=episode_seed(1, 2))
        assert venv.agents == {"scout": ["scout_0", "scout_1"], "cook": ["cook"]}
        for _ in range(9):
            assert live_of(infos, 2) == set(env.agents)
            actions = {name: (mask > 0).argmax(-1) for name, mask in infos["action_mask"].items()}
            obs, rewards, *_, infos = venv.step(actions)
            expected, paid, *_, told = env.step(
                {agent: action_of(venv, actions, agent) for agent in env.agents}
            )
            for role, agents in venv.agents.items():
                for a, agent in enumerate(agents):
                    assert np.array_equal(
                        obs[role][2, a], expected.get(agent, np.zeros_like(obs[role][2, a]))
                    )
                    assert rewards[role][2, a] == paid.get(agent, 0.0)
                    mask = told.get(agent, {"action_mask": [0] * 3}).get("action_mask", [1] * 3)
                    assert infos["action_mask"][role][2, a].tolist() == list(mask)
        assert live_of(infos, 2) == {"scout_0", "scout_1", "cook"}


def live_of(infos: dict[str, Any], e: int) -> set[str]:
    """Who lives in a copy."""
    names = {"scout": ["scout_0", "scout_1"], "cook": ["cook"]}
    return {
        agent
        for role, agents in names.items()
        for agent, is_live in zip(agents, infos["live"][role][e], strict=True)
        if is_live
    }


def action_of(venv: Any, actions: dict[str, Any], agent: str) -> int:
    """One agent's action in the last copy."""
    role = "cook" if agent == "cook" else "scout"
    return int(actions[role][2, venv.agents[role].index(agent)])


def test_turns_of_late_agents_with_other_spaces() -> None:
    """The arrays of the role whose turn it is hold what it sees; the other role's hold zeros."""
    with make(f"{HERE}:LateTurns", 2, autoreset="next_step") as venv:
        obs, infos = venv.reset(seed=3)
        env = gk.make(f"{HERE}:LateTurns")
        env.reset(seed=episode_seed(3, 0))
        names, turns = ["scout", "cook"], []
        while env.agents:
            agent = env.agent_selection
            turns.append(agent)
            assert names[infos["turn"][0]] == agent
            seen, other = env.observe(agent), "cook" if agent == "scout" else "scout"
            assert np.array_equal(obs[agent][0], seen)
            assert not np.any(obs[other][0])
            actions = {"scout": np.full(2, 2), "cook": np.full((2, 1), 0.5, np.float32)}
            obs, rewards, terminated, truncated, infos = venv.step(actions)
            env.step(actions[agent][0] if agent == "cook" else 2)
            assert rewards[agent][0] == env.rewards[agent]
            while env.agents and env.agent_selection in env.endings:
                env.step(None)
        assert {"scout", "cook"} == set(turns)
        assert terminated["cook"][0] or truncated["scout"][0]
        assert sorted(infos["final_info"][0]) == ["cook", "scout"]
        assert infos["episode"][0] == 0
        infos = venv.step(actions)[-1]
        assert infos["episode"][0] == 2
        assert infos["live"]["scout"][0].tolist() == [True]
        assert infos["live"]["cook"][0].tolist() == [False]
