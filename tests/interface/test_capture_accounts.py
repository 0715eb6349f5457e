"""The door over our own books writes the rows that comparing everything gives."""

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.interface.aec_capture import AECCapture, BookkeptCapture
from gamekeeper.interface.recorded_env import capture_of
from gamekeeper.interface.turn_env import TurnEnv
from gamekeeper.rollouts.memory import MemorySink

AGENTS = [f"a_{i}" for i in range(5)]


class Scripted(TurnEnv):
    """Each turn does what its script says: pay, terminate, truncate, join, or raise."""

    metadata = {"name": "scripted_v0"}  # noqa: RUF012  # as PettingZoo declares it

    def __init__(self, script: list[tuple[str, int]]) -> None:
        super().__init__()
        self.possible_agents = list(AGENTS)
        self.observation_spaces = dict.fromkeys(AGENTS, Discrete(9))
        self.action_spaces = dict.fromkeys(AGENTS, Discrete(2))
        self.script = script

    def starting_agents(self) -> list[str]:
        return AGENTS[:3]

    def start(self, rng: Any, options: Any) -> None:
        self.turn = 0

    def observe(self, agent: str) -> np.int64:
        return np.int64(self.turn % 9)

    def act(self, agent: str, action: int) -> None:
        verb, whom = self.script[self.turn % len(self.script)]
        self.turn += 1
        name = AGENTS[whom]
        if verb == "raise":
            raise RuntimeError("as the script says")
        if verb == "join" and name not in self.agents and self.joins(name):
            self.join(name)
        elif verb == "add_reward" and name in self.agents:
            self.add_reward(name, 1.0)
        elif verb == "end" and name in self.agents:
            self.terminate(name, "script")
        elif verb == "cut" and name in self.agents:
            self.truncate(name, "script")

    def joins(self, name: str) -> bool:
        return name not in self.endings


def fingerprint(kind: type[AECCapture], script: list[tuple[str, int]]) -> str:
    """The fingerprint of 40 turns of a script, seen through one kind of game."""
    sink = MemorySink()
    capture = kind(Scripted(script), sink=sink)
    capture.reset(seed=3)
    for _ in range(40):
        if not capture.to_move:
            break
        _, _, terminated, truncated, _ = capture.last()
        try:
            capture.step(None if terminated or truncated else 1)
        except RuntimeError:
            continue
    capture.end_episode()
    return sink.evidence({"name": "scripted_v0", "api": "aec", "kwargs": {}}).fingerprint


verbs = st.tuples(
    st.sampled_from(["add_reward", "add_reward", "end", "cut", "join", "raise", "none"]),
    st.integers(0, 4),
)


@given(st.lists(verbs, min_size=1, max_size=12))
def test_door_over_books_writes_what_looking_gives(script: list[tuple[str, int]]) -> None:
    """Reading whom the books touched comes to the same rows as comparing everything."""
    assert fingerprint(BookkeptCapture, script) == fingerprint(AECCapture, script)


@pytest.mark.parametrize("env", [Scripted([("add_reward", 0)])])
def test_door_over_books_is_chosen_by_itself(env: Scripted) -> None:
    """A TurnEnv gets the door that reads its books."""
    assert type(capture_of(env)) is BookkeptCapture
