"""Slots show each agent's stream of decisions as a recording of the same episode has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.adapters.slots import Slots
from gamekeeper.errors import SpecError
from gamekeeper.interface.policy import EVERYONE
from tests.adapters.streams import ByWhatIsSeen, of_episode, of_slots, played, same

WORLDS = str(Path(__file__).parent.parent / "vector" / "worlds.py")
HERE = str(Path(__file__))
FOUR = "pettingzoo.classic.connect_four_v3:env"
EPISODES = 5
BATTERY = {"battery": 9, "spares": 1}


class Boss(gk.TickEnv):
    """A boss with actions and observations in parts, and a hand that learns."""

    metadata = {"name": "boss_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["boss", "hand"]
        self.observation_spaces = {
            "boss": spaces.Tuple((spaces.Discrete(9), spaces.Box(-9, 9, (2,), np.float32))),
            "hand": spaces.Box(-9, 9, (1,), np.float32),
        }
        self.action_spaces = {
            "boss": spaces.Dict({"go": spaces.Discrete(3), "at": spaces.Box(-1, 1, (2,))}),
            "hand": spaces.Discrete(2),
        }

    def start(self, rng: Any, options: dict[str, Any]) -> None:
        self.time, self.sum = 0, 0.0

    def tick(self, actions: dict[str, Any]) -> None:
        """Both are paid what the boss did."""
        self.time += 1
        self.sum = float(actions["boss"]["go"] + np.sum(actions["boss"]["at"]) + actions["hand"])
        for agent in actions:
            self.add_reward(agent, self.sum)
            if self.time == 4:
                self.terminate(agent, "done")

    def observe(self, agent: str) -> Any:
        place = np.array([self.sum, self.time], np.float32)
        return place[:1] if agent == "hand" else (self.time, place)


class Leaves(ParallelEnv):
    """`a` is taken off the list in the second tick without a word, all in the fourth."""

    metadata = {"name": "leaves_v0"}  # noqa: RUF012

    def __init__(self) -> None:
        self.possible_agents = ["a", "b"]
        self.render_mode = None

    def observation_space(self, agent: str) -> Any:
        return spaces.Box(0, 9, (1,), np.float32)

    def action_space(self, agent: str) -> Any:
        return spaces.Discrete(2)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.time = ["a", "b"], 0
        return self._all(np.ones(1, np.float32)), self._all({})

    def step(self, actions: Any) -> Any:
        self.time += 1
        self.agents = {2: ["b"], 4: []}.get(self.time, self.agents)
        seen = self._all(np.full(1, self.time, np.float32))
        return seen, self._all(1.0), self._all(False), self._all(False), self._all({})

    def _all(self, value: Any) -> dict[str, Any]:
        return dict.fromkeys(self.agents, value)


def seen_and_recorded(
    spec: object,
    *,
    role: str | None = None,
    others: Any = None,
    env_kwargs: Any = None,
    **options: Any,
) -> Slots:
    """Compares every whole episode of every slot with the recorded one; returns the slots."""
    slots = Slots(spec, 2, role=role, others=others, seed=5, env_kwargs=env_kwargs, **options)
    mine = ByWhatIsSeen(slots.action_space)
    policies: Any = mine
    if others is not None:
        named = others if isinstance(others, dict) else {EVERYONE: others}
        policies = {**named, **dict.fromkeys(slots.learners, mine)}
    episodes = list(
        gk.rollout(
            spec, policies=policies, episodes=EPISODES, seed=5, env_kwargs=env_kwargs
        ).episodes
    )
    longest = max(len(list(episode.turns)) for episode in episodes)
    try:
        told = played(slots, longest * -(-EPISODES // 2) + 2)
    finally:
        slots.close()
    compared = 0
    for copy in range(2):
        for learner, agent in enumerate(slots.learners):
            recorded = [of_episode(episode, str(agent)) for episode in episodes[copy::2]]
            recorded = [stream for stream in recorded if stream is not None]
            found = of_slots(told, copy * len(slots.learners) + learner)
            assert len(found) > len(recorded)
            for one, two in zip(recorded, found, strict=False):
                same(one, two)
                compared += 1
    assert compared >= EPISODES
    return slots


@pytest.mark.parametrize(
    ("spec", "options"),
    [
        ("two_robot_line", {}),
        ("two_robot_line", {"role": "picker", "others": "greedy"}),
        ("warehouse", {"env_kwargs": BATTERY}),
        ("warehouse", {"role": "picker", "others": {"carrier": "reference"}}),
        ("handover", {}),
        ("handover", {"role": "giver", "others": {"receiver": "reference"}}),
        ("warehouse_turns", {"role": "carrier", "others": "random", "env_kwargs": BATTERY}),
        (FOUR, {"role": "player_1", "others": {"player_0": "random"}}),
        (f"{WORLDS}:Camp", {"role": "scout", "others": "first-legal"}),
        (f"{WORLDS}:Camp", {"role": "cook", "others": "random"}),
        (f"{WORLDS}:Walk", {}),
        (f"{WORLDS}:Late", {"role": "scout", "others": "random"}),
        (f"{WORLDS}:LateTurns", {"role": "scout", "others": "random"}),
        (f"{WORLDS}:LateTurns", {"role": "cook", "others": "random"}),
        (f"{HERE}:Boss", {"role": "hand", "others": "random"}),
        (f"{HERE}:Boss", {"role": "hand", "others": "random", "engine": "process"}),
        ("handover", {"role": "giver", "others": "reference", "engine": "process"}),
    ],
)
def test_slots_show_what_is_recorded(spec: str, options: dict[str, Any]) -> None:
    """Observations, masks, actions, rewards by decision, ends, last observations: all of them."""
    engine = options.pop("engine", "serial") if "engine" in options else "serial"
    more = {"engine": engine, "workers": 2} if engine == "process" else {}
    seen_and_recorded(spec, **options, **more)


def test_slots_of_who_has_ended_show_zeros() -> None:
    """Until the copy begins anew, and nobody says that they act."""
    slots = Slots("warehouse", 2, env_kwargs={"battery": 6, "spares": 0})
    told, waited = played(slots, 60), 0
    for step in told:
        gone = ~step["acted"]
        waited += int(gone.sum())
        assert not step["obs"][gone].any()
        assert not step["rewards"][gone & ~(step["terminated"] | step["truncated"])].any()
    assert waited
    slots.close()


def test_slots_tell_who_left_without_an_ending() -> None:
    """As terminated, with its own decisions counted; the next episode begins at 0."""
    slots = Slots(f"{HERE}:Leaves", 1)
    slots.reset()
    ends: list[dict[int, tuple[int, float]]] = []
    for _ in range(8):
        step = slots.step(np.zeros(2, int))
        assert not step.truncated.any()
        ends.append({slot: (step.lengths[slot], step.returns[slot]) for slot in step.final})
    one = [{}, {0: (2, 1.0)}, {}, {1: (4, 3.0)}]
    assert ends == one * 2
    slots.close()


def test_slots_never_share_what_they_gave() -> None:
    """What a step returned stays as it was when the next one comes."""
    for spec in ("warehouse", "handover"):
        slots = Slots(spec, 2)
        first = slots.reset()
        kept = first.copy()
        step = slots.step(slots.masks.argmax(1))
        rewards = step.rewards.copy()
        second, kept_second = step.obs, step.obs.copy()
        slots.step(slots.masks.argmax(1))
        assert np.array_equal(first, kept)
        assert np.array_equal(second, kept_second)
        assert np.array_equal(step.rewards, rewards)
        slots.close()


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({}, "can't be shared"),
        ({"role": "scout"}, "have no policy"),
        ({"role": "scout_0", "others": {"cook": "random"}}, "have no policy"),
        ({"role": "pilot", "others": "random"}, "no agent with the role"),
    ],
)
def test_slots_refuse_what_they_would_have_to_guess(options: Any, match: str) -> None:
    """Who shares a policy, and who plays the others."""
    with pytest.raises(SpecError, match=match):
        Slots(f"{WORLDS}:Camp", 1, **options)


def test_slots_refuse_policies_for_nobody() -> None:
    """Everybody learns, so that nobody follows them."""
    with pytest.raises(SpecError, match="all agents learn"):
        Slots("two_robot_line", 1, others="random")
