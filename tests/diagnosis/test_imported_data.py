"""Data sets of other libraries hold neither environment nor policies: nothing plays them again."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.diagnosis.response_tests import responses
from gamekeeper.errors import SpecError


@pytest.fixture(scope="module")
def data_set() -> gk.Evidence:
    """Evidence as an import leaves it: without seeds, policies, contract and environment."""
    evidence = gk.rollout("two_robot_line", episodes=1, seed=3)
    identity = {"kind": "object", "entry_point": "data", "name": "data", "api": "parallel"}
    given = {"imported": {"from": "minari"}, "kwargs": {}}
    manifest = {**evidence.manifest, "environment": identity | given, "contract": None}
    return replace(evidence, manifest=manifest)


@pytest.mark.parametrize("command", [gk.diagnose, gk.pivots, gk.attribute, responses])
def test_data_set_cannot_be_played_again(
    data_set: gk.Evidence, command: Callable[..., Any]
) -> None:
    """One sentence says so, before a condition or policies are asked for, and what can be done."""
    with pytest.raises(SpecError, match="holds neither environment nor policies") as caught:
        command(data_set)
    for word in ("show", "query", "report", "audit RUN", "--env"):
        assert word in str(caught.value)


def test_data_set_is_diagnosed_in_an_environment_that_is_named(data_set: gk.Evidence) -> None:
    """With an environment and policies, diagnosis plays those."""
    found = gk.attribute(
        data_set, env="two_robot_line", policies={"*": "random"}, episodes=2, action_episodes=0
    )
    assert set(found.agents) == {"picker", "carrier"}


def test_environment_with_other_agents_is_refused() -> None:
    """What is measured in it would be no answer about the run's agents, not even a 0."""
    evidence = gk.rollout("two_robot_line", episodes=1, policies="random", seed=1)
    named: dict[str, Any] = {"env": "warehouse", "policies": {"*": "random"}}
    with pytest.raises(SpecError, match="has other agents than the run") as caught:
        gk.attribute(evidence, **named)
    assert caught.value.expected == "picker, carrier"
    assert "picker_0" in caught.value.actual
    with pytest.raises(SpecError, match="has other agents than the run"):
        gk.diagnose(evidence, failed="return < 1", **named)
