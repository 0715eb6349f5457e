"""Agents that aren't plain texts have one name in columns, policies, changes and findings."""

from collections.abc import Hashable
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.episodes.layout import agent_name

SPEC = """
import gamekeeper as gk
from gymnasium.spaces import Box, Discrete

class Pairs(gk.TickEnv):
    metadata = {{"name": "pairs_v0"}}

    def __init__(self):
        super().__init__()
        self.possible_agents = {agents!r}
        self.observation_spaces = {{agent: Box(-9, 9, (1,)) for agent in self.possible_agents}}
        self.action_spaces = {{agent: Discrete(2) for agent in self.possible_agents}}

    def start(self, rng, options):
        self.left = 3

    def tick(self, actions):
        self.left -= 1
        for agent in list(self.agents):
            self.add_reward(agent, float(actions[agent]))
            if not self.left:
                self.terminate(agent, "done")

    def observe(self, agent):
        return self.observation_spaces[agent].high.copy()
"""


@pytest.fixture(
    params=[[(0, 1), ("b", 2)], [0, 1], ["\ud800", "x"]], ids=["tuples", "numbers", "surrogates"]
)
def agents(request: pytest.FixtureRequest) -> list[Hashable]:
    """The agents of a game."""
    found: list[Hashable] = request.param
    return found


@pytest.fixture
def spec(agents: list[Hashable], tmp_path: Path) -> str:
    """The game in a file."""
    file = tmp_path / "pairs.py"
    file.write_text(SPEC.format(agents=agents), encoding="utf-8")
    return f"{file}:Pairs"


def test_names_are_the_same_from_the_recording_to_the_diagnosis(
    agents: list[Hashable], spec: str, tmp_path: Path
) -> None:
    """A policy for one of them is recorded, attributed, replaced and worn down under its name."""
    run, names = tmp_path / "run", {agent_name(agent) for agent in agents}
    evidence = gk.rollout(spec, policies={agents[0]: "first-legal"}, episodes=6, out=run)
    assert names == set(evidence.manifest["agents"])
    assert evidence.summary.agents[agent_name(agents[0])].return_mean == 0.0
    assert gk.replay(run, allow_import=True, policies=True).verified
    attribution = gk.attribute(run, allow_import=True, episodes=5).to_json()
    assert names == set(attribution["agents"])
    assert attribution["agents"][agent_name(agents[0])]["return"] == 0.0
    diagnosis = gk.diagnose(
        run, allow_import=True, failed="return < 100", perturbations=True, episodes=4_000
    ).to_json()
    assert names == set(diagnosis["agents"])


def test_names_of_an_audit_fit_together(spec: str) -> None:
    """Nothing is held against agents for being no plain texts but what is declared so."""
    result = gk.audit(spec, budget=2_000)
    assert {"GK902"} >= {each.id for each in result.verdicts if str(each.outcome) == "failed"}
    assert not [each.id for each in result.verdicts if str(each.outcome) == "error"]
