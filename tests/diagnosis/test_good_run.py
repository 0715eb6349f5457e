"""A run beside one that worked: the least set of differences that explains the gap."""

from itertools import combinations
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.contract import Contract
from gamekeeper.diagnosis.arms import ArmRunner
from gamekeeper.diagnosis.difference_search import DifferenceSearch, least_set
from gamekeeper.diagnosis.open_setup import Setup
from gamekeeper.diagnosis.setup_differences import (
    ABSENT,
    SetupDifference,
    differences_of,
    taken_over,
)
from gamekeeper.episodes.outcome import Outcome

HERE = f"{__name__}:"


class Gate(gk.TickEnv):
    """Two agents open a gate where both choose what they are shown."""

    metadata = {"name": "gate_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(
        self,
        limit: int = 4,
        haze: float = 0.0,
        color: str = "red",
        size: int = 2,
        bonus: float = 0.0,
        render_mode: str | None = None,
    ) -> None:
        super().__init__(render_mode=render_mode)
        self.limit, self.haze, self.color, self.size, self.bonus = limit, haze, color, size, bonus
        self.possible_agents = ["left", "right"]
        self.observation_spaces = dict.fromkeys(self.possible_agents, Box(-9, 9, (2,), np.float64))
        self.action_spaces = {agent: Discrete(3) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Draws what opens it."""
        self.rng, self.number = rng, 0
        self.wanted = 1 + int(rng.integers(2))
        self.swapped = bool((options or {}).get("swapped"))

    def tick(self, actions: Any) -> None:
        """Opens from the second tick on."""
        self.number += 1
        done = all(int(action) == self.wanted for action in actions.values())
        for agent in self.possible_agents:
            if done and self.number > 1:
                self.add_reward(agent, 1.0 + self.bonus)
                self.terminate(agent, "open")
            elif self.number >= self.limit:
                self.truncate(agent, "late")

    def observe(self, agent: str) -> Any:
        """What opens it, unless there is haze."""
        shown = 3 - self.wanted if self.swapped else self.wanted
        is_hidden = float(self.rng.uniform(0.0, 1.0)) < self.haze
        return np.array([0 if is_hidden else shown, self.size], np.float64)


def opens(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Does what it is shown."""
    return int(observation[0])


def opens_too(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """The same."""
    return int(observation[0]) + 0


def sleeps(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Does nothing."""
    return 0


GOOD: dict[str, Any] = {"env_kwargs": {"limit": 4}, "policies": HERE + "opens"}


def diagnosed(bad: dict[str, Any], **options: Any) -> gk.Diagnosis:
    """The bad set-up beside the good one."""
    one = gk.rollout(HERE + "Gate", episodes=4, seed=1, **bad)
    two = gk.rollout(HERE + "Gate", episodes=4, seed=2, **GOOD)
    return gk.diagnose(one, good=two, **{"failed": "return < 1", **options})


@pytest.mark.parametrize("size", [1, 2, 3, 7, 12])
def test_least_set_is_least(size: int) -> None:
    """Every set of one to three things among others is found, whatever stands around it."""
    items = list(range(size))
    for count in (1, 2, 3):
        for wanted in combinations(items, count):
            found = least_set(items, lambda some, wanted=wanted: set(wanted) <= set(some))  # type: ignore[misc]  # mypy infers no type of a default in a lambda
            assert set(found) == set(wanted)


def test_every_difference_is_listed_and_can_be_taken_over() -> None:
    """Arguments, arguments by agent, options, policies and the cut; taken over they are gone."""
    bad = Setup(
        "aec:x",
        {"n": 2, "lag": {"a": 3}, "gone": 1},
        ({"day": 1},),
        {"*": "noop", "b": "random"},
        most_turns=9,
    )
    good = Setup("aec:y", {"n": 3, "lag": {"a": 3, "b": 1}}, ({"day": 2},), {"*": "random"})
    agents = ("a", "b")
    found = differences_of(bad, good, Contract(), agents)
    assert [each.name for each in found] == [
        "environment",
        "gone",
        "lag[b]",
        "n",
        "options.day",
        "policy[a]",
        "cut after",
    ]
    assert found[1].good == ABSENT
    assert found[2].agents == ("b",)
    assert differences_of(taken_over(bad, good, found), good, Contract(), agents) == ()
    assert len(differences_of(taken_over(bad, good, found[:3]), good, Contract(), agents)) == 4


def test_agents_that_share_a_policy_can_be_given_another_alone() -> None:
    """Where the owner is replaced, those that shared its object keep it."""
    shared = Setup("x", policies={"a": "noop", "b": "same:a", "c": "same:a"})
    other = Setup("x", policies={"*": "random"})
    first, second = differences_of(shared, other, Contract(), ("a", "b"))
    kept = {"a": "random", "b": "noop", "c": "same:b"}
    assert taken_over(shared, other, [first]).policies == kept
    assert second.name == "policy[b]"


def test_the_policy_that_matters_is_found_among_what_does_not() -> None:
    """One agent's policy of five differences; its agent is named, the other isn't."""
    found = diagnosed(
        {
            "env_kwargs": {"limit": 5, "color": "blue", "bonus": 0.5},
            "policies": {"left": HERE + "sleeps", "right": HERE + "opens_too"},
        }
    )
    assert found.differences is not None
    assert found.differences.least == (("policy[left]",),)
    assert {each.name for each in found.differences.listed} >= {"limit", "policy[right]", "color"}
    assert found.agents["left"].answer == "isolated"
    assert found.agents["left"].component == "left's policy"
    assert found.agents["right"].answer == "elsewhere"
    assert found.to_json()["differences"]["least"] == [["policy[left]"]]


def test_two_that_matter_together_are_both_named() -> None:
    """Haze and a limit that is too short: neither alone restores."""
    found = diagnosed({"env_kwargs": {"limit": 1, "haze": 1.0, "size": 3}, **_policies()})
    assert found.differences is not None
    assert found.differences.least == (("haze", "limit"),)
    assert {each.answer for each in found.agents.values()} == {"environment"}


def test_an_argument_that_cuts_episodes_off_is_the_protocols() -> None:
    """No agent's fault; without a condition the team's return is compared."""
    bad = {"env_kwargs": {"limit": 1, "size": 3}, **_policies()}
    found = diagnosed(bad, failed=None)
    assert found.differences is not None
    assert found.differences.measure == "return"
    assert found.differences.least == (("limit",),)
    assert found.agents["left"].answer == "protocol"


def test_runs_that_do_the_same_have_no_cause() -> None:
    """Differences that don't matter are listed and not accused."""
    found = diagnosed({"env_kwargs": {"limit": 6, "color": "blue"}, **_policies()})
    assert found.differences is not None
    assert found.differences.least == ()
    assert "no better" in found.differences.why
    assert {each.answer for each in found.agents.values()} == {"not_failing"}
    assert not found.has_cause


def test_a_budget_that_is_spent_names_nothing() -> None:
    """The least budget isn't enough for any set."""
    bad = {"env_kwargs": {"limit": 1, "haze": 1.0, "size": 3}, **_policies()}
    found = diagnosed(bad, episodes=200)
    assert found.episodes <= 200
    assert found.not_played
    assert not found.has_cause


def test_what_is_known_is_noted_when_it_is_interrupted(tmp_path: Path) -> None:
    """Scores by then, and where what was played stays; the next call goes on."""

    def stop(fields: dict[str, Any]) -> None:
        if fields["episode"] == 20:
            raise KeyboardInterrupt

    bad = {"env_kwargs": {"limit": 1, "size": 3}, **_policies()}
    with pytest.raises(KeyboardInterrupt) as caught:
        diagnosed(bad, out=tmp_path, on_message=stop)
    assert caught.value.__notes__[0].startswith(f"what was played stays in {tmp_path}")
    assert "bad: 0 over 20 episodes" in caught.value.__notes__
    found = diagnosed(bad, out=tmp_path)
    whole = diagnosed(bad)
    assert found.episodes == whole.episodes - 20
    assert found.agents["left"].answer == whole.agents["left"].answer == "protocol"


def _policies() -> dict[str, Any]:
    return {"policies": HERE + "opens"}


class Scored(DifferenceSearch):
    """A search of which each difference is worth a number of points, and no episode is played."""

    worth: ClassVar = {"policy[a]": 1_000.0, "noise": 1.0}

    def _scores(self, chosen: Any, seed: int, n: int) -> Any:
        drawn = np.random.default_rng(n).normal(0.0, 0.1, n)
        return drawn + sum(self.worth[one.name] for one in chosen)


def test_a_remainder_that_is_tiny_makes_no_further_cause() -> None:
    """A point of a thousand is beyond chance on paired seeds, and doesn't matter."""
    kinds: Any = (("policy[a]", "policy"), ("noise", "argument"))
    differences = tuple(SetupDifference(name, kind, 0, 1) for name, kind in kinds)
    bad, runner = Setup("x"), ArmRunner(Contract())
    found = Scored(bad, bad, differences, runner, _nothing, 0.7, (1, 2)).run()
    assert [[one.name for one in each] for each in found] == [["policy[a]"]]


def _nothing(outcome: Outcome) -> float:
    return 0.0
