"""Small environments of other shapes, whose next number is plain arithmetic."""

from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, Tuple

FLOAT = Box(-10.0, 10.0, (2,), np.float32)


class Tuples(gymnasium.Env[Any, Any]):
    """Agents in tuples; each climbs by its action and is done at 3, everybody after `max_steps`."""

    metadata = {"render_modes": []}  # noqa: RUF012  # as Gymnasium declares it

    def __init__(
        self, agents: int = 2, max_steps: int = 6, ends: str = "one", pays: str = "list"
    ) -> None:
        self.n_agents, self.max_steps, self.ends, self.pays = agents, max_steps, ends, pays
        self.action_space = Tuple([Discrete(3)] * agents)
        self.observation_space = Tuple([FLOAT] * agents)
        self.heights, self.start, self.ticks = [0] * agents, 0, 0
        self.given: list[Any] = []

    def seen(self) -> tuple[Any, ...]:
        return tuple(np.array([self.start, h], np.float32) for h in self.heights)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.start = int(self.np_random.integers(10))
        self.heights, self.ticks = [0] * self.n_agents, 0
        return self.seen(), {}

    def step(self, action: Any) -> Any:
        self.given.append(tuple(action))
        self.ticks += 1
        for agent, climb in zip(range(len(self.heights)), action, strict=False):
            self.heights[agent] += int(climb)
        over = self.ticks >= self.max_steps
        done: Any = [over or h >= 3 for h in self.heights] if self.ends == "each" else over
        paid: Any = [float(a) for a in action] if self.pays == "list" else float(sum(action))
        masks = [[1, 1, h < 3] for h in self.heights]
        return self.seen(), paid, done, False, {"avail_actions": masks, "tick": self.ticks}


class Lists:
    """The old Gym's shape: lists in, lists out, four values, `seed()`; observations are lists."""

    def __init__(self, agents: int = 2, most: int = 5, limited: bool = False) -> None:
        self.action_space = [Discrete(3)] * agents
        self.observation_space = [FLOAT] * agents
        self.rng = np.random.default_rng(0)
        self.agents, self.most, self.limited, self.ticks = agents, most, limited, 0

    def seed(self, seed: int | None = None) -> list[int | None]:
        self.rng = np.random.default_rng(seed)
        return [seed]

    def reset(self) -> list[list[float]]:
        self.ticks = 0
        return [[float(self.rng.integers(9)), 0.0] for _ in range(self.agents)]

    def step(self, actions: list[int]) -> Any:
        assert len(actions) == self.agents
        self.ticks += 1
        over = self.ticks >= self.most
        seen = [[float(action), float(self.ticks)] for action in actions]
        info: dict[str, Any] = {"n": [{"place": k} for k in range(self.agents)]}
        if over and self.limited:
            info["TimeLimit.truncated"] = True
        return seen, [float(a) for a in actions], [over] * self.agents, info


class Solo:
    """The old Gym's shape for one agent."""

    def __init__(self) -> None:
        self.action_space, self.observation_space = Discrete(2), Discrete(8)
        self.ticks = 0

    def reset(self) -> int:
        self.ticks = 0
        return 0

    def step(self, action: int) -> tuple[int, float, bool, dict[str, Any]]:
        self.ticks += 1
        return self.ticks, 1.0, self.ticks == 4, {}


class Marines:
    """PyMARL's shape: a team reward, masks asked for, a limit told in the info."""

    def __init__(self, limit: int = 4, wins_at: int = 99) -> None:
        self.limit, self.wins_at, self.ticks, self.seeded = limit, wins_at, 0, -1

    def get_env_info(self) -> dict[str, int]:
        sizes = {"n_agents": 3, "n_actions": 4, "obs_shape": 2, "state_shape": 5}
        return {**sizes, "episode_limit": self.limit}

    def seed(self, seed: int) -> None:
        self.seeded = seed

    def reset(self) -> None:
        self.ticks = 0

    def get_obs(self) -> list[Any]:
        return [np.array([k, self.ticks], np.float32) for k in range(3)]

    def get_state(self) -> Any:
        return np.full(5, self.ticks, np.float32)

    def get_avail_actions(self) -> list[list[int]]:
        return [[0, 1, 1, 1], [1, 0, 0, 0], [0, 1, 0, 1]]

    def step(self, actions: list[int]) -> tuple[float, bool, dict[str, Any]]:
        assert all(mask[a] for a, mask in zip(actions, self.get_avail_actions(), strict=True))
        self.ticks += 1
        if self.ticks >= self.wins_at:
            return 10.0, True, {"battle_won": True}
        return 0.5, self.ticks >= self.limit, {"episode_limit": self.ticks >= self.limit}


def plain_jax() -> Any:
    """As much of JAX as the shapes use, in plain NumPy: keys are whole numbers."""

    def tree_map(call: Any, tree: Any) -> Any:
        if isinstance(tree, dict):
            return {key: tree_map(call, value) for key, value in tree.items()}
        return call(tree)

    random = SimpleNamespace(
        PRNGKey=lambda seed: seed * 7 + 1,
        fold_in=lambda key, more: key * 31 + more,
        split=lambda key: ((key * 5 + 3) % 10_007, (key * 11 + 1) % 10_007),
    )
    return SimpleNamespace(
        jit=lambda call: call, random=random, tree_util=SimpleNamespace(tree_map=tree_map)
    )


class Particles:
    """JaxMARL's shape: a pure step of key, state and actions; `b` is done before `a`."""

    agents = ("a", "b")
    max_steps = 5

    def observation_space(self, agent: str) -> Any:
        kind = type("Box", (), {})
        space = kind()
        space.low, space.high, space.shape, space.dtype = -np.inf, np.inf, (2,), np.float32
        return space

    def action_space(self, agent: str) -> Any:
        space = type("Discrete", (), {})()
        space.n = 3
        return space

    def get_avail_actions(self, state: Any) -> dict[str, Any]:
        return {agent: np.array([True, state[1] < 4, True]) for agent in self.agents}

    def reset(self, key: int) -> Any:
        state = (key % 100, 0)
        return self.get_obs(state), state

    def get_obs(self, state: Any) -> dict[str, Any]:
        return {agent: np.array(state, np.float32) for agent in self.agents}

    def step_env(self, key: int, state: Any, actions: dict[str, Any]) -> Any:
        state = (int(state[0]) + int(sum(actions.values())), state[1] + 1)
        over = state[1] >= self.max_steps
        dones = {"a": over, "b": state[1] >= 3, "__all__": over}
        paid = {agent: np.float32(actions[agent]) for agent in self.agents}
        return self.get_obs(state), state, paid, dones, {"who": {"a": 1, "b": 2}, "key": key}
