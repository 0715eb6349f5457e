"""Small games for changes: what agents are shown and may do is of every common form."""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space, Text, Tuple

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.interface.conversion import to_aec
from gamekeeper.rollouts.episode_loop import EpisodePlan, EpisodeResult, perform
from gamekeeper.rollouts.intervention import Intervention
from gamekeeper.runs.recording import joint_policy_of

TURNS = 12
SPACES: dict[str, Space[Any]] = {
    "box": Box(np.float32([-1, 0, -np.inf]), np.float32([1, 10, np.inf])),
    "whole": Box(0, 255, (2, 2), np.uint8),
    "discrete": Discrete(7, start=-2),
    "flags": MultiBinary(3),
    "several": MultiDiscrete([3, 4], start=[1, 1]),
    "dict": Dict(
        {
            "action_mask": MultiBinary(4),
            "goal": Discrete(5),
            "name": Text(5),
            "sight": Tuple(
                (Box(-1.0, 1.0, (2,), np.float64), Box(-np.inf, np.inf, (), np.float64))
            ),
        }
    ),
}
ACTIONS: dict[str, Space[Any]] = {
    "discrete": Discrete(4),
    "several": MultiDiscrete([3, 4]),
    "box": Box(np.float32([-1, 0]), np.float32([1, 5])),
    "dict": Dict({"move": Box(-2.0, 2.0, (2,), np.float64), "word": Discrete(3)}),
}


class Shown(gk.TickEnv):
    """Three agents are shown numbers that their seed and tick settle, whatever they do."""

    metadata = {"name": "shown_v0"}  # noqa: RUF012 - PettingZoo's form

    def __init__(self, see: str = "box", do: str = "discrete", render_mode: Any = None) -> None:
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["a_0", "a_1", "b_0"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, SPACES[see])
        self.action_spaces = dict.fromkeys(self.possible_agents, ACTIONS[do])
        self.see = see

    def start(self, rng: Any, options: Any) -> None:
        self.seed, self.tick_number = rng.integers(1000), 0

    def tick(self, actions: Any) -> None:
        self.tick_number += 1
        for agent in list(self.agents):
            self.add_reward(agent, float(self.tick_number))
            if self.tick_number >= TURNS:
                self.truncate(agent, "time")

    def observe(self, agent: Any) -> Any:
        number = self.seed + 10 * self.tick_number + self.possible_agents.index(agent)
        seen = shown(SPACES[self.see], number)
        return seen if self.see != "dict" else {**seen, "action_mask": masked(self.tick_number)}

    def mask(self, agent: Any) -> Any:
        return masked(self.tick_number) if isinstance(self.action_spaces[agent], Discrete) else None


def masked(tick: int) -> Any:
    """Two of four actions are legal, others at every tick."""
    mask = np.zeros(4, np.int8)
    mask[[tick % 4, (tick + 1) % 4]] = 1
    return mask


def shown(space: Space[Any], number: int) -> Any:
    """A value of a space that a number settles."""
    rng = np.random.default_rng(number)
    if isinstance(space, Dict):
        return {key: shown(part, number) for key, part in space.spaces.items()}
    if isinstance(space, Tuple):
        return tuple(shown(part, number) for part in space.spaces)
    if isinstance(space, Box):
        low, high = (np.clip(x.astype(np.float64), -3, 255) for x in (space.low, space.high))
        return np.asarray(low + (high - low) * rng.random(space.shape)).astype(space.dtype)
    if isinstance(space, Discrete):
        return np.int64(space.start + rng.integers(space.n))
    if isinstance(space, MultiDiscrete):
        return (space.start + rng.integers(space.nvec)).astype(space.dtype)
    if isinstance(space, MultiBinary):
        return rng.integers(0, 2, space.shape).astype(np.int8)
    return "abc"[: number % 3 + 1]


CONTRACT = Contract.from_json(
    {"roles": {"a": {"agents": ["a_*"], "noop": 2}, "b": {"agents": ["b_*"]}}}
)


class Spy:
    """A joint policy that keeps what it is shown."""

    def __init__(self, joint_policy: Any) -> None:
        self.joint_policy, self.shown = joint_policy, []

    def begin(self, seed: int, episode: int) -> None:
        self.joint_policy.begin(seed, episode)

    def act(self, agent: Any, observation: Any, info: Any) -> Any:
        self.shown.append((agent, observation))
        return self.joint_policy.act(agent, observation, info)


def played(
    env: Any, change: Intervention | None, contract: Contract | None = CONTRACT, *, seed: int = 3
) -> tuple[EpisodeResult, list[tuple[Any, Any]]]:
    """An episode by the random policy, and what that was shown."""
    spy = Spy(joint_policy_of("random", env, contract))
    play = EpisodePlan(seed=seed, stream=seed)
    done = perform(play, env, joint_policy=spy, change=change, contract=contract)
    assert done.failed is None, done.failed
    return done, spy.shown


def as_aec(env: Any) -> Any:
    """The same game, one agent at a time."""
    return to_aec(env)


def rows(done: EpisodeResult) -> Any:
    """What the evidence keeps: for each turn what was given, and what was done."""
    return [(turn.observations, turn.actions, turn.rewards) for turn in done.episode.turns]
