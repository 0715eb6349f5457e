"""Least sets of agents: a healthy one beside two at fault isn't accused, one that helps is."""

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.contract.sections import Role
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.diagnosis.trials import peers_of

HERE = f"{__name__}:"


def walks(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Walks."""
    return 1


def strolls(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Walks, but for one turn in twenty."""
    return int(rng.random() < 0.95)


def limps(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Walks in fewer than half of its turns."""
    return int(rng.random() < 0.5)


def falters(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Walks in fewer than half of its turns."""
    return int(rng.random() < 0.45)


def stands(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Stands still."""
    return 0


class Lanes(gk.TickEnv):
    """Three agents that all have to reach the end of their lane."""

    metadata: ClassVar[dict[str, Any]] = {"name": "lanes_v0"}
    policies: ClassVar[dict[str, Any]] = {"reference": walks}

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["ant_0", "ant_1", "ant_2"]
        box = Box(-99, 99, (1,), np.float64)
        self.observation_spaces = dict.fromkeys(self.possible_agents, box)
        self.action_spaces = {agent: Discrete(2) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Draws where they begin."""
        self.number = 0
        self.place = {agent: int(rng.integers(2)) for agent in self.possible_agents}

    def tick(self, actions: Any) -> None:
        """They walk."""
        self.number += 1
        for agent, action in actions.items():
            self.place[agent] += int(action)
        if min(self.place.values()) >= 6:
            for agent in self.possible_agents:
                self.add_reward(agent, 1.0)
                self.terminate(agent, "there")
        elif self.number >= 9:
            for agent in self.possible_agents:
                self.truncate(agent, "late")

    def observe(self, agent: str) -> Any:
        """Where it is."""
        return np.array([self.place[agent]], np.float64)


def diagnosed(*names: str, **options: Any) -> gk.Diagnosis:
    """What is said of three agents with these policies."""
    policies = {f"ant_{place}": HERE + name for place, name in enumerate(names)}
    evidence = gk.rollout(HERE + "Lanes", policies=policies, episodes=4)
    return gk.diagnose(evidence, failed="return < 3", perturbations=False, **options)


def test_a_healthy_agent_between_two_at_fault_is_not_accused() -> None:
    """The group of three that restores is shrunk to the two that it takes."""
    found = diagnosed("stands", "strolls", "stands")
    assert {name: each.answer for name, each in found.agents.items()} == {
        "ant_0": "isolated",
        "ant_1": "elsewhere",
        "ant_2": "isolated",
    }
    assert found.team is not None
    assert found.team.component == "ant_0 and ant_2's policies"
    assert found.agents["ant_0"].labels == ()


def test_an_agent_that_helps_beside_another_is_not_acquitted() -> None:
    """One policy alone closes enough of the gap; both do more, beyond chance."""
    found = diagnosed("falters", "limps", "walks", part=0.3)
    assert found.team is not None
    alone = next(
        x for x in found.team.tested if x.intervention == "giving ant_0 the reference policy"
    )
    assert alone.restores
    assert [each.answer for each in found.agents.values()] == ["isolated", "isolated", "elsewhere"]


def test_policies_of_peers_are_tried_for_all_of_a_role_at_once() -> None:
    """Two that have the same wrong policy are given the third one's together."""
    setup = Setup("x", policies={"a_0": "noop", "a_1": "noop", "a_2": "random"})
    found = list(peers_of(setup, Contract(), ("a_0", "a_1", "a_2")))
    together = found[-1]
    assert together.name == "giving a_0 and a_1 a_2's policy"
    assert together.agents == ("a_0", "a_1")
    assert {one.name for one in found[:2]} <= together.contains


def test_agents_alone_in_their_role_are_peers_where_their_spaces_are_equal() -> None:
    """`left` and `right` are; others of other spaces, or of a declared role, aren't."""
    given = dict.fromkeys(("left", "right", "odd"), Discrete(2)) | {"odd": Discrete(3)}
    env = SimpleNamespace(observation_space=given.get, action_space=given.get)
    setup = Setup("x", policies={"left": "noop", "right": "random", "odd": "first-legal"})
    found = [one.name for one in peers_of(setup, Contract(), list(given), env)]
    assert found == ["giving left right's policy", "giving right left's policy"]
    declared = Contract(roles={"arm": Role(agents=("left",))})
    assert list(peers_of(setup, declared, list(given), env)) == []
