"""What an episode came to, and whether that counts as failed."""

from dataclasses import replace

import pytest

from gamekeeper.contract import Contract
from gamekeeper.episodes import outcome
from gamekeeper.episodes.outcome import Outcome, failed, failures, figures
from gamekeeper.errors import ContractError

CONTRACT = Contract.parse(
    """
    [roles.picker]
    agents = "picker_*"
    [roles.carrier]
    agents = "carrier"
    [rewards.grasp]
    kind = "individual"
    [failure]
    team = "return < 3"
    picker = "grasp == 0"
    agent = "battery < 1"
    """
)
OUTCOME = Outcome(
    seed=1,
    turns=9,
    returns={"picker_0": 1.0, "picker_1": 0.0, "carrier": 1.0},
    terms={"picker_0": {"grasp": 1.0}},
    endings={"picker_0": "cleared", "picker_1": "battery", "carrier": "cleared"},
    infos={
        "picker_0": {"left": 0, "battery": 5},
        "picker_1": {"left": 2, "battery": 0},
        "carrier": {"left": 0, "battery": 7},
    },
    seen={"picker_0": 9, "picker_1": 4, "carrier": 9},
)


def test_failed_answers_for_team_roles_and_agents() -> None:
    """Each scope has its own condition, on its own figures."""
    answers = failed(OUTCOME, failures(CONTRACT), CONTRACT)
    assert answers == {
        "team": True,
        "picker": False,
        "picker_0": False,
        "picker_1": True,
        "carrier": False,
    }


def test_failed_holds_for_everybody_where_an_exception_ended_it() -> None:
    """An episode that broke off failed, whatever its figures."""
    broken = Outcome(returns={"picker_0": 9.0}, error="ValueError: x")
    assert failed(broken, failures(CONTRACT), CONTRACT) == {
        "team": True,
        "picker": True,
        "picker_0": True,
    }


def test_figures_take_what_was_told_last() -> None:
    """Who ended early was told something older, which doesn't contradict."""
    found = figures(OUTCOME, list(OUTCOME.returns), CONTRACT)
    assert found["left"] == 0
    assert found["picker_1.left"] == 2
    assert found["ending"] == "mixed"
    assert found["picker.grasp"] == 1.0
    assert "battery" not in found


def test_failures_ask_for_a_condition() -> None:
    """Without a declaration nothing failed by itself."""
    with pytest.raises(ContractError, match="nothing says when an episode failed"):
        failures(Contract())
    assert list(failures(Contract(), "return < 1")) == ["team"]


def test_success_is_proposed_only_where_every_episode_has_it() -> None:
    """The example of a condition can be judged on the run it is for."""
    one = replace(OUTCOME, infos={"picker_0": {"success": 1.0}}, seen={"picker_0": 3})
    assert outcome._example([one, one], CONTRACT) == "not success"
    assert "success" not in outcome._example([one, OUTCOME], CONTRACT)


def test_outcome_crosses_as_json() -> None:
    """What is written comes back equal."""
    assert Outcome.from_json(OUTCOME.to_json()) == OUTCOME
