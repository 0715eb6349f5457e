"""RLlib's own book of an episode, and environments that its tests play."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

import gamekeeper as gk


def made(spec: object, **options: Any) -> Any:
    """Without an audit, which has tests of its own."""
    from gamekeeper.adapters import rllib

    return rllib.multi_agent_env(spec, check=None, **options)


def episode_of(env: Any) -> Any:
    """RLlib's own book of an episode, to be written as its env runner writes it."""
    from ray.rllib.env.multi_agent_episode import MultiAgentEpisode

    return MultiAgentEpisode(
        observation_space=env.observation_spaces,
        action_space=env.action_spaces,
        agent_to_module_mapping_fn=lambda agent, episode: "one",
    )


def first_legal(env: Any, agent: str, observation: Any) -> Any:
    """The first action that the mask allows; the last of all where there is none."""
    if isinstance(observation, dict) and "action_mask" in observation:
        return int(np.argmax(observation["action_mask"]))
    return int(env.action_spaces[agent].n) - 1


def played(env: Any, choose: Any = first_legal, *, seed: int | None = None) -> Any:
    """One episode through RLlib's book, which refuses what it can't keep; the book."""
    observations, infos = env.reset(seed=seed)
    book = episode_of(env)
    book.add_env_reset(observations=observations, infos=infos)
    to_act, most = list(observations), 2_000
    while not book.is_done:
        assert set(to_act) == book.get_agents_to_act()
        actions = {agent: choose(env, agent, observations[agent]) for agent in to_act}
        observations, rewards, terms, truncs, infos = env.step(actions)
        book.add_env_step(
            observations, actions, rewards, infos, terminateds=terms, truncateds=truncs
        )
        assert book.is_done == (terms["__all__"] or truncs["__all__"])
        to_act = [a for a in observations if not (terms[a] or truncs[a])]
        most -= 1
        assert most, "no end"
    return book


def config(spec: str, **options: Any) -> Any:
    """PPO with small networks, all in this process."""
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from gamekeeper.adapters import rllib

    name = rllib.register(spec, check=None, seed=3, **options)
    net = DefaultModelConfig(fcnet_hiddens=[16])
    return (
        PPOConfig()
        .environment(name)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=2, rollout_fragment_length=7)
        .multi_agent(**rllib.policy_mapping(spec, **options))
        .rl_module(rl_module_spec=rllib.modules(spec, model_config=net, **options))
        .training(train_batch_size_per_learner=120, minibatch_size=60, num_epochs=1)
        .callbacks(rllib.ReturnsCallback)
        .debugging(seed=0)
    )


def noted_steps(monkeypatch: pytest.MonkeyPatch) -> dict[Any, list[Any]]:
    """By copy, episode and agent: each action that the adapter gets, with its pay."""
    from gamekeeper.adapters.rllib import rllib_env as room

    done: dict[Any, list[Any]] = {}
    step = room.AgentsEnv.step

    def noted(self: Any, actions: Any) -> Any:
        out = step(self, actions)
        key = (id(self), self.episode)
        for agent, action in actions.items():
            done.setdefault((*key, agent), []).append([int(action), None])
        for agent, reward in out[1].items():
            if (*key, agent) in done:
                done[*key, agent][-1][1] = float(reward)
        return out

    monkeypatch.setattr(room.AgentsEnv, "step", noted)
    return done


class FirstLegal:
    """The policy of `first_legal`."""

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        mask = info.get("action_mask")
        if isinstance(observation, dict):
            mask = observation.get("action_mask", mask)
        return LAST[str(agent).split("_")[0]] if mask is None else int(np.argmax(mask))


LAST = {"picker": 2, "carrier": 2, "adversary": 4, "agent": 4}
"""The last action of those who have no mask."""


def bare(observation: Any) -> Any:
    """An observation without its mask."""
    if isinstance(observation, dict):
        return observation.get("observation", observation.get("observations"))
    return observation


class Ends(gk.TickEnv):
    """Agents end by a plan {agent: (tick, "term" | "trunc")}; some join at a tick of `joins`."""

    metadata = {"name": "ends_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, plan: Any, joins: Any = None, render_mode: Any = None) -> None:
        super().__init__(render_mode=render_mode)
        self.plan, self.joins = plan, joins or {}
        self.possible_agents = list(plan)
        self.observation_spaces = {a: Box(0, 99, (1,), np.float32) for a in plan}
        self.action_spaces = {a: Discrete(2, start=3) for a in plan}

    def start(self, rng: Any, options: Any) -> None:
        self.tick_count = 0
        self.chosen: list[Any] = []
        self.agents = [a for a in self.possible_agents if a not in self.joins]

    def tick(self, actions: Any) -> None:
        self.tick_count += 1
        self.chosen += list(actions.values())
        for agent, at in self.joins.items():
            if at == self.tick_count:
                self.join(agent)
        for agent in actions:
            self.add_reward(agent, 1.0)
            at, how = self.plan[agent]
            if at == self.tick_count:
                (self.terminate if how == "term" else self.truncate)(agent, "plan")

    def observe(self, agent: Any) -> Any:
        return np.array([self.tick_count], np.float32)


class Returns(ParallelEnv):
    """`a` ends at tick 1 and lives again at tick 2."""

    metadata = {"name": "returns_v0"}  # noqa: RUF012  # as PettingZoo has it
    possible_agents = ["a", "b"]  # noqa: RUF012  # likewise

    def observation_space(self, agent: Any) -> Any:
        return Box(0, 9, (1,), np.float32)

    def action_space(self, agent: Any) -> Any:
        return Discrete(2)

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        self.agents, self.ticks = ["a", "b"], 0
        return self.seen(["a", "b"]), {"a": {}, "b": {}}

    def seen(self, agents: Any) -> Any:
        return {agent: np.zeros(1, np.float32) for agent in agents}

    def step(self, actions: Any) -> Any:
        self.ticks += 1
        self.agents = ["b"] if self.ticks == 1 else ["a", "b"]
        told = sorted(set(actions) | set(self.agents))
        ends = {agent: agent not in self.agents for agent in told}
        paid, no = dict.fromkeys(told, 0.0), dict.fromkeys(told, False)
        return self.seen(told), paid, ends, no, {agent: {} for agent in told}
