"""Environments with every kind of space that an adapter may meet."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium import spaces

import gamekeeper as gk

HERE: Final = f"{__file__}:Kinds"
TURNS: Final = f"{__file__}:KindsInTurn"
VECTOR: Final = spaces.Box(-1, 1, (2,), np.float32)
IMAGE: Final = spaces.Box(0, 255, (36, 36, 3), np.uint8)
PARTS: Final = spaces.Dict({"at": VECTOR, "n": spaces.Discrete(3)})
SEEN: Final[dict[str, Any]] = {
    "Box": VECTOR,
    "image": IMAGE,
    "Discrete": spaces.Discrete(4),
    "Discrete from 2": spaces.Discrete(4, start=2),
    "MultiDiscrete": spaces.MultiDiscrete([3, 2]),
    "MultiDiscrete 2D": spaces.MultiDiscrete([[3, 2], [2, 2]]),
    "MultiBinary": spaces.MultiBinary(3),
    "Dict": PARTS,
    "Dict with image": spaces.Dict({"image": IMAGE, "at": VECTOR}),
    "nested Dict": spaces.Dict({"own": PARTS, "all": VECTOR}),
    "Tuple": spaces.Tuple((VECTOR, spaces.Discrete(3))),
}
DONE: Final[dict[str, Any]] = {
    "Discrete": spaces.Discrete(3),
    "Discrete from 1": spaces.Discrete(3, start=1),
    "MultiDiscrete": spaces.MultiDiscrete([3, 2]),
    "MultiBinary": spaces.MultiBinary(3),
    "Box": VECTOR,
    "Dict": PARTS,
    "Tuple": spaces.Tuple((VECTOR, spaces.Discrete(3))),
}
EACH: Final[list[dict[str, Any]]] = [
    *[{"seen": seen} for seen in SEEN],
    *[{"done": done} for done in DONE if done != "Discrete"],
    *[{"mask": "info", "done": done} for done in ("Discrete", "MultiDiscrete", "Discrete from 1")],
    *[{"mask": "observation", "seen": seen} for seen in ("Box", "image", "Dict", "nested Dict")],
    *[{"roles": 2, "seen": seen} for seen in ("Box", "Dict", "nested Dict")],
    {"roles": 2, "mask": "info"},
    {"roles": 2, "mask": "observation", "seen": "Dict"},
    {"roles": 2, "done": "Box"},
]
"""Every kind of observation and of action, masks where they may stand, one role and two."""


def name(kind: dict[str, Any]) -> str:
    """How a test of it is called."""
    return ", ".join(f"{key} {value}" for key, value in kind.items())


def refusal(kind: dict[str, Any], refused: dict[tuple[str, str], str]) -> str | None:
    """What an adapter says to a kind that it refuses; None: it takes it.

    Args:
        kind: one of `EACH`.
        refused: by a pair out of a kind.
    """
    return next((says for pair, says in refused.items() if pair in kind.items()), None)


def cast(kind: dict[str, Any]) -> dict[str, Any]:
    """Options of an adapter: where there are two roles, the dogs learn."""
    return {"role": "dog", "others": "random"} if kind.get("roles") == 2 else {}


def plays(spec: str, kind: dict[str, Any], policy: Any) -> None:
    """Plays an episode, the dogs by what was learnt; an action that isn't legal raises."""
    gk.rollout(spec, policies={"*": "random", "dog": policy}, episodes=1, env_kwargs=kind)


class _Kinds:
    """Agents that see anything and are paid for their first action; two roles see differently."""

    agents: list[str]

    def __init__(self, seen: str = "Box", done: str = "Discrete", mask: str = "", roles: int = 1):
        super().__init__()
        self.has_mask, self.done = mask, done
        self.possible_agents = ["dog_0", "dog_1", "cat_0"][: roles + 1]
        shown = SEEN[seen]
        if mask == "observation":
            flags = spaces.MultiBinary(3)
            own = dict(shown.spaces) if isinstance(shown, spaces.Dict) else {"observation": shown}
            shown = spaces.Dict({**own, "action_mask": flags})
        self.observation_spaces: dict[str, Any] = dict.fromkeys(self.possible_agents, shown)
        self.action_spaces: dict[str, Any] = dict.fromkeys(self.possible_agents, DONE[done])
        if roles == 2:
            self.observation_spaces["cat_0"] = spaces.Box(-1, 1, (4,), np.float32)

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        """Shows each agent something."""
        self.draws, self.time = rng, 0
        self._look()

    def _look(self) -> None:
        self.shown = {}
        for agent, space in self.observation_spaces.items():
            space.seed(int(self.draws.integers(2**31)))
            self.shown[agent] = space.sample()
            if self.has_mask == "observation" and isinstance(space, spaces.Dict):
                self.shown[agent]["action_mask"] = self._flags()

    def _flags(self) -> Any:
        return np.array([1, self.time % 2, 0], np.int8)

    def mask(self, agent: str) -> Any:
        """What may be done, where infos say so."""
        if self.has_mask != "info":
            return None
        pair = self._flags(), np.array([0, 1], np.int8)
        return pair if self.done == "MultiDiscrete" else pair[0]

    def observe(self, agent: str) -> Any:
        """What was drawn for it."""
        return self.shown[agent]


class Kinds(_Kinds, gk.TickEnv):
    """All act at once."""

    metadata = {"name": "kinds_v0"}  # noqa: RUF012  # as PettingZoo has it

    def tick(self, actions: dict[str, Any]) -> None:
        """Ends one agent after three ticks, the others after seven."""
        self.time += 1
        for agent in actions:
            self.add_reward(agent, 1.0 + self.time)
            if self.time == 3 and agent == "dog_1":
                self.terminate(agent, "tired")
            elif self.time == 7:
                self.truncate(agent, "night")
        self._look()


class KindsInTurn(_Kinds, gk.TurnEnv):
    """One after the other."""

    metadata = {"name": "kinds_in_turn_v0"}  # noqa: RUF012  # as PettingZoo has it

    def act(self, agent: str, action: Any) -> None:
        """As at once."""
        self.time += 1
        self.add_reward(agent, 1.0 + self.time)
        if self.time >= 6 and "dog_1" in self.agents:
            self.terminate("dog_1", "tired")
        if self.time >= 15:
            for each in self.agents:
                self.truncate(each, "night")
        self._look()
