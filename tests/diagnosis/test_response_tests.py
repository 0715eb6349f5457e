"""Policies as black boxes: lags, draws, deaf fields and memory are found as they were planted."""

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import gamekeeper as gk
from gamekeeper.diagnosis.response_tests import ResponseTest, response_test
from gamekeeper.errors import ActionError
from gamekeeper.rollouts.interventions.fields import acted_fields

SEEN = Box(-1.0, 1.0, (3,), np.float32)
FEEDS = [
    [(np.random.default_rng([k, t]).uniform(-1, 1, 3).astype(np.float32), {}) for t in range(30)]
    for k in range(3)
]

GIVEN = [observation.tolist() for feed in FEEDS for observation, _ in feed]


def measured(
    make: Callable[[np.random.Generator], Callable[[Any], Any]], **more: Any
) -> ResponseTest:
    """The response test of a policy that `make` makes for an episode."""

    def fresh(stream: int) -> Callable[[Any, Any], Any]:
        act = make(np.random.default_rng(stream))
        return lambda observation, info: act(observation)

    fields = acted_fields(SEEN)
    return response_test(fresh, FEEDS, fields=fields, rng=np.random.default_rng(0), **more)


def at_once(observation: Any) -> int:
    """Reads two of three fields."""
    return int(observation[0] > 0) + 2 * int(observation[1] > 0)


def test_a_policy_without_memory_reacts_at_once_and_is_deaf_to_what_it_does_not_read() -> None:
    """Nothing else is seen in it."""
    found = measured(lambda rng: at_once)
    assert (found.lag, found.common_lags, found.memory) == (0, (0,), 0)
    assert (found.randomness, found.is_repeatable) == (0.0, True)
    assert found.deaf == ("field 2",)
    assert 0.2 < found.sensitivity["field 0"] < 0.8
    assert str(found) == "reacts at once; deaf to field 2"


def test_a_policy_that_fails_on_a_changed_observation_is_tested_on_the_others() -> None:
    """No environment gave that observation, so that its failure is no fault."""

    def act(observation: Any) -> int:
        if observation[0] > 0.9 and observation.tolist() not in GIVEN:
            raise ActionError("an action of no legal number")
        return at_once(observation)

    found = measured(lambda rng: act)
    assert found.failures > 0
    assert (found.lag, found.deaf) == (0, ("field 2",))
    assert f"after {found.failures} of {found.changes + found.failures} changes" in str(found)


@pytest.mark.parametrize("lag", [1, 3, 6])
def test_a_lag_is_measured_exactly(lag: int) -> None:
    """A queue of actions: the first reaction comes as late as it is long."""

    def make(rng: np.random.Generator) -> Callable[[Any], Any]:
        queue = deque([0] * lag)

        def act(observation: Any) -> int:
            queue.append(at_once(observation))
            return queue.popleft()

        return act

    found = measured(make)
    assert (found.lag, found.memory) == (lag, lag)


def test_a_policy_that_waits_reacts_late_to_a_change_that_stays() -> None:
    """It has to see something five times; a change of one decision says nothing of that."""

    def make(rng: np.random.Generator) -> Callable[[Any], Any]:
        seen: list[bool] = []

        def act(observation: Any) -> int:
            seen.append(bool(observation[2] > 1.0))  # which no recorded value is
            return int(len(seen) >= 5 and all(seen[-5:]))

        return act

    def fresh(stream: int) -> Callable[[Any, Any], Any]:
        act = make(np.random.default_rng(stream))
        return lambda observation, info: act(observation)

    third = acted_fields(Box(-9.0, 9.0, (3,), np.float32))[2:]
    found = response_test(fresh, FEEDS, fields=third, rng=np.random.default_rng(0))
    assert (found.reactions, found.lag) == (0, None)
    assert set(found.lasting) == {4}
    assert str(found) == "reacts only to changes that stay, 4 decisions late or more"
    assert measured(lambda rng: at_once).lasting[0] > 0


def test_draws_of_a_policy_are_told_from_its_reactions() -> None:
    """A fifth of its actions are drawn; what it reads is found all the same."""

    def make(rng: np.random.Generator) -> Callable[[Any], Any]:
        def act(observation: Any) -> int:
            slip, drawn = rng.random() < 0.2, int(rng.integers(4))
            return drawn if slip else at_once(observation)

        return act

    found = measured(make)
    assert 0.1 < found.randomness < 0.45
    assert (found.lag, found.deaf) == (0, ("field 2",))


def test_a_policy_that_no_seed_holds_is_not_judged() -> None:
    """Equal feeds and draws give other actions, so no difference says anything."""
    unseeded = np.random.default_rng(5)
    found = measured(lambda rng: lambda observation: int(unseeded.integers(9)))
    assert not found.is_repeatable
    assert (found.lag, found.changes) == (None, 0)


def test_memory_that_a_reset_leaves_is_said() -> None:
    """Equal feeds in the same order agree; a change that acts before it was made shows it."""
    calls, last = [0], [0.0]

    def make(rng: np.random.Generator) -> Callable[[Any], Any]:
        left = last[0]
        calls[0] += 1

        def act(observation: Any) -> float:
            last[0] = 0.0 if calls[0] < 10 else float(observation[0])
            return left

        return act

    found = measured(make)
    assert (found.lag, found.changes, found.is_repeatable) == (None, 0, False)
    assert "its reset leaves memory" in str(found)


def test_memory_and_saturation_are_measured() -> None:
    """A running sum remembers to the end, and its actions stand at the bound."""

    def make(rng: np.random.Generator) -> Callable[[Any], Any]:
        total = np.zeros(3)

        def act(observation: Any) -> Any:
            np.add(total, observation + 2.0, out=total)
            return np.clip(total / 20.0, -1.0, 1.0)

        return act

    found = measured(make, space=Box(-1.0, 1.0, (3,), np.float64))
    assert found.memory > 2
    assert found.lag == 0
    assert found.saturation is not None
    assert 0.3 < found.saturation < 1.0
    assert measured(lambda rng: at_once, space=Discrete(4)).saturation is None


class Queued:
    """Acts on what it was given two turns ago; without a reset, so that a copy plays."""

    def __init__(self) -> None:
        self.queue = [0, 0]

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> int:
        """The oldest action of the queue."""
        self.queue.append(int(np.asarray(observation).reshape(-1)[0] > 0))
        return self.queue.pop(0)


def test_policies_of_a_run_are_tested_new_for_each_feed() -> None:
    """Also a policy without a `reset`, by copies of it."""
    policies = {"picker": Queued(), "carrier": "reference"}
    evidence = gk.rollout("two_robot_line", policies=policies, episodes=2, seed=1)
    found = gk.responses(evidence, policies=policies)
    assert set(found) == {"picker", "carrier"}
    assert found["carrier"].lag == 0
    assert found["picker"].is_repeatable
    assert set(found["picker"].lags) <= {2}
