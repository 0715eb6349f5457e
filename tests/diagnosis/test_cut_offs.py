"""Failures that are no agent's: episodes cut off too early, and what is the same for all."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.diagnosis.cut_offs import cuts_of, cutting_arguments, early_cut, truncating_turn
from gamekeeper.diagnosis.experiment import Experiment
from gamekeeper.diagnosis.judgement import judged
from gamekeeper.diagnosis.setup_differences import ABSENT
from gamekeeper.diagnosis.trials import CUT_OFF, EVALUATION, IdealSubstitute, over_undos, undone
from gamekeeper.diagnosis.undos import BoundaryUndo
from gamekeeper.episodes.outcome import Outcome

HERE = f"{__name__}:"


@pytest.mark.parametrize(("cut_off", "is_near"), [("later", False), ("default", True)])
def test_a_later_cut_off_near_the_threshold_takes_no_more_episodes(
    cut_off: Any, is_near: bool
) -> None:
    """It yields to whatever else restores, which the same episodes may find."""
    one = IdealSubstitute("limit = 80", CUT_OFF, (), (("argument", "", "limit", 80),))
    arms = {replace(one, cut_off=cut_off): np.repeat([1.0, 0.0], [46, 18])}
    finding = judged(np.zeros(64), arms, rng=np.random.default_rng(0))
    experiment: Any = SimpleNamespace(
        scopes=("team",), part=0.7, finding=lambda scope: replace(finding, answer="ambiguous")
    )
    experiment.is_failing = lambda scope: True
    assert Experiment._is_near(experiment) is is_near


@pytest.mark.parametrize(
    ("way", "answer"), [("rescale fields", "protocol"), ("mirror field", "isolated")]
)
def test_what_only_quickens_an_agent_yields_to_the_default_cut_off(way: Any, answer: str) -> None:
    """With as many turns as the environment gives by itself nothing is wrong with that agent."""
    own = (("argument", "", "limit", ABSENT),)
    default = IdealSubstitute("limit at its default", EVALUATION, (), own, cut_off="default")
    undo = undone(BoundaryUndo(("ant_0",), way, amount=2.0))
    for all_turns in (np.ones(64), np.zeros(64)):
        arms = {one: np.ones(64) for one in over_undos([default, undo])}
        arms[next(one for one in arms if one.cut_off)] = all_turns
        found = judged(np.zeros(64), arms, rng=np.random.default_rng(0))
        assert found.answer == (answer if all_turns.all() else "isolated")


class Corridor(gk.TickEnv):
    """Two agents walk eight cells to the right; wind holds them where they are."""

    metadata = {"name": "corridor_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, limit: int = 20, wind: float = 0.0, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.limit, self.wind = limit, wind
        self.possible_agents = ["ant_0", "ant_1"]
        box = Box(-99, 99, (1,), np.float64)
        self.observation_spaces = dict.fromkeys(self.possible_agents, box)
        self.action_spaces = {agent: Discrete(2) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Draws where they begin."""
        self.rng, self.number = rng, 0
        self.place = {agent: int(rng.integers(2)) for agent in self.possible_agents}

    def tick(self, actions: Any) -> None:
        """They walk."""
        self.number += 1
        for agent, action in actions.items():
            held = float(self.rng.uniform(0.0, 1.0)) < self.wind
            self.place[agent] += 0 if held else int(action)
        if min(self.place.values()) >= 8:
            for agent in self.possible_agents:
                self.add_reward(agent, 1.0)
                self.terminate(agent, "there")
        elif self.number >= self.limit:
            for agent in self.possible_agents:
                self.truncate(agent, "late")

    def observe(self, agent: str) -> Any:
        """Where it is."""
        return np.array([self.place[agent]], np.float64)


def walks(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Walks."""
    return 1


def stands(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Stands still."""
    return 0


def diagnosed(kwargs: Any, policies: Any, **options: Any) -> gk.Diagnosis:
    """What is said of the corridor."""
    evidence = gk.rollout(HERE + "Corridor", env_kwargs=kwargs, policies=policies, episodes=4)
    return gk.diagnose(evidence, failed="return < 2", perturbations=False, **options)


def ended(turns: int, flag: str = "truncated") -> Outcome:
    """An episode that ended after so many turns."""
    return Outcome(turns=turns, returns={"a": 0.0, "b": 0.0}, flags={"a": flag, "b": flag})


def test_an_argument_that_is_the_truncating_turn_is_found() -> None:
    """In turns, or in rounds of all agents; an episode that terminated speaks against it."""
    given = {"n": 2, "limit": 20, "is_hard": True, "far": 9.0}
    assert truncating_turn([ended(20), ended(20), ended(3, "terminated")]) == 20
    assert truncating_turn([ended(20), ended(21)]) is None
    assert cutting_arguments(given, 20, 2) == {"limit": 20}
    assert cutting_arguments(given, 41, 2) == {"limit": 20}
    assert cutting_arguments(given, 30, 2) == {}
    env = Corridor()
    assert cuts_of([ended(20)], env, given, 2) == {"limit": 20}
    assert cuts_of([ended(20), ended(3, "terminated")], env, given, 2) == {}
    assert early_cut([ended(20)], 50) == 20
    assert early_cut([ended(20)], 20) is None


def test_a_limit_shorter_than_the_default_is_the_protocols() -> None:
    """No agent is accused: the default limit restores."""
    found = diagnosed({"limit": 5}, HERE + "walks")
    assert {each.answer for each in found.agents.values()} == {"protocol"}
    assert found.team is not None
    assert found.team.labels == ("evaluation",)
    assert "limit at its default" in found.team.why


@pytest.mark.parametrize("kwargs", [{}, {"limit": 19}])
def test_an_agent_that_stands_still_is_not_excused_by_the_limit(kwargs: Any) -> None:
    """More time doesn't help, so that nothing is named."""
    found = diagnosed(kwargs, {"ant_0": HERE + "stands", "ant_1": HERE + "walks"}, episodes=600)
    assert found.agents["ant_0"].component == "ant_0's policy"
    assert found.agents["ant_1"].answer == "elsewhere"


def test_truncation_before_the_declared_horizon_is_told_by_evidence_alone() -> None:
    """No argument that could be tried cuts it."""
    contract = gk.Contract.parse('[schedule]\nhorizon = 60\n[failure]\nteam = "return < 2"\n')
    found = diagnosed({"wind": 0.8}, HERE + "walks", contract=contract, episodes=200)
    assert found.team is not None
    assert found.team.answer == "protocol"
    assert found.team.labels == ()
    assert "truncated after 20 turns, before the declared horizon of 60" in found.team.why


def test_a_knob_that_is_the_environments_is_nobodys_fault() -> None:
    """Wind is the same for all."""
    contract = gk.Contract.parse('[knobs]\nwind = { label = "environment", ideal = 0.0 }\n')
    found = diagnosed({"wind": 0.9}, HERE + "walks", contract=contract, episodes=400)
    assert {each.answer for each in found.agents.values()} == {"environment"}
    assert found.agents["ant_0"].component == "the environment's wind"
    assert found.agents["ant_0"].labels == ()


def test_a_contract_without_a_horizon_says_nothing_of_cut_offs() -> None:
    """Evidence alone needs a declaration."""
    assert Contract().schedule.horizon is None
    assert early_cut([ended(20)], None) is None
